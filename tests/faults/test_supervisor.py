"""The supervisor in real processes, on pseudo-terminals: whatever becomes of the control process, lines hear farewell.

Times are asserted generously, since a machine that runs tests is busy: ``python -m benchmarks.supervisor`` measures.
"""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from markerseek.core import ConfigError, DeviceError, NotConnectedError
from markerseek.supervisor import Line, Supervisor
from markerseek.supervisor.messages import MOST_BYTES, Kind, packed, packed_step, step_of, unpacked

pytestmark = pytest.mark.real_time
serial = pytest.importorskip("serial")

SOON_S = 1.0
"""Generous: the promise is 10 ms after death, and the lease and 10 ms after a hang."""


class Device:
    """The far end of a pseudo-terminal, which records what it is told."""

    def __init__(self) -> None:
        self.fd, self._near = os.openpty()
        tty.setraw(self._near, termios.TCSANOW)
        self.path = os.ttyname(self._near)

    def heard(self, until: bytes, *, within_s: float = SOON_S) -> bytes:
        """What it is told up to and with some bytes; fails when they do not come."""
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


@pytest.fixture
def laser() -> Iterator[Device]:
    device = Device()
    yield device
    device.close()


@pytest.fixture
def stage() -> Iterator[Device]:
    device = Device()
    yield device
    device.close()


def lines(laser: Device, stage: Device) -> list[Line]:
    return [
        Line(name="laser", path=laser.path, farewell=b"DISARM*1234\n"),
        Line(name="stage", path=stage.path, farewell=bytes.fromhex("65 04 01 02 50 01"), rtscts=True),
    ]


STOP = bytes.fromhex("65 04 01 02 50 01")


@pytest.fixture
def held(laser: Device, stage: Device) -> Iterator[Supervisor]:
    """A supervisor of two lines, whose first farewells have come."""
    with Supervisor(lines=lines(laser, stage), period_s=0.4) as supervisor:
        laser.heard(b"DISARM*1234\n")
        stage.heard(STOP)
        yield supervisor


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


def test_bytes_go_both_ways(held: Supervisor, laser: Device, stage: Device) -> None:
    port = held.port("laser")
    port.write(b"HELLO*0000\n")
    assert laser.heard(b"\n") == b"HELLO*0000\n"
    os.write(laser.fd, b"OK\n")
    os.write(stage.fd, bytes(range(256)))
    assert port.read(2, timeout_s=SOON_S) == b"OK"
    assert port.read(9, timeout_s=0.01) == b"\n"
    assert port.read(1, timeout_s=0.0) == b""
    assert held.port("stage").read(256, timeout_s=SOON_S) == bytes(range(256))
    port.close()
    port.close()


def test_a_long_message_arrives_whole(held: Supervisor, laser: Device) -> None:
    held.port("laser").write(b"x" * 3000 + b"\n")
    assert laser.heard(b"\n") == b"x" * 3000 + b"\n"


def test_a_wait_of_a_port_renews_the_lease_and_silence_does_not(held: Supervisor, laser: Device, stage: Device) -> None:
    port = held.port("laser")
    held.hold()
    assert port.read(1, timeout_s=1.0) == b""
    assert laser.silent()
    port.write(b"?\n")
    assert laser.heard(b"\n") == b"?\n"
    began_s = time.monotonic()
    assert laser.heard(b"\n") == b"DISARM*1234\n"
    assert time.monotonic() - began_s > 0.1
    assert stage.heard(STOP) == STOP


def test_after_a_lapse_nothing_is_written_until_it_is_armed_again(held: Supervisor, laser: Device) -> None:
    port = held.port("laser")
    held.hold()
    laser.heard(b"DISARM*1234\n")
    held.port("stage").read(1, timeout_s=0.1)
    with pytest.raises(NotConnectedError, match=r"longer than the lease of .*; a person must arm it again"):
        port.write(b"FIRE 1*0000\n")
    with pytest.raises(NotConnectedError, match="a person must arm it again"):
        held.hold()
    assert laser.silent()
    os.write(laser.fd, b"still heard\n")
    assert port.read(12, timeout_s=SOON_S) == b"still heard\n"
    held.arm()
    port.write(b"FIRE 2*0000\n")
    assert laser.heard(b"\n") == b"FIRE 2*0000\n"
    held.hold()
    held.release()
    held.release()
    assert laser.silent(for_s=0.6)


def test_the_beat_of_another_thread_is_refused(held: Supervisor, laser: Device) -> None:
    held.beat()
    held.hold()
    errors: list[Exception] = []

    def timer() -> None:
        try:
            held.beat()
        except ConfigError as error:
            errors.append(error)

    thread = threading.Thread(target=timer)
    thread.start()
    thread.join()
    assert "not from a timer" in str(errors[0])
    laser.heard(b"DISARM*1234\n")


def test_a_flood_to_a_line_that_does_not_drain_ends_in_a_farewell(held: Supervisor, laser: Device) -> None:
    port = held.port("laser")

    def flood() -> None:
        for _ in range(100):
            port.write(b"x" * 4000)
            port.read(1, timeout_s=0.01)

    with pytest.raises(NotConnectedError, match="more was written to the line 'laser' than it can carry"):
        flood()
    laser.heard(b"DISARM*1234\n")


