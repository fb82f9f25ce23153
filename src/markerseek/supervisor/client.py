"""The supervisor as the control process uses it: start it, exchange bytes with the devices, renew the lease."""

from __future__ import annotations

import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import msgspec

from markerseek._closing import Closing
from markerseek.core import ConfigError, NotConnectedError
from markerseek.files import Line, pyserial
from markerseek.guard import Lease
from markerseek.supervisor.messages import MAX_BYTES, Kind, packed, packed_beat, unpacked
from markerseek.supervisor.process import set_realtime_priority

_CHUNK = 65536
_MAX_CHUNKS = 16
"""Most that is read at once: a device that floods must not hold up the control loop."""
_ANSWER_S = 2.0
"""Longest time for the supervisor to answer, to take in what it is sent, or to end."""


class Supervisor(Closing):
    """A separate process that holds the lines, and sends each its safe command when this one dies or hangs.

    It ends with this process; Ctrl-C in the terminal does not reach it. If it is killed, each device's own lease
    remains.

    ``lines``: what to hold, each name once. ``period_s``: longest silence of the control loop while the lease is held,
    in (0, 1] s. ``start_s``: longest time for the process to start. Raises `NotConnectedError` if a line cannot be
    opened, or the process does not start.
    """

    def __init__(self, *, lines: Sequence[Line], period_s: float = 0.1, start_s: float = 30.0) -> None:
        # What the other process would refuse, refused here, with its own error.
        Lease(period_s=period_s)
        pyserial()
        names = [line.name for line in lines]
        if not 0 < len(set(names)) == len(names) < 256:
            raise ConfigError(f"supervisor: the lines are called {names}; at least one is needed, and each name once")
        # Five beats in a lease: a few may be late on a busy computer before the laser is switched off.
        self._slice_s = period_s / 5
        self._step = 0
        self._held_by: int | None = None
        self._lapsed: str | None = None
        self._ready = False
        self._received = bytearray()
        self._data = [bytearray() for _ in lines]
        self._ports = {
            name: SupervisedPort(write=partial(self._write, number), read=partial(self._read, number))
            for number, name in enumerate(names)
        }
        self._socket, other = socket.socketpair()
        self._socket.settimeout(_ANSWER_S)
        # The system tells a process that the thread which started it has ended (`end_with_parent`), not that the
        # program has. So one thread starts it, then only waits, and lives as long as this program. If the program is
        # killed, an idle thread ends before the memory is freed.
        self._starter = ThreadPoolExecutor(
            max_workers=1, thread_name_prefix="supervisor", initializer=set_realtime_priority
        )
        with other:
            command = [
                sys.executable,
                "-P",  # else a file of the current folder could pass for a library
                "-m",
                "markerseek.supervisor",
                str(other.fileno()),
                msgspec.json.encode({"lines": lines, "period_s": period_s, "parent": os.getpid()}).decode(),
            ]
            started = self._starter.submit(
                subprocess.Popen,
                command,
                pass_fds=[other.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                start_new_session=True,  # Ctrl-C goes to the terminal's process group only
            )
            try:
                self._process = started.result()
            except OSError as problem:
                self._socket.close()
                self._starter.shutdown()
                raise NotConnectedError(
                    f"supervisor: its process cannot be started: {problem.strerror}; end other programs"
                ) from problem
        try:
            self._await_ready(start_s)
        except BaseException:
            self.close()
            raise

    @property
    def pid(self) -> int:
        """Process id of the supervisor."""
        return self._process.pid

    def port(self, name: str) -> SupervisedPort:
        """Return the line of that name."""
        try:
            return self._ports[name]
        except KeyError:
            raise ConfigError(f"supervisor: there is no line {name!r}; it holds {sorted(self._ports)}") from None

    def arm(self) -> None:
        """Let writes through again after a lapse, in a person's name.

        Raises `NotConnectedError` if a line or the process is gone.
        """
        self._ready = False
        self._send(packed(Kind.ARM))
        self._await_ready(_ANSWER_S)

    def hold(self) -> None:
        """Begin the lease: from now on it needs the beat of the thread that calls this.

        Raises `NotConnectedError` if the lease has lapsed, or the process is gone.
        """
        self._receive(0.0)
        self._require_held_lines()
        self._held_by = threading.get_ident()
        self._send(packed(Kind.HOLD))

    def beat(self) -> None:
        """Report one more step of the control loop, which renews the lease; without a lease, do nothing.

        Raises `NotConnectedError` if the process is gone.
        """
        if self._held_by is None:
            return
        if self._held_by != threading.get_ident():
            raise ConfigError("supervisor: the beat must come from the thread that holds the lease, not from a timer")
        self._step += 1
        self._send(packed_beat(self._step))

    def release(self) -> None:
        """End the lease; allowed at any time, also twice."""
        if self._held_by is not None:
            self._held_by = None
            self._send(packed(Kind.RELEASE))

    def close(self) -> None:
        """Release all lines, and end the process; allowed twice."""
        self._socket.close()
        try:
            self._process.wait(_ANSWER_S)
        except subprocess.TimeoutExpired:
            # The closed socket ends a healthy supervisor; one that hangs holds the lines against the next search.
            self._process.kill()
            self._process.wait()
        self._starter.shutdown()

    def _write(self, number: int, data: bytes) -> None:
        self._receive(0.0)
        self._require_held_lines()
        for start in range(0, len(data), MAX_BYTES):
            self._send(packed(Kind.WRITE, data[start : start + MAX_BYTES], line=number))

    def _read(self, number: int, size: int, timeout_s: float) -> bytes:
        """Wait in slices, and beat in each: the wait has an end, and so it is a step of the control loop."""
        ends_s = time.monotonic() + timeout_s
        data = self._data[number]
        self._receive(0.0)
        while len(data) < size and (left_s := ends_s - time.monotonic()) > 0:
            if self._held_by == threading.get_ident():
                self.beat()
            self._receive(min(left_s, self._slice_s))
        taken = bytes(data[:size])
        del data[:size]
        return taken

    def _require_held_lines(self) -> None:
        if self._lapsed is not None:
            raise NotConnectedError(f"the supervisor released the devices: {self._lapsed}; a person must arm it again")

    def _await_ready(self, timeout_s: float) -> None:
        ends_s = time.monotonic() + timeout_s
        while not self._ready:
            left_s = ends_s - time.monotonic()
            if not left_s > 0:
                raise NotConnectedError(f"the supervisor did not answer within {timeout_s} s")
            self._receive(left_s)

    def _send(self, message: bytes) -> None:
        try:
            self._socket.sendall(message)
        except OSError as error:
            raise _gone(error) from None

    def _receive(self, timeout_s: float) -> None:
        """Read and process what has arrived, waiting at most that long for the first bytes."""
        ended = False
        try:
            for _ in range(_MAX_CHUNKS):
                if ended or not select.select([self._socket], [], [], timeout_s)[0]:
                    break
                data = self._socket.recv(_CHUNK)
                # Messages that came before the end are read first: they say why the supervisor ended.
                ended = not data
                self._received += data
                timeout_s = 0.0
        except (OSError, ValueError) as error:
            raise _gone(error) from None
        for kind, number, content in unpacked(self._received):
            if kind is Kind.DATA:
                self._data[number] += content
            elif kind is Kind.READY:
                self._ready = True
                self._lapsed = None
            elif kind is Kind.FAILED:
                raise NotConnectedError(content.decode(errors="replace"))
            else:
                self._lapsed = content.decode(errors="replace")
        if ended:
            raise _gone("its socket is closed")


class SupervisedPort:
    """A line that the supervisor holds, as a `markerseek.wire.Port`; `Supervisor.port` hands it out."""

    def __init__(self, *, write: Callable[[bytes], None], read: Callable[[int, float], bytes]) -> None:
        self._write = write
        self._read = read

    def write(self, data: bytes) -> None:
        """Send one message of the device; `NotConnectedError` once the supervisor has released the lines."""
        self._write(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to that many bytes, fewer (perhaps none) at the end of the timeout; the lease is renewed meanwhile."""
        return self._read(size, timeout_s)

    def close(self) -> None:
        """Nothing to do: the supervisor holds the line until it is closed itself."""


def _gone(reason: object) -> NotConnectedError:
    return NotConnectedError(f"the supervisor is gone ({reason}); check the devices, then start again")
