"""The supervisor's real process, holding one line: what the laser is told goes through it, and the far end is heard."""

from __future__ import annotations

import os
import select
import time
import tty
from types import TracebackType
from typing import Self

from markerseek.core import Permit
from markerseek.supervisor import Line, Supervisor

SAFE_COMMAND = b"DISARM\n"
HEARD_S = 10.0


class HeldLines:
    """A supervisor for a campaign; it is also the dead man of its runs, and is armed anew for each."""

    def __init__(self, *, period_s: float = 1.0) -> None:
        self._fd, self._near = os.openpty()
        tty.setraw(self._near)
        line = Line(name="laser", path=os.ttyname(self._near), safe_command=SAFE_COMMAND)
        self._supervisor = Supervisor(lines=[line], period_s=period_s)
        self._port = self._supervisor.port("laser")
        self._told = 0
        self.heard = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._supervisor.close()
        os.close(self._fd)
        os.close(self._near)

    def begin(self) -> None:
        """A person arms it."""
        self._supervisor.arm()
        while select.select([self._fd], [], [], 0)[0]:
            os.read(self._fd, 65536)
        self._told = 0
        self.heard = b""

    def hold(self) -> None:
        self._supervisor.hold()

    def release(self) -> None:
        self._supervisor.release()

    def tell_permit(self, permit: Permit) -> None:
        """What a laser driver does first."""
        self._port.write(f"PERMIT {permit.token} {permit.pulses}\n".encode())
        self._told += 1

    def end(self) -> tuple[tuple[str, int], ...]:
        """Token and pulses of each permit that came out at the far end."""
        ends_s = time.monotonic() + HEARD_S
        while self.heard.count(b"PERMIT") < self._told or not self.heard.endswith((b"\n", b"")):
            left_s = ends_s - time.monotonic()
            if not left_s > 0 or not select.select([self._fd], [], [], left_s)[0]:
                break
            self.heard += os.read(self._fd, 65536)
        words = [line.split() for line in self.heard.decode().splitlines() if line.startswith("PERMIT")]
        return tuple((token, int(pulses)) for _, token, pulses in words)

    def receives_safe_command(self, *, within_s: float) -> bool:
        """Whether the far end receives the safe command within that much real time."""
        ends_s = time.monotonic() + within_s
        while SAFE_COMMAND not in self.heard:
            left_s = ends_s - time.monotonic()
            if not left_s > 0 or not select.select([self._fd], [], [], left_s)[0]:
                return False
            self.heard += os.read(self._fd, 65536)
        return True
