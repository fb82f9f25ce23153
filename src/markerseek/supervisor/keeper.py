"""The loop of the supervisor's process: it relays bytes, and lets go of every device when the control loop is gone."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import termios
import time
from collections import deque
from collections.abc import Sequence

from markerseek.core import DeviceError
from markerseek.guard import Lease
from markerseek.supervisor.death import end_with_parent
from markerseek.supervisor.lines import Line, open_line
from markerseek.supervisor.messages import Kind, packed, step_of, unpacked

_CHUNK = 4096
_MOST_UNSENT = 4096
"""Most bytes that may wait for a line; a control loop that sends more has gone wild."""
_MOST_UNREAD = 1 << 18
"""Most bytes that may wait for the control process; what a line says beyond is lost."""
_PARENT_S = 0.5
"""How often to see whether the control process lives, lest a child of it keeps the socket open."""
_LAST_S = 0.5
"""Longest time for the last farewells to leave."""


class _HeldLine:
    """A line, its unsent messages, and the farewell that overtakes them."""

    def __init__(self, line: Line) -> None:
        self.farewell = line.farewell
        self.name = line.name
        self._serial = open_line(line)
        self.fd = self._serial.fileno()
        self._unsent: deque[bytes] = deque()
        self._cut = False
        self.gone = False

    @property
    def unsent_bytes(self) -> int:
        return sum(map(len, self._unsent))

    def send(self, message: bytes) -> None:
        self._unsent.append(message)
        self.flush()

    def let_go(self) -> None:
        """Say the farewell now: after the message that is half sent, before all others."""
        self._unsent = deque([self._unsent[0]] if self._cut else [])
        self.send(self.farewell)
        if self._unsent and not self.gone:
            # The line does not drain: what waits in the system must not keep the farewell back.
            with contextlib.suppress(termios.error):
                termios.tcflush(self.fd, termios.TCOFLUSH)
            self.flush()

    def flush(self) -> None:
        while self._unsent and not self.gone:
            message = self._unsent[0]
            try:
                sent = os.write(self.fd, message)
            except BlockingIOError:
                return
            except OSError:
                self.gone = True
                return
            self._cut = sent < len(message)
            if self._cut:
                self._unsent[0] = message[sent:]
                return
            self._unsent.popleft()

    def read(self) -> bytes:
        try:
            data = os.read(self.fd, _CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        self.gone = self.gone or not data
        return data


class Keeper:
    """Holds the lines under a lease, for one control process at the other end of a socket.

    Parameters
    ----------
    control
        Socket to the control process.
    lines
        What to hold. They are opened, and each farewell is said, before anything else.
    period_s
        Longest silence of the control loop while the lease is held, in seconds.
    parent
        Number of the control process; None for the one that is our parent now.

    Raises
    ------
    NotConnectedError
        If a line cannot be opened.
    """

    def __init__(
        self, control: socket.socket, *, lines: Sequence[Line], period_s: float, parent: int | None = None
    ) -> None:
        self._lease = Lease(period_s=period_s)
        self._period_s = period_s
        self._lines = [_HeldLine(line) for line in lines]
        self._control = control
        self._control.setblocking(False)
        self._heard = bytearray()
        self._unread = bytearray()
        self._lapsed = False
        self._over = False
        self._parent = os.getppid() if parent is None else parent
        for line in self._lines:
            line.let_go()

    def run(self) -> None:
        """Relay until the control process is gone, or a signal ends this one; then let go of every line."""
        wake, woken = socket.socketpair()
        woken.setblocking(False)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._end)
        signal.set_wakeup_fd(woken.fileno())
        end_with_parent(signal.SIGTERM)
        # It may have died before the system was asked for a signal.
        self._over = self._over or os.getppid() != self._parent
        self._tell(packed(Kind.READY))
        try:
            while not self._over:
                self._turn(wake)
        finally:
            self._let_go("the supervisor ends")
            self._drain()

    def _turn(self, wake: socket.socket) -> None:
        """Wait for whatever comes first, the end of the lease among it, and act on it."""
        poller = select.poll()
        poller.register(wake, select.POLLIN)
        poller.register(self._control, _wanted(writing=bool(self._unread)))
        for line in self._lines:
            if not line.gone:
                poller.register(line.fd, _wanted(writing=line.unsent_bytes > 0))
        ends_s = self._lease.ends_s
        left_s = _PARENT_S if ends_s is None else max(ends_s - time.monotonic(), 0.0)
        ready = dict(poller.poll(min(left_s, _PARENT_S) * 1e3))
        now_s = time.monotonic()
        if ends_s is not None and self._lease.lapsed(now_s=now_s):
            self._let_go(
                f"the control loop was silent for {now_s - ends_s + self._period_s:.2f} s, longer than the lease of "
                f"{self._period_s:g} s (close other programs, or allow more by supervisor.lease_s)"
            )
        # Whatever a dead process has said before is not read any more.
        dead = ready.get(self._control.fileno(), 0) & (select.POLLHUP | select.POLLERR)
        self._over = self._over or bool(dead) or os.getppid() != self._parent
        for line in self._lines:
            self._relay(line, reading=bool(ready.get(line.fd, 0) & ~select.POLLOUT))
        if not self._over and ready.get(self._control.fileno(), 0):
            self._serve()

    def _serve(self) -> None:
        """Take in what the control process says; its end, or nonsense, is the end of this process too."""
        try:
            self._flush_control()
            data = self._control.recv(_CHUNK)
            self._over = self._over or not data
            self._heard += data
            for kind, line, content in unpacked(self._heard):
                self._obey(kind, line, content)
        except BlockingIOError:
            return
        except (OSError, DeviceError):
            self._over = True

    def _obey(self, kind: Kind, number: int, data: bytes) -> None:
        now_s = time.monotonic()
        if kind is Kind.BEAT:
            self._lease.beat(step_of(data), now_s=now_s)
        elif kind is Kind.HOLD:
            if not self._lapsed:
                self._lease.hold(now_s=now_s)
        elif kind is Kind.RELEASE:
            self._lease.release()
        elif kind is Kind.ARM:
            self._arm()
        elif kind is Kind.WRITE and number < len(self._lines):
            self._write(self._lines[number], data)
        else:
            raise DeviceError(f"supervisor: {kind.name} of line {number} is not for this side")

    def _arm(self) -> None:
        gone = [line.name for line in self._lines if line.gone]
        if gone:
            self._tell(packed(Kind.FAILED, f"supervisor: it cannot be armed, the lines {gone} are gone".encode()))
        else:
            self._lapsed = False
            self._tell(packed(Kind.READY))

    def _write(self, line: _HeldLine, data: bytes) -> None:
        if self._lapsed:
            return
        if line.unsent_bytes + len(data) > _MOST_UNSENT:
            self._let_go(f"more was written to the line {line.name!r} than it can carry")
            return
        line.send(data)

    def _relay(self, line: _HeldLine, *, reading: bool) -> None:
        if line.gone:
            return
        line.flush()
        data = line.read() if reading else b""
        if data and len(self._unread) < _MOST_UNREAD:
            self._tell(packed(Kind.DATA, data, line=self._lines.index(line)))
        if line.gone:
            self._let_go(f"the line {line.name!r} is gone")

    def _let_go(self, reason: str) -> None:
        """Say every farewell, and refuse writes until somebody arms again."""
        for line in self._lines:
            line.let_go()
        self._lease.release()
        self._lapsed = True
        self._tell(packed(Kind.LAPSED, reason.encode()))

    def _tell(self, message: bytes) -> None:
        self._unread += message
        with contextlib.suppress(OSError):
            self._flush_control()

    def _flush_control(self) -> None:
        while self._unread:
            try:
                sent = self._control.send(self._unread)
            except BlockingIOError:
                return
            del self._unread[:sent]

    def _drain(self) -> None:
        """Give the last farewells time to leave this process."""
        ends_s = time.monotonic() + _LAST_S
        while (waiting := [line for line in self._lines if line.unsent_bytes and not line.gone]) and (
            time.monotonic() < ends_s
        ):
            poller = select.poll()
            for line in waiting:
                poller.register(line.fd, select.POLLOUT)
            poller.poll(_LAST_S * 1e3)
            for line in waiting:
                line.flush()

    def _end(self, _number: int, _frame: object) -> None:
        self._over = True


def _wanted(*, writing: bool) -> int:
    return select.POLLIN | (select.POLLOUT if writing else 0)
