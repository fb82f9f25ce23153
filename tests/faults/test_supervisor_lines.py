"""The supervisor's lines: what passes under the lease; how floods, nonsense, a pulled plug or its own death end."""

from __future__ import annotations

import errno
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from markerseek.core import ConfigError, DeviceError, MissingExtraError, NotConnectedError
from markerseek.files import Line
from markerseek.supervisor import Supervisor
from markerseek.supervisor.messages import MAX_BYTES, Kind, packed, packed_beat, step_of, unpacked
from tests.faults.pseudo_terminals import SOON_S, STOP, Device, gone

pytestmark = pytest.mark.real_time
serial = pytest.importorskip("serial")


def lines(laser: Device, stage: Device) -> list[Line]:
    return [
        Line(name="laser", path=laser.path, safe_command=b"DISARM*1234\n"),
        Line(name="stage", path=stage.path, safe_command=bytes.fromhex("65 04 01 02 50 01"), rtscts=True),
    ]


@pytest.fixture
def held(laser: Device, stage: Device) -> Iterator[Supervisor]:
    """A supervisor of two lines, whose first safe commands have come."""
    with Supervisor(lines=lines(laser, stage), period_s=0.4) as supervisor:
        laser.received(b"DISARM*1234\n")
        stage.received(STOP)
        yield supervisor


def test_bytes_go_both_ways(held: Supervisor, laser: Device, stage: Device) -> None:
    port = held.port("laser")
    port.write(b"HELLO*0000\n")
    assert laser.received(b"\n") == b"HELLO*0000\n"
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
    assert laser.received(b"\n") == b"x" * 3000 + b"\n"


def test_a_wait_of_a_port_renews_the_lease_and_silence_does_not(held: Supervisor, laser: Device, stage: Device) -> None:
    port = held.port("laser")
    held.hold()
    assert port.read(1, timeout_s=1.0) == b""
    assert laser.silent()
    port.write(b"?\n")
    assert laser.received(b"\n") == b"?\n"
    began_s = time.monotonic()
    assert laser.received(b"\n") == b"DISARM*1234\n"
    assert time.monotonic() - began_s > 0.1
    assert stage.received(STOP) == STOP


def test_after_a_lapse_nothing_is_written_until_it_is_armed_again(held: Supervisor, laser: Device) -> None:
    port = held.port("laser")
    held.hold()
    laser.received(b"DISARM*1234\n")
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
    assert laser.received(b"\n") == b"FIRE 2*0000\n"
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
    laser.received(b"DISARM*1234\n")


def test_a_flood_to_a_line_that_does_not_drain_ends_in_a_safe_command(held: Supervisor, laser: Device) -> None:
    port = held.port("laser")

    def flood() -> None:
        for _ in range(100):
            port.write(b"x" * 4000)
            port.read(1, timeout_s=0.01)

    with pytest.raises(NotConnectedError, match="more was written to the line 'laser' than it can carry"):
        flood()
    laser.received(b"DISARM*1234\n")


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
def test_nonsense_from_the_control_process_ends_it_in_a_safe_command(
    held: Supervisor, laser: Device, stage: Device, nonsense: bytes
) -> None:
    held._socket.sendall(nonsense)
    laser.received(b"DISARM*1234\n")
    stage.received(STOP)
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
    laser.received(b"DISARM*1234\n")
    held.port("laser").read(1, timeout_s=0.05)
    with pytest.raises(NotConnectedError, match="the line 'stage' is gone"):
        held.port("laser").write(b"x")
    with pytest.raises(NotConnectedError, match="it cannot be armed"):
        held.arm()


def test_a_line_that_another_program_holds_is_refused(held: Supervisor, laser: Device) -> None:
    with pytest.raises(NotConnectedError, match=r"cannot be opened \(another program holds it\)"):
        Supervisor(lines=[Line(name="laser", path=laser.path, safe_command=b"x")])
    with pytest.raises(NotConnectedError, match="/dev/nowhere cannot be opened"):
        Supervisor(lines=[Line(name="laser", path="/dev/nowhere", safe_command=b"x")])


def test_a_process_that_cannot_be_started_is_a_device_that_is_not_connected(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_given: object, **_named: object) -> None:
        raise OSError(errno.EAGAIN, "no more processes")

    monkeypatch.setattr("markerseek.supervisor.client.subprocess.Popen", refused)
    before = threading.active_count()
    with pytest.raises(NotConnectedError, match="its process cannot be started: no more processes; end other programs"):
        Supervisor(lines=[Line(name="laser", path="/dev/null", safe_command=b"x")])
    assert threading.active_count() == before


def test_a_missing_package_is_named_before_a_process_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(MissingExtraError, match=r"pyserial.*\[devices\]") as raised:
        Supervisor(lines=[Line(name="laser", path="/dev/null", safe_command=b"x")])
    assert raised.value.exit_code == 2


def test_lines_and_leases_that_protect_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="safe_command is empty"):
        Line(name="laser", path="/dev/null", safe_command=b"")
    with pytest.raises(ConfigError, match="baud is 0"):
        Line(name="laser", path="/dev/null", safe_command=b"x", baud=0)
    line = Line(name="laser", path="/dev/null", safe_command=b"x")
    with pytest.raises(ConfigError, match="period_s is 0"):
        Supervisor(lines=[line], period_s=0)
    with pytest.raises(ConfigError, match="each name once"):
        Supervisor(lines=[line, line])
    with pytest.raises(ConfigError, match="at least one"):
        Supervisor(lines=[])


def test_messages_survive_being_cut_anywhere() -> None:
    said = packed(Kind.WRITE, b"abc", line=1) + packed_beat(7) + packed(Kind.RELEASE)
    buffer = bytearray()
    heard = []
    for byte in said:
        buffer.append(byte)
        heard += list(unpacked(buffer))
    assert [(kind, line) for kind, line, _ in heard] == [(Kind.WRITE, 1), (Kind.BEAT, 0), (Kind.RELEASE, 0)]
    assert (heard[0][2], step_of(heard[1][2])) == (b"abc", 7)
    with pytest.raises(DeviceError, match="the limit is 4096"):
        packed(Kind.WRITE, bytes(MAX_BYTES + 1))


def test_a_port_that_nobody_holds_is_refused(held: Supervisor) -> None:
    with pytest.raises(ConfigError, match="no line 'camera'"):
        held.port("camera")
