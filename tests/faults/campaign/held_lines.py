"""The supervisor's real process, holding one line: the laser's commands pass through it, and the far end is read."""

from __future__ import annotations

import os
import select
import time
import tty
from types import TracebackType
from typing import Self

from markerseek.core import Permit
from markerseek.files import Line
from markerseek.supervisor import Supervisor

SAFE_COMMAND = b"DISARM\n"
RECEIVE_TIMEOUT_S = 10.0


class HeldLines:
    """A supervisor for a campaign; it is also the watchdog of its runs, and is armed again for each.

    ``period_s``: its lease, in seconds of real time; without it none is held, since the campaign runs on virtual time,
    and a busy computer takes as long as it needs.
    """

    def __init__(self, *, period_s: float | None = None) -> None:
        self._fd, self._near = os.openpty()
        tty.setraw(self._near)
        line = Line(name="laser", path=os.ttyname(self._near), safe_command=SAFE_COMMAND)
        self._leased = period_s is not None
        self._supervisor = Supervisor(lines=[line], period_s=period_s or 1.0)
        self._port = self._supervisor.port("laser")
        self._sent_permits = 0
        self.received = b""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._supervisor.close()
        os.close(self._fd)
        os.close(self._near)

    def begin(self) -> None:
        """Arm it, as a person does."""
        self._supervisor.arm()
        while select.select([self._fd], [], [], 0)[0]:
            os.read(self._fd, 65536)
        self._sent_permits = 0
        self.received = b""

    def hold(self) -> None:
        if self._leased:
            self._supervisor.hold()

    def release(self) -> None:
        if self._leased:
            self._supervisor.release()

    def send_permit(self, permit: Permit) -> None:
        """Send a permit, as a laser driver does first."""
        self._port.write(f"PERMIT {permit.token} {permit.pulses}\n".encode())
        self._sent_permits += 1

    def end(self) -> tuple[tuple[str, int], ...]:
        """Token and pulses of each permit received at the far end."""
        ends_s = time.monotonic() + RECEIVE_TIMEOUT_S
        while self.received.count(b"PERMIT") < self._sent_permits or not self.received.endswith((b"\n", b"")):
            left_s = ends_s - time.monotonic()
            if not left_s > 0 or not select.select([self._fd], [], [], left_s)[0]:
                break
            self.received += os.read(self._fd, 65536)
        words = [line.split() for line in self.received.decode().splitlines() if line.startswith("PERMIT")]
        return tuple((token, int(pulses)) for _, token, pulses in words)

    def receives_safe_command(self, *, within_s: float) -> bool:
        """Whether the far end receives the safe command within `within_s` of real time."""
        ends_s = time.monotonic() + within_s
        while SAFE_COMMAND not in self.received:
            left_s = ends_s - time.monotonic()
            if not left_s > 0 or not select.select([self._fd], [], [], left_s)[0]:
                return False
            self.received += os.read(self._fd, 65536)
        return True
