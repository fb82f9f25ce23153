"""How soon a line hears its farewell: ``python -m benchmarks.supervisor [REPETITIONS]``.

A control process that does nothing but beat is killed, or stopped, again and again; the far end of the line notes when
the farewell comes. Promised (P2) are 10 ms after death, and the lease and 10 ms after a hang.
"""

from __future__ import annotations

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

from markerseek.supervisor import Line

LEASE_S = 0.1
FAREWELL = b"DISARM\n"
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


def release_s(number: signal.Signals, program: str) -> float:
    """Seconds from a signal to the control process until its line hears the farewell."""
    far, near = os.openpty()
    tty.setraw(near)
    ours, theirs = socket.socketpair()
    line = Line(name="laser", path=os.ttyname(near), farewell=FAREWELL)
    orders = msgspec.json.encode({"lines": [line], "period_s": LEASE_S}).decode()
    keeper = subprocess.Popen(
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
    began_s = time.monotonic()
    control.send_signal(number)
    _heard(far)
    ended_s = time.monotonic()
    control.kill()
    control.wait()
    control.stdout.close()
    keeper.wait()
    os.close(far)
    os.close(near)
    return ended_s - began_s


def _heard(far: int) -> None:
    data = b""
    while FAREWELL not in data:
        if not select.select([far], [], [], 60)[0]:
            raise TimeoutError("no farewell within a minute")
        data += os.read(far, 4096)


def main() -> None:
    """Measure, and print the distribution."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    print(f"milliseconds from the signal to the farewell, {repetitions} times each, lease {LEASE_S * 1e3:.0f} ms")
    for what, number, program in (
        ("SIGKILL, beating", signal.SIGKILL, BEATER),
        ("SIGKILL, flooding", signal.SIGKILL, FLOODER),
        ("SIGSTOP, beating", signal.SIGSTOP, BEATER),
    ):
        took_ms = sorted(release_s(number, program) * 1e3 for _ in range(repetitions))
        worst = ", ".join(f"{value:.1f}" for value in took_ms[-3:])
        print(f"{what:18} median {statistics.median(took_ms):6.2f}, the three longest {worst}")


if __name__ == "__main__":
    main()
