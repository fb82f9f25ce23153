"""A receiver from its messages, one for each trigger: how many make a frame, and which are of another acquisition."""

from __future__ import annotations

import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from itertools import islice
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeVar, TypeVarTuple

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    DeviceError,
    DeviceTimeoutError,
    FrameHeader,
    Int16,
    NotConnectedError,
    Permit,
    Within,
)
from markerseek.drivers.clock import polls
from markerseek.drivers.entry import ReceiverKeys

_READ_BYTES = 1 << 16
_MAX_TAKEN_BYTES = 1 << 24
_MAX_TAKEN = 500
"""Most that is taken between two beats of the clock, in bytes and in messages: the lease is renewed in each."""

_FLOOD_PER_S = 5000
"""More messages in a second than any server or sender has reason to send: a tracker gives some hundred."""

SLICE_S = 0.005
"""Longest wait between two looks at the messages."""

MessageT = TypeVar("MessageT")
Noted = TypeVarTuple("Noted")


def armed_for(permit: Permit, armed: tuple[Permit, *Noted] | None, *, driver: str) -> tuple[Permit, *Noted]:
    """Return what a receiver noted when it was armed; `AcquisitionError` if that was not for this permit."""
    if armed is None or armed[0] != permit:
        raise AcquisitionError(f"{driver}: it was not armed for the permit {permit.token!r}; arm it before firing")
    return armed


def in_the_dark(permit: Permit, triggers: int) -> str:
    """Return the part of the error of a receiver that was not triggered: who should have done it without light."""
    if permit.pulses:
        return ""
    return f" in the dark: the laser's fire(0) must trigger the receiver {triggers} times without light"


class Frames:
    """Makes the frames of a receiver, numbered; an acquisition ends when its frame is made."""

    def __init__(self, clock: Clock, sampling_hz: float) -> None:
        self._clock = clock
        self._sampling_hz = sampling_hz
        self._sequence = 0

    def made_of(
        self, samples: Int16[np.ndarray, "channels samples"], permit: Permit, *, pulses: int, started_s: float
    ) -> ChannelFrame:
        """Return the channel data as the next frame, of a permit."""
        self._sequence += 1
        header = FrameHeader(
            sequence=self._sequence,
            token=permit.token,
            pulses=pulses,
            commanded_deg=permit.commanded_deg,
            started_s=started_s,
            ended_s=self._clock.now_s(),
        )
        return ChannelFrame(header=header, samples=samples, sampling_hz=self._sampling_hz)


def mean_counts(each: list[Int16[np.ndarray, "channels samples"]]) -> Int16[np.ndarray, "channels samples"]:
    """Return the mean of channel data, rounded to counts."""
    mean: Int16[np.ndarray, "channels samples"] = np.rint(np.mean(each, axis=0)).astype(np.int16)
    return mean


class Messages(Protocol[MessageT]):
    """The messages of a device, one for each trigger.

    ``driver``, ``used``, ``called``: names of the driver, of the messages that are used, and of a message, in an error.
    ``cure``: what must be so that no message comes without a trigger.
    """

    driver: str
    used: str
    called: str
    cure: str

    @property
    def check(self) -> str:
        """What to check where too few come."""

    def arm(self) -> None:
        """Prepare for a trigger; what came until now is of no acquisition."""

    def take(self) -> tuple[list[MessageT], bool]:
        """Return the messages that have come, without waiting, and whether there may be more."""

    def samples(self, messages: list[MessageT]) -> Int16[np.ndarray, "channels samples"]:
        """Return the mean of messages; `AcquisitionError` if one is not of this acquisition."""

    def close(self) -> None:
        """Close the connection; allowed twice."""


MessagesT = TypeVar("MessagesT", bound=Messages)  # type: ignore[type-arg]


