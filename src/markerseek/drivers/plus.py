"""Driver of a receiver behind a PLUS server: int16 images of channels x samples over OpenIGTLink, one per trigger."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from itertools import pairwise
from statistics import fmean
from typing import Annotated, Any, ClassVar

import numpy as np

from markerseek.core import AcquisitionError, Clock, ConfigError, Int16, NotConnectedError, Within
from markerseek.drivers.entry import Entry, Opening
from markerseek.drivers.standard_receiver import (
    ConnectionKeys,
    ConnectionMessages,
    ConnectionReceiver,
    mean_counts,
)
from markerseek.wire import igtl

_LOG = logging.getLogger(__name__)

MAX_IMAGE_BYTES = 1 << 24
"""Largest message: 128 channels of 65,536 samples."""


class PlusSettings(ConnectionKeys, frozen=True, kw_only=True, tag="plus"):
    """A PLUS server that sends one int16 IMAGE of channels x samples for each trigger."""

    device: str
    """Name of the images, as the server sends them: "RfVideo_Reference"."""
    port: Annotated[int, Within(1, 65535)] = 18944
    connect_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 5.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_device(self.device, part="receiver")


def require_device(device: str, *, part: str) -> None:
    """Refuse what is no name of a device; of a longer one than OpenIGTLink has, the first 20 characters count."""
    if not (device and device.isascii()):
        raise ConfigError(f"{part}: device is {device!r}, it must have one or more characters of ASCII")


_NAME_BYTES = 20
"""Longest name of a device in OpenIGTLink: a server cuts a longer one, as PLUS does."""

_MOST_NAMES = 10
"""Most other devices that an error names."""


def connect_plus(host: str, port: int, *, within_s: float, driver: str = "plus") -> socket.socket:
    """Return a connection to a server of OpenIGTLink; `NotConnectedError` if it does not answer."""
    try:
        return socket.create_connection((host, port), timeout=within_s)
    except OSError as problem:
        raise NotConnectedError(
            f"{driver}: no server on {host}, port {port}: {problem.strerror or problem}; start PlusServer, or correct "
            "host and port"
        ) from problem


VERSION_CURE = "version 2 was asked for: use a newer PLUS, or another server that answers in it"
"""What to do where a server goes on in version 1."""


class IgtlMessages(ConnectionMessages[igtl.Message]):
    """The messages of one kind and device; the server is asked for header version 2, which has metadata.

    Raises `NotConnectedError` if the connection has ended.
    """

    peer = "server"
    content: ClassVar[str]

    def __init__(self, connection: socket.socket, clock: Clock, *, device: str) -> None:
        super().__init__(connection, clock)
        self._device = device[:_NAME_BYTES]
        self._others: dict[str, None] = {}
        self._framer = igtl.Framer(most_bytes=MAX_IMAGE_BYTES)
        try:
            connection.sendall(igtl.asks_for_metadata())
        except OSError as problem:
            raise NotConnectedError(
                f"{self.driver}: the connection has ended: {problem.strerror}; start the server again"
            ) from problem

    def decoded(self, data: bytes) -> Iterator[igtl.Message | None]:
        """Yield the messages of that kind and device."""
        for header, body in self._framer.feed(data):
            _LOG.debug("%s < %s", self.driver, header)
            if (header.kind, header.device) == (self.content, self._device):
                yield igtl.decode(header, body)
                continue
            if header.kind == self.content and len(self._others) < _MOST_NAMES:
                self._others[header.device] = None
            if header.kind == "STATUS":
                self.emulated |= igtl.is_emulated_server(header, body)
            yield None

    @property
    def other_devices(self) -> str:
        """What to add to an error where no message of the device came: the names that did come; empty if none did."""
        if not self._others:
            return ""
        return f"; {self.content} came of {', '.join(map(repr, self._others))}, none of {self._device!r}"


class PlusMessages(IgtlMessages):
    """The images of a PLUS server; ``unix_s``: time of day in seconds since 1970, which the images carry."""

    driver = "plus"
    content = "IMAGE"
    called = "images"
    cure = "the device must send one image for each trigger"

    def __init__(
        self, connection: socket.socket, clock: Clock, settings: PlusSettings, unix_s: Callable[[], float]
    ) -> None:
        super().__init__(connection, clock, device=settings.device)
        self._settings = settings
        self._unix_s = unix_s
        self._armed_unix_s = 0.0
        self.used = f"images of {settings.device}"
        self._fields: list[Mapping[str, str]] = []
        self._version: int = 1

    @property
    def check(self) -> str:
        """What to check where too few images come."""
        return f"the trigger and the name of the device, {self._device}{self.other_devices}"

    def arm(self) -> None:
        """Note the time of day."""
        self._armed_unix_s = self._unix_s()

    def samples(self, messages: list[igtl.Message]) -> Int16[np.ndarray, "channels samples"]:
        """Return the mean of the images; they must be later than the arming, and one later than the other."""
        stamps = [image.time_s for image in messages]
        if any(later <= earlier for earlier, later in pairwise(stamps)):
            raise AcquisitionError("plus: two images have the same time, or times that fall; the server repeats itself")
        if not self.emulated and any("emulator" in image.metadata for image in messages):
            # Its greeting came late: what was taken for a device must not go into a result as one.
            raise NotConnectedError("plus: the server is an emulator, which it did not say in time; connect again")
        samples = _mean(messages)
        self._fields = [image.metadata for image in messages]
        self._version = min(image.version for image in messages)
        early_s = self._armed_unix_s - min(stamps)
        if early_s > self._settings.clock_s:
            raise AcquisitionError(
                f"plus: an image was sent {early_s:.3f} s before the receiver was armed, clock_s allows "
                f"{self._settings.clock_s:g} s; it is stale, or the clocks of the two computers differ"
            )
        return samples

    def energy_of(self, field: str) -> float:
        """Return the energy of the pulses of the last acquisition, the mean of a field of its images.

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


class PlusReceiver(ConnectionReceiver[PlusMessages]):
    """Images of a PLUS server as frames, each the mean of the images of one acquisition."""

    kind = PlusMessages

    def __init__(self, **parts: Any) -> None:
        super().__init__(**parts)
        # An emulator says so when a client comes; other servers say nothing, and no image may come before a trigger.
        self.until_quiet()


def _mean(images: list[igtl.Message]) -> Int16[np.ndarray, "channels samples"]:
    """Return the mean of the channel data of images, rounded to counts."""
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
    connection = connect_plus(settings.host, settings.port, within_s=settings.connect_s)
    opening.stack.enter_context(closing(connection))
    return PlusReceiver(connection=connection, clock=opening.clock, settings=settings, dark_triggers=opening.pulses)


ENTRY: Entry[PlusSettings, PlusReceiver] = Entry(
    settings=PlusSettings,
    open=_open,
    describe=lambda settings, _receiver: f"PLUS server at {settings.host}, port {settings.port}",
)
