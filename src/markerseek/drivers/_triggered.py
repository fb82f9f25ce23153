"""Receivers behind a connection, over which a server or a sender gives a message for each trigger."""

from __future__ import annotations

import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

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
)
from markerseek.drivers._receivers import acquired_frame

_READ_BYTES = 1 << 18
_MAX_DRAINED_BYTES = 1 << 26

SLICE_S = 0.005
"""Longest wait between two looks at a connection."""

MessageT = TypeVar("MessageT")


class TriggeredReceiver(ABC, Generic[MessageT]):
    """A receiver whose frame is the mean of as many messages as pulses were permitted.

    All are sent between `arm` and the end of the firing. Any other number is refused: one too many, or too few, may be
    of another acquisition.

    ``clock``: real time, or virtual time in tests. ``unix_s``: time of day in seconds since 1970, which the messages
    carry. ``driver``, ``peer``, ``messages``, ``sent``: names of the driver, of what sends, of the messages, and of
    those that this rig uses, in the words of an error. ``check``: what to check where too few came. ``cure``: what
    must be so that none comes without a trigger. ``timeout_s``: longest time until all have come. ``quiet_s``: time
    without one after which none is on its way.
    """

    def __init__(
        self,
        connection: socket.socket,
        *,
        clock: Clock,
        unix_s: Callable[[], float],
        dark_triggers: int,
        sampling_hz: float,
        timeout_s: float,
        quiet_s: float,
        driver: str,
        peer: str,
        messages: str,
        sent: str,
        check: str,
        cure: str,
    ) -> None:
        connection.setblocking(False)
        self._connection, self._clock, self._unix_s = connection, clock, unix_s
        self._dark_triggers, self._sampling_hz = dark_triggers, sampling_hz
        self._timeout_s, self._quiet_s = timeout_s, quiet_s
        self._driver, self._peer, self._messages, self._sent = driver, peer, messages, sent
        self._check, self._cure = check, cure
        self._armed: tuple[Permit, float, float] | None = None
        self._sequence = 0

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
                f"{self._driver}: {len(late)} {self._sent} came although nothing was triggered; they are not used"
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
            raise AcquisitionError(f"{self._driver}: {self._sent} come although nothing is triggered; {self._cure}")
        self._armed = permit, self._clock.now_s(), self._unix_s()

    def acquire(self, permit: Permit) -> ChannelFrame:
        """Mean of the messages since `arm`.

        Raises `AcquisitionError` if it was not armed for this permit, or the messages are not those of the permitted
        pulses. Raises `DeviceTimeoutError` if too few come in time. Raises `NotConnectedError` if the connection has
        ended.
        """
        if self._armed is None or self._armed[0] != permit:
            raise AcquisitionError(
                f"{self._driver}: it was not armed for the permit {permit.token!r}; arm it before firing"
            )
        _, started_s, armed_unix_s = self._armed
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
            sampling_hz=self._sampling_hz,
        )

    def _exactly(self, count: int) -> list[MessageT]:
        """So many messages, where the firing has ended.

        Raises `DeviceTimeoutError` if too few come in time, `AcquisitionError` if too many come.
        """
        messages: list[MessageT] = []
        ends_s = self._clock.now_s() + self._timeout_s
        while len(messages) < count:
            messages += self._received()
            if len(messages) < count:
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError(
                        f"{self._driver}: {len(messages)} of {count} {self._messages} came within "
                        f"{self._timeout_s:g} s; check {self._check}"
                    )
                self._clock.wait(SLICE_S)
        messages += self._until_quiet(most=count)
        if len(messages) > count:
            raise AcquisitionError(
                f"{self._driver}: {len(messages)} {self._messages} came for {count} pulses; which are of this "
                "acquisition is not known"
            )
        return messages

    def _until_quiet(self, *, most: int) -> list[MessageT]:
        """Messages until none came for a while, or more than are of use."""
        messages: list[MessageT] = []
        quiet_s = self._clock.now_s() + self._quiet_s
        while self._clock.now_s() < quiet_s and len(messages) <= most:
            new = self._received()
            messages += new
            if new:
                quiet_s = self._clock.now_s() + self._quiet_s
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
                raise NotConnectedError(f"{self._driver}: the connection has ended: {problem.strerror}") from problem
            if not data:
                raise NotConnectedError(f"{self._driver}: the {self._peer} has closed the connection; start it again")
            taken += len(data)
            try:
                messages += self._decoded(data)
            except DeviceError as problem:
                # No next message begins at a known place.
                self._connection.close()
                raise NotConnectedError(f"{self._driver}: {problem}; the connection is closed") from problem
        return messages


def mean_counts(each: list[Int16[np.ndarray, "channels samples"]]) -> Int16[np.ndarray, "channels samples"]:
    """Mean of channel data, rounded to counts."""
    mean: Int16[np.ndarray, "channels samples"] = np.rint(np.mean(each, axis=0)).astype(np.int16)
    return mean
