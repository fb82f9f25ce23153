"""Driver of a receiver behind a PLUS server: int16 images of channels x samples over OpenIGTLink, one per trigger."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from itertools import pairwise
from statistics import fmean

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    ConfigError,
    Int16,
    NotConnectedError,
    Permit,
    require_range,
)
from markerseek.drivers._receivers import acquired_frame
from markerseek.drivers._triggered import TriggeredMessages
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
        require_range("receiver: port", self.port, low=1, high=65535)
        for name, high in (("connect_s", 600), ("timeout_s", 600), ("quiet_s", 60)):
            require_range(f"receiver: {name}", getattr(self, name), low=0, high=high, unit="s", open_low=True)
        require_range("receiver: clock_s", self.clock_s, low=0, high=60, unit="s")

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


class PlusReceiver:
    """Images of a PLUS server as frames.

    A frame is the mean of as many images as pulses were permitted, all sent between `arm` and the end of the firing.
    Any other number is refused: an image too many, or too few, may be of another acquisition.

    ``connection``: to the server; it is closed by `close`. ``clock``: real time, or virtual time in tests.
    ``settings``: its keys in the rig file. ``unix_s``: time of day in seconds since 1970, which the images carry.
    ``emulated``: whether the server says that it is an emulator.
    """

    def __init__(
        self,
        *,
        connection: socket.socket,
        clock: Clock,
        settings: PlusSettings,
        dark_triggers: int,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        self._clock, self._settings, self._unix_s = clock, settings, unix_s
        self._dark_triggers = dark_triggers
        self._framer = igtl.Framer(most_bytes=MAX_IMAGE_BYTES)
        self._images = TriggeredMessages(
            connection,
            clock=clock,
            decode=self._decoded,
            driver="plus",
            peer="server",
            messages="images",
            check=f"the trigger and the name of the device, {settings.device}",
            timeout_s=settings.timeout_s,
            quiet_s=settings.quiet_s,
        )
        self._armed: tuple[Permit, float, float] | None = None
        self._sequence = 0
        self._fields: list[Mapping[str, str]] = []
        self.emulated = False
        # An emulator says so when a client comes; other servers say nothing, and no image may come before a trigger.
        self._images.until_quiet(most=0)

    def close(self) -> None:
        """Close the connection; allowed twice."""
        self._images.close()

    def settle(self) -> None:
        """Wait until no image comes.

        Raises `AcquisitionError` if images came although nothing was triggered; they are not used. Raises
        `NotConnectedError` if the connection has ended.
        """
        self._armed = None
        late = self._images.until_quiet(most=0)
        if late:
            raise AcquisitionError(
                f"plus: {len(late)} images of {self._settings.device} came although nothing was triggered; they are "
                "not used"
            )

    def arm(self, permit: Permit) -> None:
        """Forget what came before, and check that no image comes without a trigger.

        Raises `AcquisitionError` if images come although nothing is triggered. Raises `NotConnectedError` if the
        connection has ended.
        """
        self._armed = None
        # What waits was sent before: it is of no acquisition that will be asked for.
        self._images.received()
        if self._images.until_quiet(most=0):
            raise AcquisitionError(
                f"plus: images of {self._settings.device} come although nothing is triggered; the device must send one "
                "image for each trigger"
            )
        self._armed = permit, self._clock.now_s(), self._unix_s()

    def acquire(self, permit: Permit) -> ChannelFrame:
        """Mean of the images since `arm`.

        Raises `AcquisitionError` if it was not armed for this permit, or the images are not those of the permitted
        pulses. Raises `DeviceTimeoutError` if too few come in time. Raises `NotConnectedError` if the connection has
        ended.
        """
        if self._armed is None or self._armed[0] != permit:
            raise AcquisitionError(f"plus: it was not armed for the permit {permit.token!r}; arm it before firing")
        _, started_s, armed_unix_s = self._armed
        # Disarmed before reading: a frame that was refused cannot be asked for again.
        self._armed = None
        count = permit.pulses or self._dark_triggers
        images = self._images.exactly(count)
        stamps = [image.time_s for image in images]
        if any(later <= earlier for earlier, later in pairwise(stamps)):
            raise AcquisitionError("plus: two images have the same time, or times that fall; the server repeats itself")
        if not self.emulated and any("emulator" in image.metadata for image in images):
            # Its greeting came late: what was taken for a device must not go into a result as one.
            raise NotConnectedError("plus: the server is an emulator, which it did not say in time; connect again")
        samples = _mean(images)
        self._fields = [image.metadata for image in images]
        for image in images:
            age_s = armed_unix_s - image.time_s
            if age_s > self._settings.clock_s:
                raise AcquisitionError(
                    f"plus: an image was sent {age_s:.3f} s before the receiver was armed, clock_s allows "
                    f"{self._settings.clock_s:g} s; it is stale, or the clocks of the two computers differ"
                )
        self._sequence += 1
        return acquired_frame(
            samples,
            permit,
            sequence=self._sequence,
            pulses=permit.pulses,
            started_s=started_s,
            clock=self._clock,
            sampling_hz=self._settings.sampling_hz,
        )

    def energy_of(self, field: str) -> float:
        """Mean of a field of the last acquisition's images: the energy of their pulses, in the server's unit.

        Raises `AcquisitionError` if an image has no such field, or no number in it.
        """
        try:
            values = [float(fields[field]) for fields in self._fields]
        except (KeyError, ValueError) as problem:
            raise AcquisitionError(
                f"plus: an image has no number in its field {field!r}: {problem}; correct laser.energy_field, or let "
                "the server send it with each image"
            ) from problem
        return fmean(values)

    def _decoded(self, data: bytes) -> Iterator[igtl.Message]:
        for header, body in self._framer.feed(data):
            if (header.kind, header.device) == ("IMAGE", self._settings.device):
                yield igtl.decode(header, body)
            elif header.kind == "STATUS":
                said = igtl.decode(header, body).content
                self.emulated |= isinstance(said, igtl.Status) and said.message == igtl.EMULATOR


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
    mean: Int16[np.ndarray, "channels samples"] = np.rint(np.mean(counts, axis=0)).astype(np.int16)
    return mean


def _open(settings: PlusSettings, opening: Opening) -> PlusReceiver:
    connection = opening.keep(closing(connect_plus(settings)))
    return PlusReceiver(connection=connection, clock=opening.clock, settings=settings, dark_triggers=opening.pulses)


ENTRY: Entry[PlusSettings, PlusReceiver] = Entry(
    settings=PlusSettings,
    open=_open,
    describe=lambda settings, _receiver: f"PLUS server at {settings.host}, port {settings.port}",
)
