"""The laser goes dark when the search dies or hangs: real processes and signals, the truth comes from the emulated box.

How soon is measured by hand, on a quiet machine: the real command by `python -m tests.faults.laser_off --kills 100`, a
bare control process by `python -m tests.faults.test_laser_off 100`. As a test it must only be far sooner than the
pulses would end.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from markerseek.drivers import SystemClock
from markerseek.emulators import PtyLine
from markerseek.emulators.laserbox import EmulatedLaserBox
from tests.faults import laser_off
from tests.unit.drivers.laserbox_bench import Lit

pytestmark = pytest.mark.real_time
pytest.importorskip("serial", reason="needs the extra devices")

PULSES, RATE_HZ = 1000, 100

CONTROL = """
import sys
from markerseek.core import Permit
from markerseek.drivers.clock import SystemClock
from markerseek.drivers.laserbox import LaserBox
from markerseek.files import Line
from markerseek.supervisor import Supervisor
from markerseek.wire import laserbox as wire

with Supervisor(lines=[Line(name="laser", path=sys.argv[1], safe_command=wire.encode(wire.Disarm()))]) as supervisor:
    clock = SystemClock(beat=supervisor.beat)
    box = LaserBox(port=supervisor.port("laser"), clock=clock, rate_hz=float(sys.argv[3]))
    supervisor.arm()
    supervisor.hold()
    print(supervisor.pid, flush=True)
    box.fire(Permit(token="a", angle_deg=0.0, pulses=int(sys.argv[2]), expires_s=clock.now_s() + 60))
"""


def measure(how: str) -> tuple[int, float]:
    """Pulses before the blow, and time from it to the last pulse after it in seconds (0 where there was none)."""
    clock = SystemClock()
    box = EmulatedLaserBox(world=Lit(), on_triggers=lambda _count: None)
    ended = threading.Event()
    with PtyLine(device=box, clock=clock) as line:

        def serve() -> None:
            while not ended.is_set():
                line.serve_once(wait_s=1e-3)

        serving = threading.Thread(target=serve)
        serving.start()
        control = subprocess.Popen(
            [sys.executable, "-c", CONTROL, line.path, str(PULSES), str(RATE_HZ)], stdout=subprocess.PIPE, text=True
        )
        try:
            assert control.stdout is not None
            supervisor = int(control.stdout.readline())
            while len(box.pulses) < 20:
                time.sleep(2e-3)
            if how == "both killed":
                os.kill(supervisor, signal.SIGKILL)
            control.send_signal(signal.SIGSTOP if how == "stopped" else signal.SIGKILL)
            struck_s = clock.now_s()
            time.sleep(1.0)
            before = sum(pulse.at_s <= struck_s for pulse in box.pulses)
            last_s = box.pulses[-1].at_s
            assert not box.permitted
        finally:
            control.kill()
            control.communicate()
            ended.set()
            serving.join()
    return before, max(0.0, last_s - struck_s)


@pytest.mark.parametrize("how", ["killed", "stopped", "both killed"])
def test_the_laser_is_dark_long_before_its_pulses_would_end(how: str) -> None:
    before, after_s = measure(how)
    assert 20 <= before < PULSES / 2
    assert after_s < 1.0


def test_the_real_command_s_laser_is_disarmed_soon_after_a_kill() -> None:
    pytest.importorskip("serial", reason="needs the extra devices")
    (blow,) = laser_off.measure(kills=1, seed=1, how=signal.SIGKILL, busy=0, lease_s=1.0)
    assert blow.after_s < 1.0
    assert blow.threads > 1


if __name__ == "__main__":
    for way in ("killed", "stopped", "both killed"):
        times_ms = sorted(1e3 * measure(way)[1] for _ in range(int(sys.argv[1])))
        sys.stdout.write(f"{way}: last pulse after {times_ms[0]:.1f} to {times_ms[-1]:.1f} ms, {len(times_ms)} times\n")
