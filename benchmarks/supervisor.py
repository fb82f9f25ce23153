"""How soon a line receives its safe command: ``python -m benchmarks.supervisor [REPETITIONS]``.

A control process that does nothing but beat is killed, or stopped, again and again; the far end of the line notes when
the safe command comes. Promised (P2) are 10 ms after death, and the lease and 10 ms after a hang.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import statistics
import subprocess
import sys
import time
import tty

import msgspec

from markerseek.files import Line

LEASE_S = 0.1
SAFE_COMMAND = b"DISARM\n"
BEATER = """
import socket, struct, sys, time
control = socket.socket(fileno=int(sys.argv[1]))
control.sendall(struct.pack(">BBH", 0x48, 0, 0))
step = 0
while True:
    step += 1
    control.sendall(struct.pack(">BBHQ", 0x42, 0, 8, step))
    print(flush=True)
    time.sleep(0.01)
"""
FLOODER = BEATER.replace("    print(flush=True)\n    time.sleep(0.01)\n", "    step % 1000 or print(flush=True)\n")


def release_s(number: signal.Signals, program: str) -> tuple[float, float]:
    """Seconds from a signal to the control process until its line receives the safe command, and from its death on.

    A killed process dies when the system gives it a turn to; the socket closes just before it is dead for others.
    """
    far, near = os.openpty()
    tty.setraw(near)
    ours, theirs = socket.socketpair()
    line = Line(name="laser", path=os.ttyname(near), safe_command=SAFE_COMMAND)
    orders = msgspec.json.encode({"lines": [line], "period_s": LEASE_S}).decode()
    supervisor = subprocess.Popen(
        [sys.executable, "-m", "markerseek.supervisor", str(theirs.fileno()), orders], pass_fds=[theirs.fileno()]
    )
    _heard(far)
    control = subprocess.Popen(
        [sys.executable, "-c", program, str(ours.fileno())], pass_fds=[ours.fileno()], stdout=subprocess.PIPE
    )
    ours.close()
    theirs.close()
    assert control.stdout is not None
    for _ in range(20):
        control.stdout.readline()
    death = os.pidfd_open(control.pid)
    began_s = time.monotonic()
    control.send_signal(number)
    happened_s: dict[int, float] = {}
    data = b""
    while far not in happened_s or (number == signal.SIGKILL and death not in happened_s):
        for fd in select.select([far, death][: 2 if death not in happened_s else 1], [], [], 60)[0]:
            if fd == far:
                data += os.read(far, 4096)
            if fd == death or SAFE_COMMAND in data:
                happened_s.setdefault(fd, time.monotonic())
    os.close(death)
    control.kill()
    control.wait()
    control.stdout.close()
    supervisor.wait()
    os.close(far)
    os.close(near)
    return happened_s[far] - began_s, happened_s[far] - happened_s.get(death, began_s)


def _heard(far: int) -> None:
    data = b""
    while SAFE_COMMAND not in data:
        if not select.select([far], [], [], 60)[0]:
            raise TimeoutError("no safe command within a minute")
        data += os.read(far, 4096)


def main() -> None:
    """Measure, and print the distribution."""
    # The clock of this measurement must not wait for a turn either.
    with contextlib.suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(2))
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    print(f"milliseconds from the signal to the safe command, {repetitions} times each, lease {LEASE_S * 1e3:.0f} ms")
    for what, number, program in (
        ("SIGKILL, beating", signal.SIGKILL, BEATER),
        ("SIGKILL, flooding", signal.SIGKILL, FLOODER),
        ("SIGSTOP, beating", signal.SIGSTOP, BEATER),
    ):
        pairs = [release_s(number, program) for _ in range(repetitions)]
        print(f"{what}: from the signal {_spread([since for since, _ in pairs])}")
        if number == signal.SIGKILL:
            print(f"{'':{len(what)}}  from the death {_spread([since for _, since in pairs])}")


def _spread(took_s: list[float]) -> str:
    took_ms = sorted(value * 1e3 for value in took_s)
    longest = ", ".join(f"{value:.2f}" for value in took_ms[-3:])
    return f"median {statistics.median(took_ms):.2f}, the three longest {longest}"


if __name__ == "__main__":
    main()
