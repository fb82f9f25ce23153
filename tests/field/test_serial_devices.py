"""Serial devices as field reports describe them: bytes that cannot be read, boards that restart, a disabled channel."""

from __future__ import annotations

import errno
import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
import serial

from markerseek.core import DeviceTimeoutError, MoveError, NotConnectedError
from markerseek.drivers import (
    Kdc101Settings,
    LaserBox,
    PicolasLaser,
    SerialPort,
)
from markerseek.drivers.kdc101 import ENTRY
from markerseek.emulators import ByteDevice, EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.rigs import read_rig_file
from markerseek.rigs.bench_rig import bench
from markerseek.sim import VirtualClock
from markerseek.wire import apt
from markerseek.wire.apt import AptFramer
from tests.emulated import emulation
from tests.emulated_lines import DirectPort
from tests.unit.drivers.kdc101_bench import bench as kdc101_bench
from tests.unit.drivers.kdc101_bench import kdc101_stage
from tests.unit.drivers.laserbox_bench import Bench as LaserBoxBench
from tests.unit.drivers.laserbox_bench import permit as laser_permit

Shell = Callable[..., tuple[int, str, str]]


class Altered:
    """A device whose answers reach the host altered."""

    def __init__(self, device: ByteDevice, alter: Callable[[bytes], bytes]) -> None:
        self._device, self._alter = device, alter

    def advance(self, now_s: float) -> bytes:
        return self._alter(self._device.advance(now_s))

    def feed(self, data: bytes) -> bytes:
        return self._alter(self._device.feed(data))


def answers(say: bytes) -> Callable[[bytes], bytes]:
    """What answers every question with the same bytes."""

    class Answering:
        def advance(self, _now_s: float) -> bytes:
            return b""

        def feed(self, _data: bytes) -> bytes:
            return say

    return Answering()  # type: ignore[return-value]


def to_address(address: int) -> Callable[[bytes], bytes]:
    """Messages with data go to another address than the host's."""

    def alter(data: bytes) -> bytes:
        return b"".join(
            each.raw[:4] + bytes([0x80 | address if each.data else each.raw[4]]) + each.raw[5:]
            for each in AptFramer().feed(data)
        )

    return alter


def longer_status(data: bytes, more: int = 6) -> bytes:
    """As a later firmware may send it, with more bytes."""
    said = b""
    for each in AptFramer().feed(data):
        longer = struct.pack("<HH", each.ident, len(each.data) + more) + each.raw[4:] + bytes(more)
        said += longer if each.ident == apt.STATUS else each.raw
    return said


def emulated_stage(**settings: object) -> Kdc101Emulator:
    return Kdc101Emulator(probe=SimpleNamespace(angle_deg=0.0), settings=EmulatedKdc101(**settings))  # type: ignore[arg-type]


STAGE_LINES: dict[str, tuple[Callable[[], object], str]] = {
    "answers to another address": (
        lambda: Altered(emulated_stage(), to_address(0x11)),
        r"bytes came .*: 06 00 54 00 91 ",
    ),
    "a status of another form": (
        lambda: Altered(emulated_stage(), lambda data: longer_status(data, more=7)),
        r"bytes came .*: 91 04 15 00 81 50",
    ),
    "a damaged line": (lambda: answers(b"ERR FORM*1234\n"), r"bytes came .*: 45 52 52 20 46 .*\('ERR FORM\*1234\.ER'"),
    "the laser box": (lambda: LaserBoxBench().box, "a laser box answers there: the ports of stage and laser are exch"),
    "text of a board": (lambda: answers(b"ets Jul 29 2019 12:21:46\r\n"), r"\('ets Jul 29 2019 '\)"),
    "half a message": (lambda: answers(bytes.fromhex("06 00 54 00 81 50 01")), r": 06 00 54 00 81 50 01"),
    "silence": (lambda: answers(b""), r"no byte came; check its cable and its power, and that stage\.port is its port"),
}


@pytest.mark.parametrize("line", STAGE_LINES)
def test_c_bytes_of_a_stage_that_cannot_be_read_are_no_silence(line: str) -> None:
    make, said = STAGE_LINES[line]
    clock = VirtualClock()
    port = DirectPort(device=make(), clock=clock)  # type: ignore[arg-type]
    with pytest.raises(DeviceTimeoutError, match=rf"gave no answer in 0\.3 s: .*{said}"):
        kdc101_stage(port=port, clock=clock)


