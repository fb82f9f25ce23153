"""The supervisor in real processes: however the control process ends, each line receives its safe command."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from base64 import b64encode
from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from markerseek.files import Line
from markerseek.supervisor import Supervisor
from markerseek.supervisor.process import end_with_parent
from tests.faults.pseudo_terminals import SOON_S, STOP, Device, gone

pytestmark = pytest.mark.real_time
serial = pytest.importorskip("serial")

CONTROL = """
import os, sys, time
from markerseek.files import Line
from markerseek.supervisor import Supervisor
laser, stage, phase = sys.argv[1:]
lines = [Line(name="laser", path=laser, safe_command=b"DISARM*1234\\n"),
         Line(name="stage", path=stage, safe_command=bytes.fromhex("65 04 01 02 50 01"))]
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
        laser.received(b"READY\n", within_s=60)
        stage.received(STOP)
        assert process.stdout is not None
        yield Control(process=process, supervisor_pid=int(process.stdout.readline()))
    finally:
        process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


@pytest.mark.parametrize("control", ["idle", "moving", "firing", "flood"], indirect=True)
def test_after_sigkill_of_the_control_process_every_line_receives_its_safe_command(
    control: Control, laser: Device, stage: Device
) -> None:
    control.process.kill()
    laser.received(b"DISARM*1234\n")
    stage.received(STOP)
    assert gone(control.supervisor_pid)


@pytest.mark.parametrize("control", ["forked"], indirect=True)
def test_a_child_that_keeps_the_socket_open_does_not_keep_the_lines(
    control: Control, laser: Device, stage: Device
) -> None:
    assert control.process.stdout is not None
    child = int(control.process.stdout.readline())
    control.process.kill()
    laser.received(b"DISARM*1234\n", within_s=0.5 + SOON_S)
    stage.received(STOP)
    assert gone(control.supervisor_pid)
    os.kill(child, signal.SIGKILL)


@pytest.mark.parametrize("control", ["moving", "firing"], indirect=True)
def test_after_sigstop_the_lease_ends_and_nothing_passes_when_the_process_goes_on(
    control: Control, laser: Device, stage: Device
) -> None:
    control.process.send_signal(signal.SIGSTOP)
    laser.received(b"DISARM*1234\n", within_s=0.2 + SOON_S)
    stage.received(STOP)
    control.process.send_signal(signal.SIGCONT)
    # What it tries to write next is refused, and ends it; the end is one more safe command.
    rest = laser.received(b"DISARM*1234\n", within_s=5) if control.process.args[-1] == "firing" else b"DISARM*1234\n"  # type: ignore[index]
    assert rest == b"DISARM*1234\n"


@pytest.mark.parametrize("control", ["hang"], indirect=True)
def test_a_control_loop_that_hangs_at_full_speed_lets_the_lease_end(
    control: Control, laser: Device, stage: Device
) -> None:
    laser.received(b"DISARM*1234\n", within_s=2 + SOON_S)
    stage.received(STOP)
    assert control.process.poll() is None


@pytest.mark.parametrize("control", ["idle"], indirect=True)
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_supervisor_that_is_told_to_end_says_safe_command_first(
    control: Control, laser: Device, stage: Device, number: signal.Signals
) -> None:
    os.kill(control.supervisor_pid, number)
    laser.received(b"DISARM*1234\n")
    stage.received(STOP)
    assert gone(control.supervisor_pid)


@pytest.mark.parametrize("control", ["moving"], indirect=True)
def test_ctrl_c_does_not_reach_the_supervisor_before_the_control_process(control: Control) -> None:
    assert os.getpgid(control.supervisor_pid) != os.getpgid(control.process.pid)
    assert os.getsid(control.supervisor_pid) != os.getsid(control.process.pid)


def test_a_supervisor_whose_parent_died_before_it_could_ask_for_its_signal_ends_at_once(laser: Device) -> None:
    ours, theirs = socket.socketpair()
    lines = [{"name": "laser", "path": laser.path, "safe_command": b64encode(b"DISARM*1234\n").decode()}]
    orders = json.dumps({"lines": lines, "period_s": 0.2, "parent": os.getpid() + 1_000_000_000})
    with ours, theirs:
        command = [sys.executable, "-P", "-m", "markerseek.supervisor", str(theirs.fileno()), orders]
        process = subprocess.Popen(command, pass_fds=[theirs.fileno()])
        assert process.wait(timeout=60) == 0
    laser.received(b"DISARM*1234\n" * 2)


def test_a_supervisor_outlives_the_thread_that_made_it(laser: Device) -> None:
    made: list[Supervisor] = []
    line = Line(name="laser", path=laser.path, safe_command=b"DISARM*1234\n")
    thread = threading.Thread(target=lambda: made.append(Supervisor(lines=[line])))
    thread.start()
    thread.join()
    with made[0] as supervisor:
        laser.received(line.safe_command)
        supervisor.arm()
        supervisor.port("laser").write(b"still there")
        laser.received(b"still there")


SLEEPER = """
import signal
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])  # before a library starts threads
from markerseek.supervisor.process import end_with_parent
print(end_with_parent(), flush=True)
signal.sigwait([signal.SIGTERM])
print("signalled", flush=True)
"""
PARENT = "import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', sys.argv[1]]); time.sleep(600)"


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone announces a parent's death by a signal")
def test_the_system_announces_the_death_of_the_parent() -> None:
    parent = subprocess.Popen([sys.executable, "-c", PARENT, SLEEPER], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    assert parent.stdout.readline() == "True\n"
    parent.kill()
    assert parent.stdout.readline() == "signalled\n"
    parent.wait()
    parent.stdout.close()


def test_where_the_system_announces_no_death_the_socket_remains(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("markerseek.supervisor.process.sys.platform", "darwin")
    assert not end_with_parent()