@pytest.mark.parametrize(
    "nonsense",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        packed(Kind.DATA, b"x"),
        packed(Kind.WRITE, b"x", line=7),
        packed(Kind.BEAT, b"123"),
        b"\x57\x00\xff\xff",
    ],
)
def test_nonsense_from_the_control_process_ends_it_in_a_farewell(
    held: Supervisor, laser: Device, stage: Device, nonsense: bytes
) -> None:
    held._socket.sendall(nonsense)
    laser.heard(b"DISARM*1234\n")
    stage.heard(STOP)
    assert gone(held.pid)
    with pytest.raises(NotConnectedError, match="the supervisor is gone"):
        held.port("laser").read(1, timeout_s=SOON_S)


def test_a_supervisor_that_is_killed_is_noticed_and_what_remains_is_the_devices_own_lease(
    held: Supervisor, laser: Device
) -> None:
    os.kill(held.pid, signal.SIGKILL)
    assert gone(held.pid)
    assert laser.silent()
    for refused in (
        lambda: held.port("laser").write(b"x"),
        lambda: held.port("laser").read(1, timeout_s=SOON_S),
        held.hold,
        held.arm,
    ):
        with pytest.raises(NotConnectedError, match="the supervisor is gone"):
            refused()


def test_a_supervisor_that_hangs_does_not_hang_the_control_process(held: Supervisor) -> None:
    os.kill(held.pid, signal.SIGSTOP)
    port = held.port("laser")

    def go_on() -> None:
        for _ in range(10_000):
            port.write(b"x" * 4000)

    with pytest.raises(NotConnectedError, match="the supervisor is gone"):
        go_on()
    held.close()
    assert gone(held.pid)


def test_a_device_that_floods_does_not_hang_the_control_process(held: Supervisor, laser: Device) -> None:
    over = threading.Event()
    os.set_blocking(laser.fd, False)

    def flood() -> None:
        while not over.is_set():
            if select.select([], [laser.fd], [], 0.05)[1]:
                os.write(laser.fd, b"x" * 256)

    thread = threading.Thread(target=flood)
    thread.start()
    began_s = time.monotonic()
    try:
        held.hold()
        read = held.port("laser").read(10**9, timeout_s=0.5)
        held.release()
        held.port("stage").write(b"?")
    finally:
        over.set()
        thread.join()
    assert set(read) == {ord("x")}
    assert time.monotonic() - began_s < 0.5 + SOON_S


def test_a_line_that_is_pulled_out_silences_the_other_and_cannot_be_armed(
    held: Supervisor, laser: Device, stage: Device
) -> None:
    stage.close()
    laser.heard(b"DISARM*1234\n")
    held.port("laser").read(1, timeout_s=0.05)
    with pytest.raises(NotConnectedError, match="the line 'stage' is gone"):
        held.port("laser").write(b"x")
    with pytest.raises(NotConnectedError, match="it cannot be armed"):
        held.arm()


def test_a_line_that_another_program_holds_is_refused(held: Supervisor, laser: Device) -> None:
    with pytest.raises(NotConnectedError, match="cannot be opened"):
        Supervisor(lines=[Line(name="laser", path=laser.path, farewell=b"x")])
    with pytest.raises(NotConnectedError, match="/dev/nowhere cannot be opened"):
        Supervisor(lines=[Line(name="laser", path="/dev/nowhere", farewell=b"x")])


def test_lines_and_leases_that_protect_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="farewell is empty"):
        Line(name="laser", path="/dev/null", farewell=b"")
    with pytest.raises(ConfigError, match="baud is 0"):
        Line(name="laser", path="/dev/null", farewell=b"x", baud=0)
    line = Line(name="laser", path="/dev/null", farewell=b"x")
    with pytest.raises(ConfigError, match="period_s is 0"):
        Supervisor(lines=[line], period_s=0)
    with pytest.raises(ConfigError, match="each name once"):
        Supervisor(lines=[line, line])
    with pytest.raises(ConfigError, match="at least one"):
        Supervisor(lines=[])


def test_messages_survive_being_cut_anywhere() -> None:
    said = packed(Kind.WRITE, b"abc", line=1) + packed_step(Kind.BEAT, 7) + packed(Kind.RELEASE)
    buffer = bytearray()
    heard = []
    for byte in said:
        buffer.append(byte)
        heard += list(unpacked(buffer))
    assert [(kind, line) for kind, line, _ in heard] == [(Kind.WRITE, 1), (Kind.BEAT, 0), (Kind.RELEASE, 0)]
    assert (heard[0][2], step_of(heard[1][2])) == (b"abc", 7)
    with pytest.raises(DeviceError, match="the limit is 4096"):
        packed(Kind.WRITE, bytes(MOST_BYTES + 1))


def test_a_port_that_nobody_holds_is_refused(held: Supervisor) -> None:
    with pytest.raises(ConfigError, match="no line 'camera'"):
        held.port("camera")
