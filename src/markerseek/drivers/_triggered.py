"""Messages that a server or a sender gives for each trigger, over a connection: as many as there were pulses."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterable
from typing import Generic, TypeVar

from markerseek.core import AcquisitionError, Clock, DeviceError, DeviceTimeoutError, NotConnectedError

_READ_BYTES = 1 << 18
_MAX_DRAINED_BYTES = 1 << 26

SLICE_S = 0.005
"""Longest wait between two looks at a connection."""

MessageT = TypeVar("MessageT")


class TriggeredMessages(Generic[MessageT]):
    """Messages from a connection, counted.

    ``decode``: messages that are complete with more bytes; a `DeviceError` of it ends the connection. ``driver``,
    ``peer``, ``messages``: names of the driver, of what sends, and of the messages, in the words of an error.
    ``check``: what to check where too few came. ``timeout_s``: longest time until all have come. ``quiet_s``: time
    without one after which none is on its way.
    """

    def __init__(
        self,
        connection: socket.socket,
        *,
        clock: Clock,
        decode: Callable[[bytes], Iterable[MessageT]],
        driver: str,
        peer: str,
        messages: str,
        check: str,
        timeout_s: float,
        quiet_s: float,
    ) -> None:
        connection.setblocking(False)
        self._connection, self._clock, self._decode = connection, clock, decode
        self._driver, self._peer, self._messages, self._check = driver, peer, messages, check
        self._timeout_s, self._quiet_s = timeout_s, quiet_s

    def close(self) -> None:
        """Close the connection; allowed twice."""
        self._connection.close()

    def exactly(self, count: int) -> list[MessageT]:
        """So many messages, where the firing has ended.

        Raises `DeviceTimeoutError` if too few come in time, `AcquisitionError` if too many come.
        """
        messages: list[MessageT] = []
        ends_s = self._clock.now_s() + self._timeout_s
        while len(messages) < count:
            messages += self.received()
            if len(messages) < count:
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError(
                        f"{self._driver}: {len(messages)} of {count} {self._messages} came within "
                        f"{self._timeout_s:g} s; check {self._check}"
                    )
                self._clock.wait(SLICE_S)
        messages += self.until_quiet(most=count)
        if len(messages) > count:
            raise AcquisitionError(
                f"{self._driver}: {len(messages)} {self._messages} came for {count} pulses; which are of this "
                "acquisition is not known"
            )
        return messages

    def until_quiet(self, *, most: int) -> list[MessageT]:
        """Messages until none came for a while, or more than are of use."""
        messages: list[MessageT] = []
        quiet_s = self._clock.now_s() + self._quiet_s
        while self._clock.now_s() < quiet_s and len(messages) <= most:
            new = self.received()
            messages += new
            if new:
                quiet_s = self._clock.now_s() + self._quiet_s
            self._clock.wait(SLICE_S)
        return messages

    def received(self) -> list[MessageT]:
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
                messages += self._decode(data)
            except DeviceError as problem:
                # No next message begins at a known place.
                self._connection.close()
                raise NotConnectedError(f"{self._driver}: {problem}; the connection is closed") from problem
        return messages