@pytest.mark.parametrize("alter", [to_address(0), longer_status, lambda data: longer_status(data, more=14)])
@pytest.mark.parametrize("model", ["KDC101", "TDC001"])
def test_a_controller_that_answers_in_its_own_manner_is_understood(model: str, alter: Callable[[bytes], bytes]) -> None:
    """To address 0, or with a longer status."""
    clock = VirtualClock()
    port = DirectPort(device=Altered(emulated_stage(model=model), alter), clock=clock)
    assert kdc101_stage(port=port, clock=clock).move_to(7.3) == pytest.approx(7.3, abs=0.01)


def test_a_box_whose_lines_end_with_cr_lf_is_understood() -> None:
    it = LaserBoxBench()
    port = DirectPort(device=Altered(it.box, lambda data: data.replace(b"\n", b"\r\n")), clock=it.clock)
    assert LaserBox(port=port, clock=it.clock).fire(laser_permit("a")) == 16


LASER_LINES: dict[str, tuple[Callable[[], object], str]] = {
    "boot text alone": (lambda: answers(b"rst:0x1 (POWERON_RESET)\r\n"), r"bytes came .*\('rst:0x1 \(POWERON'\)"),
    "a line that never ends": (lambda: answers(b"\xff"), r"bytes came that are no answer, the first: ff ff"),
    "the stage": (emulated_stage, "the KDC101 of a stage answers there: the ports of stage and laser are ex"),
    "half a message of a stage": (
        lambda: answers(bytes.fromhex("64 04 0e 00 81 50")),
        r": 64 04 0e 00 81 50 .*stage and laser exchanged",
    ),
    "silence": (lambda: answers(b""), r"no byte came; check its cable and its power, and that laser\.port is its port"),
}


@pytest.mark.parametrize("line", LASER_LINES)
def test_c_bytes_of_a_laser_box_that_cannot_be_read_are_no_silence(line: str) -> None:
    make, said = LASER_LINES[line]
    clock = VirtualClock()
    port = DirectPort(device=make(), clock=clock)  # type: ignore[arg-type]
    with pytest.raises(NotConnectedError, match=rf"no answer to HELLO in time: .*{said}"):
        LaserBox(port=port, clock=clock)
    assert clock.now_s() < 4


@pytest.mark.parametrize(("says", "said"), [(b"0\r\n\r\n", r": 30 0d 0a 0d 0a "), (b"", "no byte came")])
def test_c_bytes_of_a_picolas_driver_that_cannot_be_read_are_no_silence(says: bytes, said: str) -> None:
    clock = VirtualClock()
    port = DirectPort(device=answers(says), clock=clock)  # type: ignore[arg-type]
    with pytest.raises(NotConnectedError, match=f"no answer to 'laseroff' in time: .*{said}"):
        PicolasLaser(port=port, clock=clock)


@pytest.mark.parametrize("boot_s", [0.7, 1.0, 2.0])
@pytest.mark.parametrize("keeps", [False, True])
def test_c_a_box_that_restarts_when_its_port_is_opened_is_greeted_again(boot_s: float, keeps: bool) -> None:
    """One that keeps what came while it was deaf answers each HELLO, and none of these answers is taken for another."""
    box = LaserBoxBench()
    box.faults.inject("restart", 0.0 if keeps else boot_s)
    kept = bytearray()

    class Keeping:
        def advance(self, now_s: float) -> bytes:
            said = box.box.advance(now_s)
            if kept and now_s >= boot_s:
                said += box.box.feed(bytes(kept))
                kept.clear()
            return said

        def feed(self, data: bytes) -> bytes:
            if box.clock.now_s() < boot_s:
                kept.extend(data)
                return b"boot\r\n"
            return box.box.feed(data)

    port = DirectPort(device=Keeping() if keeps else box.box, clock=box.clock)
    laser = LaserBox(port=port, clock=box.clock)
    assert box.clock.now_s() < boot_s + 1
    for token in ("a", "b"):
        box.clock.wait(1.0)
        assert laser.fire(laser_permit(token)) == 16
    assert len(box.box.pulses) == 32