class StandardReceiver(Generic[MessagesT]):
    """A `markerseek.core.Receiver` whose frame is the mean of as many messages as pulses were permitted.

    All are sent between `arm` and the end of the firing. Any other number is refused: one too many, or too few, may be
    of another acquisition.

    ``clock``: real time, or virtual time in tests. ``dark_triggers``: messages of a dark frame. ``timeout_s``: longest
    time from the trigger to the last message. ``quiet_s``: time without a message that is waited for before a trigger
    and after the last message.
    """

    def __init__(
        self,
        messages: MessagesT,
        *,
        clock: Clock,
        dark_triggers: int,
        sampling_hz: float,
        timeout_s: float = 20.0,
        quiet_s: float = 0.2,
    ) -> None:
        self.messages = messages
        self._clock = clock
        self._dark_triggers = dark_triggers
        self._frames = Frames(clock, sampling_hz)
        self._timeout_s = timeout_s
        self._quiet_s = quiet_s
        self._armed: tuple[Permit, float] | None = None

    @property
    def emulated(self) -> bool:
        """Whether an emulator sends."""
        return bool(getattr(self.messages, "emulated", False))

    def close(self) -> None:
        """Close the connection; allowed twice."""
        self.messages.close()

    def settle(self) -> None:
        """Wait until no message comes.

        Raises `AcquisitionError` if some came although nothing was triggered; they are not used. Raises
        `NotConnectedError` if the connection has ended.
        """
        self._armed = None
        if late := self.until_quiet():
            said = self.messages
            raise AcquisitionError(
                f"{said.driver}: {len(late)} {said.used} came although nothing was triggered; they are not used"
            )

    def arm(self, permit: Permit) -> None:
        """Forget what came before, and check that no message comes without a trigger.

        Raises `AcquisitionError` if messages come although nothing is triggered. Raises `NotConnectedError` if the
        connection has ended.
        """
        self._armed = None
        ends_s = self._clock.now_s() + self._timeout_s
        # What waits was sent before: it is of no acquisition that will be asked for.
        while self.messages.take()[1] and self._clock.now_s() <= ends_s:
            self._clock.wait(0.0)
        if self.until_quiet():
            said = self.messages
            raise AcquisitionError(f"{said.driver}: {said.used} come although nothing is triggered; {said.cure}")
        self._armed = permit, self._clock.now_s()
        self.messages.arm()

    def acquire(self, permit: Permit) -> ChannelFrame:
        """Return the mean of the messages since `arm`.

        Raises `AcquisitionError` if it was not armed for this permit, or the messages are not those of the permitted
        pulses. Raises `DeviceTimeoutError` if too few come in time. Raises `NotConnectedError` if the connection has
        ended.
        """
        _, started_s = armed_for(permit, self._armed, driver=self.messages.driver)
        # Disarmed before reading: a frame that was refused cannot be asked for again.
        self._armed = None
        samples = self.messages.samples(self._exactly(permit))
        return self._frames.made_of(samples, permit, pulses=permit.pulses, started_s=started_s)

    def until_quiet(self) -> list[object]:
        """Return the messages until none comes for a while: none, or the first one too many and those with it."""
        for _ in polls(self._clock, within_s=self._quiet_s, every_s=SLICE_S):
            if new := self.messages.take()[0]:
                return list(new)
        return []

    def _exactly(self, permit: Permit) -> list[object]:
        """As many messages as triggers, where the firing has ended.

        Raises `DeviceTimeoutError` if too few come in time, `AcquisitionError` if too many come.
        """
        came: list[object] = []
        said = self.messages
        count = permit.pulses or self._dark_triggers
        for _ in polls(self._clock, within_s=self._timeout_s, every_s=SLICE_S):
            came += self.messages.take()[0]
            if len(came) >= count:
                break
        else:
            raise DeviceTimeoutError(
                f"{said.driver}: {len(came)} of {count} {said.called} came within {self._timeout_s:g} s"
                f"{in_the_dark(permit, count)}; check {said.check}"
            )
        came += self.until_quiet()
        if len(came) > count:
            raise AcquisitionError(
                f"{said.driver}: {len(came)} {said.called} came for {count} pulses; which are of this "
                "acquisition is not known"
            )
        return came


