"""Receivers behind a connection, over which a server or a sender gives a message for each trigger."""

from __future__ import annotations

import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
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

_READ_BYTES = 1 << 18
_MAX_DRAINED_BYTES = 1 << 26

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
    def _decoded(self, data: bytes) -> Iterable[MessageT]:
        """Messages that are complete with more bytes; a `DeviceError` ends the connection."""

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
        late = self._until_quiet(most=0)
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
        # What waits was sent before: it is of no acquisition that will be asked for.
        self._received()
        if self._until_quiet(most=0):
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
            messages += self._received()
            if len(messages) < count:
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError(
                        f"{self.driver}: {len(messages)} of {count} {self.messages} came within "
                        f"{self._settings.timeout_s:g} s; check {self._check}"
                    )
                self._clock.wait(SLICE_S)
        messages += self._until_quiet(most=count)
        if len(messages) > count:
            raise AcquisitionError(
                f"{self.driver}: {len(messages)} {self.messages} came for {count} pulses; which are of this "
                "acquisition is not known"
            )
        return messages

    def _until_quiet(self, *, most: int) -> list[MessageT]:
        """Messages until none came for a while, or more than are of use."""
        messages: list[MessageT] = []
        quiet_s = self._clock.now_s() + self._settings.quiet_s
        while self._clock.now_s() < quiet_s and len(messages) <= most:
            new = self._received()
            messages += new
            if new:
                quiet_s = self._clock.now_s() + self._settings.quiet_s
            self._clock.wait(SLICE_S)
        return messages

    def _received(self) -> list[MessageT]:
        """Messages that have come, without waiting; `NotConnectedError` if the connection has ended."""
        taken = 0
        messages: list[MessageT] = []
        while taken < _MAX_DRAINED_BYTES:
            try:
                data = self._connection.recv(_READ_BYTES)
            except BlockingIOError:
                break
            except OSError as problem:
                raise NotConnectedError(f"{self.driver}: the connection has ended: {problem.strerror}") from problem
            if not data:
                raise NotConnectedError(f"{self.driver}: the {self.peer} has closed the connection; start it again")
            taken += len(data)
            try:
                messages += self._decoded(data)
            except DeviceError as problem:
                # No next message begins at a known place.
                self._connection.close()
                raise NotConnectedError(f"{self.driver}: {problem}; the connection is closed") from problem
        return messages


def mean_counts(each: list[Int16[np.ndarray, "channels samples"]]) -> Int16[np.ndarray, "channels samples"]:
    """Mean of channel data, rounded to counts."""
    mean: Int16[np.ndarray, "channels samples"] = np.rint(np.mean(each, axis=0)).astype(np.int16)
    return mean
