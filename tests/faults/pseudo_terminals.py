"""The far end of a line of the supervisor as a pseudo-terminal, for tests in real processes.

Times are asserted generously, since a machine that runs tests is busy: ``python -m benchmarks.supervisor`` measures.
"""

from __future__ import annotations

import os
import select
import termios
import time
import tty
from pathlib import Path

SOON_S = 1.0
"""Generous: the promise is 10 ms after death, and the lease and 10 ms after a hang."""

STOP = bytes.fromhex("65 04 01 02 50 01")


class Device:
    """The far end of a pseudo-terminal, which records the bytes it receives."""

    def __init__(self) -> None:
        self.fd, self._near = os.openpty()
        tty.setraw(self._near, termios.TCSANOW)
        self.path = os.ttyname(self._near)

    def received(self, until: bytes, *, within_s: float = SOON_S) -> bytes:
        """Bytes received up to and including `until`; fails when they do not come."""
        ends_s = time.monotonic() + within_s
        data = b""
        while until not in data:
            left_s = ends_s - time.monotonic()
            assert left_s > 0, f"{until!r} did not come within {within_s} s, only {data!r}"
            if select.select([self.fd], [], [], left_s)[0]:
                data += os.read(self.fd, 4096)
        return data

    def silent(self, *, for_s: float = 0.05) -> bool:
        return not select.select([self.fd], [], [], for_s)[0]

    def close(self) -> None:
        for fd in (self.fd, self._near):
            try:
                os.close(fd)
            except OSError:
                continue


def gone(pid: int) -> bool:
    """Whether a process ends soon."""
    ends_s = time.monotonic() + 5
    while time.monotonic() < ends_s:
        try:
            if Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z":
                return True
        except FileNotFoundError:
            return True
        select.select([], [], [], 0.01)
    return False
