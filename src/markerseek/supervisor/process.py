"""The loop of the supervisor process: it relays bytes, and makes every device safe when the control loop is gone."""

from __future__ import annotations

import contextlib
import ctypes
import os
import select
import signal
import socket
import sys
import termios
import time
from collections import deque
from collections.abc import Sequence
from typing import Protocol

from markerseek.core import DeviceError, NotConnectedError
from markerseek.files import Line, open_serial
from markerseek.guard import Lease
from markerseek.supervisor.messages import Kind, packed, step_of, unpacked

_CHUNK = 4096
_MAX_UNSENT = 4096
"""Most bytes that may wait for a line; a control loop that sends more is out of control."""
_MAX_UNREAD = 1 << 18
"""Most bytes that may wait for the control process; what a line sends beyond that is lost."""
_PARENT_S = 0.5
"""Longest time between two checks that the control process lives: a child of it may keep the socket open."""
_LAST_S = 0.5
"""Longest time for the last safe commands to be sent."""
_PR_SET_PDEATHSIG = 1
"""`linux/prctl.h`; see prctl(2)."""


class _OpenLine(Protocol):
    def fileno(self) -> int: ...


def _opened(line: Line) -> _OpenLine:
    """Return the line, opened for this process alone, whose reads and writes never block.

    Raises `NotConnectedError` if it cannot be opened, or another program has it.
    """
    try:
        opened: _OpenLine = open_serial(
            line.path, baud=line.baud, parity=line.parity, rtscts=line.rtscts, write_timeout_s=0
        )
    except NotConnectedError as error:
        raise NotConnectedError(f"{line.name}: {error}") from None
    return opened


class _HeldLine:
    """A line, its unsent messages, and the safe command that is sent before them."""

    def __init__(self, line: Line) -> None:
        self.safe_command = line.safe_command
        self.name = line.name
        self._serial = _opened(line)
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

    def release(self) -> None:
        """Send the safe command: after a message that is half sent, before all others."""
        # Inside a half-sent message the device would read it as part of that one, and ignore both.
        self._unsent = deque([self._unsent[0]] if self._cut else [])
        self.send(self.safe_command)
        if self._unsent and not self.gone:
            # The line does not drain: bytes in the system's output buffer must not hold up the safe command.
            with contextlib.suppress(termios.error):
                termios.tcflush(self.fd, termios.TCOFLUSH)
            self.flush()

    def flush(self) -> None:
        while self._unsent and not self.gone:
            message = self._unsent[0]
            try:
                # May send a part; its rest must follow before any other message.
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


