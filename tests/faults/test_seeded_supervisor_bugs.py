"""Bugs seeded into the supervisor, each detected by its check; see `seeded_bugs`."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from markerseek.core import ConfigError
from markerseek.supervisor import Line, Supervisor
from tests.faults.seeding import Bug, caught, seeded

pytestmark = pytest.mark.real_time

SAFE_COMMAND = b"DISARM\n"
LEASE_S = 0.5
ROOT = Path(__file__).parents[2]
SOON_S = 3.0


class Far:
    """The far end of a line."""

    def __enter__(self) -> Far:
        self.fd, self.near = os.openpty()
        tty.setraw(self.near)
        self.line = Line(name="laser", path=os.ttyname(self.near), safe_command=SAFE_COMMAND)
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self.fd)
        os.close(self.near)

    def receives_safe_command(self, *, within_s: float = SOON_S) -> bool:
        data = b""
        ends_s = time.monotonic() + within_s
        while SAFE_COMMAND not in data:
            if not select.select([self.fd], [], [], max(ends_s - time.monotonic(), 0.0))[0]:
                return False
            data += os.read(self.fd, 4096)
        return True


HOLDER = """
import socket, struct, sys, time
control = socket.socket(fileno=int(sys.argv[1]))
control.sendall(struct.pack(">BBH", 0x48, 0, 0))
for step in range(1, 10**9):
    control.sendall(struct.pack(">BBHQ", 0x42, 0, 8, step))
    print(flush=True)
    time.sleep(0.01)
"""


@contextlib.contextmanager
def kept(far: Far) -> Iterator[subprocess.Popen[bytes]]:
    """A control process that holds and beats, and a supervisor with the bug that is seeded now, if any."""
    ours, theirs = socket.socketpair()
    orders = msgspec.json.encode({"lines": [far.line], "period_s": LEASE_S}).decode()
    command = [
        sys.executable,
        "-m",
        "tests.faults.test_seeded_supervisor_bugs",
        "supervisor",
        SEEDED[-1] if SEEDED else "",
        str(theirs.fileno()),
        orders,
    ]
    supervisor = subprocess.Popen(command, cwd=ROOT, pass_fds=[theirs.fileno()])
    theirs.close()
    select.select([ours], [], [], 60)
    control = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(ours.fileno())], pass_fds=[ours.fileno()], stdout=subprocess.PIPE
    )
    ours.close()
    assert control.stdout is not None
    for _ in range(10):
        control.stdout.readline()
    try:
        yield control
    finally:
        control.kill()
        control.wait()
        control.stdout.close()
        supervisor.kill()
        supervisor.wait()


def a_line_is_silenced_at_the_start() -> None:
    with Far() as far, kept(far):
        assert far.receives_safe_command()


def a_line_is_silenced_after_death() -> None:
    with Far() as far, kept(far) as control:
        far.receives_safe_command(within_s=0.1)
        control.kill()
        assert far.receives_safe_command()


def a_line_is_silenced_after_a_stop() -> None:
    with Far() as far, kept(far) as control:
        far.receives_safe_command(within_s=0.1)
        control.send_signal(signal.SIGSTOP)
        assert far.receives_safe_command()


def a_timer_cannot_stand_in_for_a_loop_that_hangs() -> None:
    with Far() as far, Supervisor(lines=[far.line], period_s=LEASE_S) as supervisor:
        assert far.receives_safe_command()
        over = threading.Event()

        def timer() -> None:
            while not over.wait(0.02):
                with contextlib.suppress(ConfigError):
                    supervisor.beat()

        thread = threading.Thread(target=timer)
        supervisor.hold()
        thread.start()
        received = far.receives_safe_command(within_s=5 * LEASE_S)
        over.set()
        thread.join()
        assert received


SUPERVISOR_BUGS = {
    "beat from a timer thread": Bug(
        where="supervisor.client:Supervisor.beat",
        old="if self._held_by != threading.get_ident():",
        new="if False:",
        check=a_timer_cannot_stand_in_for_a_loop_that_hangs,
    ),
    "lines left as they were found": Bug(
        where="supervisor.process:SupervisorProcess.__init__",
        old="line.release()",
        new="pass",
        check=a_line_is_silenced_at_the_start,
    ),
    "cleanup left to the control process": Bug(
        where="supervisor.process:SupervisorProcess.run",
        old='self._release_lines("the supervisor ends")',
        new="pass",
        check=a_line_is_silenced_after_death,
    ),
    "a lease that nobody looks at": Bug(
        where="supervisor.process:SupervisorProcess._turn",
        old="if ends_s is not None and self._lease.lapsed(now_s=now_s):",
        new="if False:",
        check=a_line_is_silenced_after_a_stop,
    ),
}

SEEDED: list[str] = []
"""Name of the bug that is in the code now; the supervisor's process gets it as an argument."""


@pytest.mark.parametrize("name", SUPERVISOR_BUGS)
def test_the_bug_is_caught_by_its_check(name: str) -> None:
    SEEDED.append(name)
    try:
        assert caught(SUPERVISOR_BUGS[name])
    finally:
        SEEDED.pop()


@pytest.mark.parametrize(
    "check", dict.fromkeys(bug.check for bug in SUPERVISOR_BUGS.values()), ids=lambda check: check.__name__
)
def test_the_check_has_nothing_to_say_about_sound_code(check: Callable[[], None]) -> None:
    check()


def main() -> None:
    """Be the supervisor that a check asks for, with a bug in it."""
    _, _, name, *arguments = sys.argv
    sys.argv = ["supervisor", *arguments]
    from markerseek.supervisor.__main__ import main as supervise

    with seeded(SUPERVISOR_BUGS[name]) if name else contextlib.nullcontext():
        sys.exit(supervise())


if __name__ == "__main__":
    main()
