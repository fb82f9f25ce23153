"""Receivers behind a connection, over which a server or a sender gives a message for each trigger."""

from __future__ import annotations

import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from itertools import islice
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    Clock,
    DeviceError,
    DeviceTimeoutError,
    Int16,
    NotConnectedError,
    Permit,
    require_range,
)
from markerseek.drivers._receivers import acquired_frame, armed_for

_READ_BYTES = 1 << 16
_MAX_TAKEN_BYTES, _MAX_TAKEN = 1 << 24, 500
"""Most that is taken between two beats of the clock, in bytes and in messages: the lease is renewed in each."""

_FLOOD_PER_S = 5000
"""More messages in a second than any server or sender has reason to send: a tracker gives some hundred."""

SLICE_S = 0.005
"""Longest wait between two looks at a connection."""

MessageT = TypeVar("MessageT")


class ConnectionSettings(Protocol):
    """Settings of a receiver behind a connection."""

    @property
    def sampling_hz(self) -> float: ...

    @property
    def port(self) -> int: ...

    @property
    def connect_s(self) -> float: ...

    @property
    def timeout_s(self) -> float: ...

    @property
    def quiet_s(self) -> float: ...

    @property
    def clock_s(self) -> float: ...


def require_connection(settings: ConnectionSettings) -> None:
    """Refuse a port or a time that is out of its range."""
    require_range("receiver: port", settings.port, low=1, high=65535)
    for name, high in (("connect_s", 600), ("timeout_s", 600), ("quiet_s", 60)):
        require_range(f"receiver: {name}", getattr(settings, name), low=0, high=high, unit="s", open_low=True)
    require_range("receiver: clock_s", settings.clock_s, low=0, high=60, unit="s")


SettingsT = TypeVar("SettingsT", bound=ConnectionSettings)


