"""Driver of a receiver behind a PLUS server: int16 images of channels x samples over OpenIGTLink, one per trigger."""

from __future__ import annotations

import socket
from collections.abc import Iterator, Mapping
from contextlib import closing
from itertools import pairwise
from statistics import fmean

import numpy as np

from markerseek.core import AcquisitionError, ConfigError, Int16, NotConnectedError
from markerseek.drivers._triggered import TriggeredReceiver, mean_counts, require_connection
from markerseek.drivers.entry import Entry, Opening, ReceiverSettings
from markerseek.wire import igtl

MAX_IMAGE_BYTES = 1 << 24
"""Largest message: 128 channels of 65,536 samples."""


class PlusSettings(
    ReceiverSettings, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="driver", tag="plus"
):
    """A PLUS server that sends one int16 IMAGE of channels x samples for each trigger."""

    device: str
    """Name of the images, as the server sends them: "RfVideo_Reference"."""
    host: str = "127.0.0.1"
    port: int = 18944
    """``host`` and ``port``: where the server is."""
    connect_s: float = 5.0
    """Longest time until it answers."""
    timeout_s: float = 20.0
    """Longest time from the trigger to the last image."""
    quiet_s: float = 0.2
    """Time without an image that is waited for before a trigger and after the last image."""
    clock_s: float = 0.05
    """Largest difference between the server's clock and this computer's: images that are older than the trigger by more
    are refused."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (self.device.isascii() and 0 < len(self.device) <= 20):
            raise ConfigError(f"receiver: device is {self.device!r}, it must have 1 to 20 characters of ASCII")
        require_connection(self)

    @property
    def varied(self) -> bool:
        """Whether the number of pulses may vary: there is an image for each."""
        return True


def connect_plus(settings: PlusSettings) -> socket.socket:
    """A connection to the server; `NotConnectedError` if it does not answer."""
    where = f"{settings.host}, port {settings.port}"
    try:
        return socket.create_connection((settings.host, settings.port), timeout=settings.connect_s)
    except OSError as problem:
        raise NotConnectedError(
            f"plus: no server on {where}: {problem.strerror or problem}; start PlusServer, or correct host and port"
        ) from problem


VERSION_CURE = "version 2 was asked for: use a newer PLUS, or another server that answers in it"
"""What to do where a server goes on in version 1."""


def ask_for_metadata(connection: socket.socket, *, what: str) -> None:
    """Ask a server for header version 2; `NotConnectedError` if the connection has ended."""
    try:
        connection.sendall(igtl.asks_for_metadata())
    except OSError as problem:
        raise NotConnectedError(f"{what} has ended: {problem.strerror}; start the server again") from problem


class PlusReceiver(TriggeredReceiver[PlusSettings, igtl.Message]):
    """Images of a PLUS server as frames, each the mean of the images of one acquisition."""

    driver, peer, messages = "plus", "server", "images"
    cure = "the device must send one image for each trigger"

    def _begin(self) -> None:
        self._framer = igtl.Framer(most_bytes=MAX_IMAGE_BYTES)
        self._fields: list[Mapping[str, str]] = []
        self._version: int = 1
        ask_for_metadata(self._connection, what="plus: the connection")
        # An emulator says so when a client comes; other servers say nothing, and no image may come before a trigger.
        self._until_quiet()

    @property
    def _used(self) -> str:
        return f"images of {self._settings.device}"

    @property
    def _check(self) -> str:
        return f"the trigger and the name of the device, {self._settings.device}"

    def _samples(self, messages: list[igtl.Message], armed_unix_s: float) -> Int16[np.ndarray, "channels samples"]:
        stamps = [image.time_s for image in messages]
        if any(later <= earlier for earlier, later in pairwise(stamps)):
            raise AcquisitionError("plus: two images have the same time, or times that fall; the server repeats itself")
        if not self.emulated and any("emulator" in image.metadata for image in messages):
            # Its greeting came late: what was taken for a device must not go into a result as one.
            raise NotConnectedError("plus: the server is an emulator, which it did not say in time; connect again")
        samples = _mean(messages)
        self._fields = [image.metadata for image in messages]
        self._version = min(image.version for image in messages)
        for stamp_s in stamps:
            age_s = armed_unix_s - stamp_s
            if age_s > self._settings.clock_s:
                raise AcquisitionError(
                    f"plus: an image was sent {age_s:.3f} s before the receiver was armed, clock_s allows "
                    f"{self._settings.clock_s:g} s; it is stale, or the clocks of the two computers differ"
                )
        return samples

    def energy_of(self, field: str) -> float:
        """Mean of a field of the last acquisition's images: the energy of their pulses, in the server's unit.

        Raises `AcquisitionError` if an image has no such field, or no number in it.
        """
        try:
            values = [float(fields[field]) for fields in self._fields]
        except (KeyError, ValueError) as problem:
            cure = "correct laser.energy_field, or let the server send it with each image"
            if self._version == 1:
                cure = f"it came in header version 1, which has no fields; {VERSION_CURE}"
            raise AcquisitionError(
                f"plus: an image has no number in its field {field!r}: {problem}; {cure}"
            ) from problem
        return fmean(values)

    def _decoded(self, data: bytes) -> Iterator[igtl.Message | None]:
        for header, body in self._framer.feed(data):
            if (header.kind, header.device) == ("IMAGE", self._settings.device):
                yield igtl.decode(header, body)
                continue
            if header.kind == "STATUS":
                self.emulated |= igtl.is_emulated(header, body)
            yield None


def _mean(images: list[igtl.Message]) -> Int16[np.ndarray, "channels samples"]:
    """Mean of the channel data of images, rounded to counts."""
    counts = []
    for image in images:
        pixels = image.content.pixels if isinstance(image.content, igtl.Image) else np.empty(0)
        if pixels.dtype != np.int16 or pixels.ndim != 3 or pixels.shape[0] != 1:
            raise AcquisitionError(
                f"plus: an image of {pixels.dtype}, shape {pixels.shape}; channel data are int16 of 1 x channels x "
                "samples"
            )
        counts.append(pixels[0])
    if len({each.shape for each in counts}) > 1:
        raise AcquisitionError(f"plus: images of the shapes {[each.shape for each in counts]} in one acquisition")
    return mean_counts(counts)


def _open(settings: PlusSettings, opening: Opening) -> PlusReceiver:
    connection = opening.keep(closing(connect_plus(settings)))
    return PlusReceiver(connection=connection, clock=opening.clock, settings=settings, dark_triggers=opening.pulses)


ENTRY: Entry[PlusSettings, PlusReceiver] = Entry(
    settings=PlusSettings,
    open=_open,
    describe=lambda settings, _receiver: f"PLUS server at {settings.host}, port {settings.port}",
)