class ConnectionKeys(ReceiverKeys, frozen=True, kw_only=True):
    """Keys of a receiver behind a connection that gives a message for each trigger."""

    host: str = "127.0.0.1"
    """Address of the server. A receiver that waits for its sender has the address of this computer here."""
    port: Annotated[int, Within(1, 65535)]
    """Port of the server, or that on which it waits."""
    connect_s: Annotated[float, Within(0, 600, "s", open_low=True)]
    """Longest time until the connection is there."""
    timeout_s: Annotated[float, Within(0, 600, "s", open_low=True)] = 20.0
    """Longest time from the trigger to the last message."""
    quiet_s: Annotated[float, Within(0, 60, "s", open_low=True)] = 0.2
    """Time without a message that is waited for before a trigger and after the last message."""
    clock_s: Annotated[float, Within(0, 60, "s")] = 0.05
    """Largest difference between the clocks of the two computers: what is older than the trigger by more is refused."""

    @property
    def varied(self) -> bool:
        """Whether the number of pulses may vary: there is a message for each."""
        return True


class ConnectionMessages(ABC, Generic[MessageT]):
    """Messages over a connection, which is closed by `close`; ``peer``: name of what sends, in an error."""

    driver: ClassVar[str]
    peer: ClassVar[str]

    def __init__(self, connection: socket.socket, clock: Clock) -> None:
        connection.setblocking(False)
        self.connection = connection
        self._clock = clock
        self._decoding: Iterator[MessageT | None] = iter(())
        self._came = 0
        self._since_s = clock.now_s()
        self.emulated = False

    @abstractmethod
    def decoded(self, data: bytes) -> Iterator[MessageT | None]:
        """Return the messages that these bytes complete, None for an unused message.

        A `DeviceError` ends the connection.
        """

    def close(self) -> None:
        """Close the connection; allowed twice."""
        self.connection.close()

    def take(self) -> tuple[list[MessageT], bool]:
        """As `Messages.take`.

        Raises `NotConnectedError` if the connection has ended, or more messages come than can be taken.
        """
        messages: list[MessageT] = []
        room = _MAX_TAKEN
        taken = 0
        while taken < _MAX_TAKEN_BYTES:
            try:
                some = list(islice(self._decoding, room))
            except DeviceError as problem:
                # No next message begins at a known place.
                self.close()
                raise NotConnectedError(f"{self.driver}: {problem}; the connection is closed") from problem
            messages += [message for message in some if message is not None]
            self._came += len(some)
            room -= len(some)
            if not room:
                break
            try:
                data = self.connection.recv(_READ_BYTES)
            except BlockingIOError:
                # Nothing waits: the count of a flood begins again.
                self._came = 0
                self._since_s = self._clock.now_s()
                return messages, False
            except ConnectionResetError:
                data = b""
            except OSError as problem:
                raise NotConnectedError(f"{self.driver}: the connection has ended: {problem.strerror}") from problem
            if not data:
                raise NotConnectedError(f"{self.driver}: the {self.peer} has closed the connection; start it again")
            taken += len(data)
            self._decoding = self.decoded(data)
        self._require_no_flood()
        return messages, True

    def _require_no_flood(self) -> None:
        passed_s = self._clock.now_s() - self._since_s
        if self._came > _FLOOD_PER_S * (1 + passed_s):
            self.close()
            raise NotConnectedError(
                f"{self.driver}: the {self.peer} floods: {self._came} messages came in {passed_s:.2f} s without a "
                f"pause, at most {_FLOOD_PER_S} a second are taken; the connection is closed; start the {self.peer} "
                "again, and let it send only what the search needs"
            )


class ConnectionReceiver(StandardReceiver[MessagesT]):
    """A receiver behind a connection; a subclass names the class of its messages.

    ``unix_s``: time of day in seconds since 1970, which the messages carry.
    """

    kind: ClassVar[Callable[..., Any]]

    def __init__(
        self,
        *,
        connection: socket.socket,
        clock: Clock,
        settings: ConnectionKeys,
        dark_triggers: int,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        super().__init__(
            type(self).kind(connection, clock, settings, unix_s),
            clock=clock,
            dark_triggers=dark_triggers,
            sampling_hz=settings.sampling_hz,
            timeout_s=settings.timeout_s,
            quiet_s=settings.quiet_s,
        )