def test_c_a_box_that_stays_deaf_is_given_up_in_time() -> None:
    box = LaserBoxBench()
    box.faults.inject("restart", 60.0)
    with pytest.raises(NotConnectedError, match=r"no answer to HELLO in time: .*bytes came .*\('MicroPython v1\.2"):
        box.driver()
    assert 2.5 < box.clock.now_s() < 4


@pytest.mark.parametrize("model", ["KDC101", "TDC001"])
def test_c_a_channel_that_is_disabled_since_power_up_is_said_and_enabled_at_a_persons_word(model: str) -> None:
    stage_bench = kdc101_bench(enabled=False, model=model)
    stage = stage_bench.stage()
    assert "channel is disabled" in ENTRY.describe(Kdc101Settings(port="/dev/x", zero_deg=0.0), stage)
    with pytest.raises(MoveError, match=r"did not begin to move .*channel is disabled, .*: arming the rig enables it"):
        stage.move_to(5.0)
    assert stage_bench.probe.angle_deg == 0.0
    # Some controllers do not say whether it is enabled.
    stage_bench.port.swallowed = 0x0211
    stage.logic.enable()
    assert stage.move_to(5.0) == pytest.approx(5.0, abs=0.02)
    assert "disabled" not in ENTRY.describe(Kdc101Settings(port="/dev/x", zero_deg=0.0), stage)


def test_c_a_channel_that_stays_disabled_is_said() -> None:
    stage_bench = kdc101_bench(enabled=False)
    stage = stage_bench.stage()
    stage_bench.port.swallowed = 0x0210
    with pytest.raises(MoveError, match="does not keep its channel enabled"):
        stage.logic.enable()


def test_c_an_obstacle_is_still_an_obstacle() -> None:
    stage_bench = kdc101_bench()
    stage_bench.emulator.faults.inject("frozen motor")
    with pytest.raises(MoveError, match="look for an obstacle"):
        stage_bench.stage().move_to(5.0)


@pytest.mark.real_time
def test_c_a_disabled_channel_is_named_by_the_rig_and_enabled_when_it_is_armed(tmp_path: Path) -> None:
    made = "from markerseek.emulators import EmulatedKdc101 as made; made.__init__.__kwdefaults__['enabled'] = False"
    with emulation(tmp_path, before=made) as devices, bench(read_rig_file(devices.rig)) as rig:
        assert "its channel is disabled" in rig.facts.description
        with pytest.raises(MoveError, match="its channel is disabled"):
            rig.stage.move_to(2.0)
        rig.arm(by="a person")
        assert rig.stage.move_to(2.0) == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize(("group", "named"), [("uucp", "uucp"), (None, "dialout"), ("root", "dialout")])
def test_c_a_port_that_may_not_be_opened_names_the_group(
    monkeypatch: pytest.MonkeyPatch, group: str | None, named: str
) -> None:
    def refuse(**_arguments: object) -> None:
        raise serial.SerialException(errno.EACCES, "could not open port: Permission denied")

    def group_of(_path: Path) -> str:
        if group is None:
            raise KeyError("no name")
        return group

    monkeypatch.setattr(serial, "Serial", refuse)
    monkeypatch.setattr(Path, "group", group_of)
    with pytest.raises(NotConnectedError, match=rf"Permission denied.*usermod -aG {named} \$USER, then log out and in"):
        SerialPort("/dev/ttyUSB0")


@pytest.mark.parametrize("as_link", [False, True])
def test_c_one_path_for_two_devices_is_wrong_usage(tmp_path: Path, shell: Shell, as_link: bool) -> None:
    port, name = tmp_path / "ttyUSB0", tmp_path / "by-id"
    port.touch()
    name.symlink_to(port)
    rig = tmp_path / "rig.toml"
    rig.write_text(
        f'kind = "bench"\n[stage]\nport = "{port}"\nzero_deg = 0.0\n[laser]\nport = "{name if as_link else port}"\n'
        f'[receiver]\nfolder = "{tmp_path}"\n'
    )
    code, _, said = shell("search", "--rig", rig, "--arm")
    assert code == 2
    said = " ".join(said.split())
    assert "laser and stage have one serial port" in said
    assert "each device has its own" in said