class SupervisorProcess:
    """Holds the lines under a lease, for one control process at the other end of a socket.

    ``lines``: what to hold. They are opened, and each safe command is sent, before anything else. ``period_s``: longest
    silence of the control loop while the lease is held. ``parent``: process id of the control process; None for the
    current parent. Raises `NotConnectedError` if a line cannot be opened.
    """

    def __init__(
        self, control: socket.socket, *, lines: Sequence[Line], period_s: float, parent: int | None = None
    ) -> None:
        self._lease = Lease(period_s=period_s)
        self._period_s = period_s
        self._lines = [_HeldLine(line) for line in lines]
        self._control = control
        self._control.setblocking(False)
        self._received = bytearray()
        self._unread = bytearray()
        self._lapsed = False
        self._over = False
        self._parent = os.getppid() if parent is None else parent
        # An earlier control process may have died in the middle of a move or a firing.
        for line in self._lines:
            line.release()

    def run(self) -> None:
        """Relay until the control process is gone, or a signal ends this one; then release every line."""
        wake, woken = socket.socketpair()
        woken.setblocking(False)
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, self._end)
        signal.set_wakeup_fd(woken.fileno())
        end_with_parent()
        # The parent may have died before the system was asked for the signal, which then never comes.
        self._over = self._over or os.getppid() != self._parent
        self._send(packed(Kind.READY))
        try:
            while not self._over:
                self._turn(wake)
        finally:
            self._release_lines("the supervisor ends")
            self._drain()

    def _turn(self, wake: socket.socket) -> None:
        """Wait for bytes, a signal or the end of the lease, and act on it."""
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
            self._release_lines(
                f"the control loop was silent for {now_s - ends_s + self._period_s:.2f} s, longer than the lease of "
                f"{self._period_s:g} s (close other programs, or allow more by supervisor.lease_s)"
            )
        # What a dead process sent before is not read: a permit among it would fire with nobody in control.
        dead = ready.get(self._control.fileno(), 0) & (select.POLLHUP | select.POLLERR)
        self._over = self._over or bool(dead) or os.getppid() != self._parent
        for line in self._lines:
            self._relay(line, reading=bool(ready.get(line.fd, 0) & ~select.POLLOUT))
        if not self._over and ready.get(self._control.fileno(), 0):
            self._read_control()

    def _read_control(self) -> None:
        """Read and carry out the messages of the control process; its end, or an invalid message, ends this process."""
        try:
            self._flush_control()
            data = self._control.recv(_CHUNK)
            self._over = self._over or not data
            self._received += data
            for kind, line, content in unpacked(self._received):
                self._execute(kind, line, content)
        except BlockingIOError:
            return
        except (OSError, DeviceError):
            self._over = True

    def _execute(self, kind: Kind, number: int, data: bytes) -> None:
        now_s = time.monotonic()
        if kind is Kind.BEAT:
            self._lease.beat(step_of(data), now_s=now_s)
        elif kind is Kind.HOLD:
            # After a lapse writes are refused until a person arms, so there is nothing that a lease could guard.
            if not self._lapsed:
                self._lease.hold(now_s=now_s)
        elif kind is Kind.RELEASE:
            self._lease.release()
        elif kind is Kind.ARM:
            self._arm()
        elif kind is Kind.WRITE and number < len(self._lines):
            self._write(self._lines[number], data)
        else:
            raise DeviceError(f"supervisor: {kind.name} of line {number} is no message to the supervisor")

    def _arm(self) -> None:
        gone = [line.name for line in self._lines if line.gone]
        if gone:
            self._send(packed(Kind.FAILED, f"supervisor: it cannot be armed, the lines {gone} are gone".encode()))
        else:
            self._lapsed = False
            self._send(packed(Kind.READY))

    def _write(self, line: _HeldLine, data: bytes) -> None:
        if self._lapsed:
            return
        if line.unsent_bytes + len(data) > _MAX_UNSENT:
            self._release_lines(f"more was written to the line {line.name!r} than it can carry")
            return
        line.send(data)

    def _relay(self, line: _HeldLine, *, reading: bool) -> None:
        if line.gone:
            return
        line.flush()
        data = line.read() if reading else b""
        # Dropped when the control process does not read: relaying must never wait for it.
        if data and len(self._unread) < _MAX_UNREAD:
            self._send(packed(Kind.DATA, data, line=self._lines.index(line)))
        if line.gone:
            # One dead line releases all lines: a search without its stage or its laser must end.
            self._release_lines(f"the line {line.name!r} is gone")

    def _release_lines(self, reason: str) -> None:
        """Send every safe command, and refuse writes until a person arms again."""
        for line in self._lines:
            line.release()
        # Latched until ARM: a loop that wakes up late must not go on firing as if nothing had happened.
        self._lease.release()
        self._lapsed = True
        self._send(packed(Kind.LAPSED, reason.encode()))

    def _send(self, message: bytes) -> None:
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
        """Wait until the last safe commands are sent, at most `_LAST_S`."""
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


def end_with_parent() -> bool:
    """Ask for SIGTERM at the death of the thread that started this process; False where there is none.

    A killed process gives back its memory before its sockets are closed: 20 ms and more for one of 200 MB. The signal
    is sent earlier, while its threads end. Without it, the supervisor still sees the closed socket.
    """
    if sys.platform != "linux":
        return False
    try:
        prctl = ctypes.CDLL(None, use_errno=True).prctl
    except (OSError, AttributeError):
        return False
    return int(prctl(_PR_SET_PDEATHSIG, ctypes.c_ulong(signal.SIGTERM), 0, 0, 0)) == 0


def set_realtime_priority() -> None:
    """Give this thread real-time priority, where the user may (``ulimit -r``): for threads that do little."""
    # SCHED_RESET_ON_FORK: children must not inherit a priority that can starve the whole computer.
    with contextlib.suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(1))
