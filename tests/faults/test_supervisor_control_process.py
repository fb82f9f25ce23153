"""The supervisor in real processes: whatever becomes of the control process, the lines hear their farewell."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from pseudo_terminals import SOON_S, STOP, Device, gone

pytestmark = pytest.mark.real_time
serial = pytest.importorskip("serial")

CONTROL = """
import os, sys, time
from markerseek.supervisor import Line, Supervisor
laser, stage, phase = sys.argv[1:]
lines = [Line(name="laser", path=laser, farewell=b"DISARM*1234\\n"),
         Line(name="stage", path=stage, farewell=bytes.fromhex("65 04 01 02 50 01"))]
with Supervisor(lines=lines, period_s=0.2) as supervisor:
    port = supervisor.port("laser")
    if phase not in ("idle", "forked"):
        supervisor.hold()
    port.write(b"READY\\n")
    print(supervisor.pid, flush=True)
    if phase == "forked":
        child = os.fork()
        if child == 0:
            time.sleep(60)
        print(child, flush=True)
    step = 0
    while phase != "hang" or step < 20:
        step += 1
        if phase == "flood":
            supervisor.beat()
            continue
        port.write(b".") if phase == "firing" else None
        supervisor.beat()
        time.sleep(0.01)
    while True:
        pass
"""


@dataclass
class Control:
    """A control process, its supervisor's number, and its end."""

    process: subprocess.Popen[str]
    supervisor_pid: int


@pytest.fixture
def control(request: pytest.FixtureRequest, laser: Device, stage: Device) -> Iterator[Control]:
    """A control process in the phase that the test names."""
    process = subprocess.Popen(
        [sys.executable, "-c", CONTROL, laser.path, stage.path, request.param], stdout=subprocess.PIPE, text=True
    )
    try:
        laser.heard(b"READY\n", within_s=60)
        stage.heard(STOP)
        assert process.stdout is not None
        yield Control(process=process, supervisor_pid=int(process.stdout.readline()))
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@pytest.mark.parametrize("control", ["idle", "moving", "firing", "flood"], indirect=True)
def test_after_sigkill_of_the_control_process_every_line_hears_its_farewell(
    control: Control, laser: Device, stage: Device
) -> None:
    control.process.kill()
    laser.heard(b"DISARM*1234\n")
    stage.heard(STOP)
    assert gone(control.supervisor_pid)


@pytest.mark.parametrize("control", ["forked"], indirect=True)
def test_a_child_that_keeps_the_socket_open_does_not_keep_the_lines(
    control: Control, laser: Device, stage: Device
) -> None:
    assert control.process.stdout is not None
    child = int(control.process.stdout.readline())
    control.process.kill()
    laser.heard(b"DISARM*1234\n", within_s=0.5 + SOON_S)
    stage.heard(STOP)
    assert gone(control.supervisor_pid)
    os.kill(child, signal.SIGKILL)


@pytest.mark.parametrize("control", ["moving", "firing"], indirect=True)
def test_after_sigstop_the_lease_ends_and_nothing_passes_when_the_process_goes_on(
    control: Control, laser: Device, stage: Device
) -> None:
    control.process.send_signal(signal.SIGSTOP)
    laser.heard(b"DISARM*1234\n", within_s=0.2 + SOON_S)
    stage.heard(STOP)
    control.process.send_signal(signal.SIGCONT)
    # What it tries to write next is refused, and ends it; the end is one more farewell.
    rest = laser.heard(b"DISARM*1234\n", within_s=5) if control.process.args[-1] == "firing" else b"DISARM*1234\n"  # type: ignore[index]
    assert rest == b"DISARM*1234\n"


@pytest.mark.parametrize("control", ["hang"], indirect=True)
def test_a_control_loop_that_hangs_at_full_speed_lets_the_lease_end(
    control: Control, laser: Device, stage: Device
) -> None:
    laser.heard(b"DISARM*1234\n", within_s=2 + SOON_S)
    stage.heard(STOP)
    assert control.process.poll() is None


@pytest.mark.parametrize("control", ["idle"], indirect=True)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_supervisor_that_is_told_to_end_says_farewell_first(
    control: Control, laser: Device, stage: Device, number: signal.Signals
) -> None:
    os.kill(control.supervisor_pid, number)
    laser.heard(b"DISARM*1234\n")
    stage.heard(STOP)
    assert gone(control.supervisor_pid)


@pytest.mark.parametrize("control", ["moving"], indirect=True)
def test_ctrl_c_does_not_reach_the_supervisor_before_the_control_process(control: Control) -> None:
    assert os.getpgid(control.supervisor_pid) != os.getpgid(control.process.pid)
    assert os.getsid(control.supervisor_pid) != os.getsid(control.process.pid)