class TriggeredReceiver(ABC, Generic[SettingsT, MessageT]):
    """A receiver whose frame is the mean of as many messages as pulses were permitted.

    All are sent between `arm` and the end of the firing. Any other number is refused: one too many, or too few, may be
    of another acquisition.

    ``connection``: it is closed by `close`. ``clock``: real time, or virtual time in tests. ``settings``: its keys in
    the rig file. ``unix_s``: time of day in seconds since 1970, which the messages carry. ``emulated``: whether an
    emulator sends.
    """

    driver: ClassVar[str]
    peer: ClassVar[str]
    messages: ClassVar[str]
    """``driver``, ``peer`` and ``messages``: names of the driver, of what sends, and of the messages, in an error."""
    cure: ClassVar[str]
    """What must be so that no message comes without a trigger."""

    def __init__(
        self,
        *,
        connection: socket.socket,
        clock: Clock,
        settings: SettingsT,
        dark_triggers: int,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        connection.setblocking(False)
        self._connection, self._clock, self._unix_s = connection, clock, unix_s
        self._settings, self._dark_triggers = settings, dark_triggers
        self._armed: tuple[Permit, float, float] | None = None
        self._sequence = 0
        self._decoding: Iterator[MessageT | None] = iter(())
        self._came, self._since_s = 0, clock.now_s()
        self.emulated = False
        self._begin()

    @abstractmethod
    def _begin(self) -> None:
        """Take the greeting, if there is one; `NotConnectedError` if it is not one."""

    @property
    @abstractmethod
    def _used(self) -> str:
        """The messages that are used, in words."""

    @property
    @abstractmethod
    def _check(self) -> str:
        """What to check where too few come."""

    @abstractmethod
    def _decoded(self, data: bytes) -> Iterator[MessageT | None]:
        """Messages that are complete with more bytes, None for one that is not used; a `DeviceError` ends all."""

    @abstractmethod
    def _samples(self, messages: list[MessageT], armed_unix_s: float) -> Int16[np.ndarray, "channels samples"]:
        """The mean of messages; `AcquisitionError` if one is not of this acquisition."""

    def close(self) -> None:
        """Close the connection; allowed twice."""
        self._connection.close()

    def settle(self) -> None:
        """Wait until no message comes.

        Raises `AcquisitionError` if some came although nothing was triggered; they are not used. Raises
        `NotConnectedError` if the connection has ended.
        """
        self._armed = None
        late = self._until_quiet()
        if late:
            raise AcquisitionError(
                f"{self.driver}: {len(late)} {self._used} came although nothing was triggered; they are not used"
            )

    def arm(self, permit: Permit) -> None:
        """Forget what came before, and check that no message comes without a trigger.

        Raises `AcquisitionError` if messages come although nothing is triggered. Raises `NotConnectedError` if the
        connection has ended.
        """
        self._armed = None
        ends_s = self._clock.now_s() + self._settings.timeout_s
        # What waits was sent before: it is of no acquisition that will be asked for.
        while self._take()[1] and self._clock.now_s() <= ends_s:
            self._clock.wait(0.0)
        if self._until_quiet():
            raise AcquisitionError(f"{self.driver}: {self._used} come although nothing is triggered; {self.cure}")
        self._armed = permit, self._clock.now_s(), self._unix_s()

    def acquire(self, permit: Permit) -> ChannelFrame:
        """Mean of the messages since `arm`.

        Raises `AcquisitionError` if it was not armed for this permit, or the messages are not those of the permitted
        pulses. Raises `DeviceTimeoutError` if too few come in time. Raises `NotConnectedError` if the connection has
        ended.
        """
        _, started_s, armed_unix_s = armed_for(permit, self._armed, driver=self.driver)
        # Disarmed before reading: a frame that was refused cannot be asked for again.
        self._armed = None
        samples = self._samples(self._exactly(permit.pulses or self._dark_triggers), armed_unix_s)
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

    def _exactly(self, count: int) -> list[MessageT]:
        """So many messages, where the firing has ended.

        Raises `DeviceTimeoutError` if too few come in time, `AcquisitionError` if too many come.
        """
        messages: list[MessageT] = []
        ends_s = self._clock.now_s() + self._settings.timeout_s
        while len(messages) < count:
            messages += self._take()[0]
            if len(messages) < count:
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError(
                        f"{self.driver}: {len(messages)} of {count} {self.messages} came within "
                        f"{self._settings.timeout_s:g} s; check {self._check}"
                    )
                self._clock.wait(SLICE_S)
        messages += self._until_quiet()
        if len(messages) > count:
            raise AcquisitionError(
                f"{self.driver}: {len(messages)} {self.messages} came for {count} pulses; which are of this "
                "acquisition is not known"
            )
        return messages

    def _until_quiet(self) -> list[MessageT]:
        """Messages that come before none came for a while: none, or the first that is too many and those with it."""
        quiet_s = self._clock.now_s() + self._settings.quiet_s
        while self._clock.now_s() < quiet_s:
            if new := self._take()[0]:
                return new
            self._clock.wait(SLICE_S)
        return []

    def _take(self) -> tuple[list[MessageT], bool]:
        """Messages that have come, without waiting, and whether there may be more.

        Raises `NotConnectedError` if the connection has ended, or so many come that they cannot be taken.
        """
        messages: list[MessageT] = []
        room, taken = _MAX_TAKEN, 0
        while taken < _MAX_TAKEN_BYTES:
            try:
                some = list(islice(self._decoding, room))
            except DeviceError as problem:
                # No next message begins at a known place.
                self._connection.close()
                raise NotConnectedError(f"{self.driver}: {problem}; the connection is closed") from problem
            messages += [message for message in some if message is not None]
            self._came += len(some)
            room -= len(some)
            if not room:
                break
            try:
                data = self._connection.recv(_READ_BYTES)
            except BlockingIOError:
                # Nothing waits: what comes next is counted anew.
                self._came, self._since_s = 0, self._clock.now_s()
                return messages, False
            except ConnectionResetError:
                data = b""
            except OSError as problem:
                raise NotConnectedError(f"{self.driver}: the connection has ended: {problem.strerror}") from problem
            if not data:
                raise NotConnectedError(f"{self.driver}: the {self.peer} has closed the connection; start it again")
            taken += len(data)
            self._decoding = self._decoded(data)
        self._require_no_flood()
        return messages, True

    def _require_no_flood(self) -> None:
        passed_s = self._clock.now_s() - self._since_s
        if self._came > _FLOOD_PER_S * (1 + passed_s):
            self._connection.close()
            raise NotConnectedError(
                f"{self.driver}: the {self.peer} floods: {self._came} messages came in {passed_s:.2f} s without a "
                f"pause, at most {_FLOOD_PER_S} a second are taken; the connection is closed; start the {self.peer} "
                "again, and let it send nothing but what each trigger gives"
            )


def mean_counts(each: list[Int16[np.ndarray, "channels samples"]]) -> Int16[np.ndarray, "channels samples"]:
    """Mean of channel data, rounded to counts."""
    mean: Int16[np.ndarray, "channels samples"] = np.rint(np.mean(each, axis=0)).astype(np.int16)
    return mean
