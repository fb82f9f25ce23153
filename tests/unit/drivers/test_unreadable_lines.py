"""Serial devices that answer what cannot be read, or in a manner of their own."""

from __future__ import annotations

import struct
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from markerseek.core import DeviceTimeoutError, NotConnectedError
from markerseek.drivers import (
    LaserBox,
    PicolasLaser,
)
from markerseek.emulators import ByteDevice, EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.wire import apt
from markerseek.wire.apt import AptFramer
from tests.emulated_lines import DirectPort
from tests.unit.drivers.kdc101_bench import kdc101_stage
from tests.unit.drivers.laserbox_bench import Bench as LaserBoxBench
from tests.unit.drivers.laserbox_bench import permit as laser_permit


class Altered:
    """A device whose answers reach the host altered."""

    def __init__(self, device: ByteDevice, alter: Callable[[bytes], bytes]) -> None:
        self._device = device
        self._alter = alter

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
def test_bytes_of_a_stage_that_cannot_be_read_are_no_silence(line: str) -> None:
    make, said = STAGE_LINES[line]
    clock = VirtualClock()
    port = DirectPort(device=make(), clock=clock)  # type: ignore[arg-type]
    with pytest.raises(DeviceTimeoutError, match=rf"gave no answer in 0\.3 s: .*{said}"):
        kdc101_stage(port=port, clock=clock)


@pytest.mark.parametrize("alter", [to_address(0), longer_status, lambda data: longer_status(data, more=14)])
@pytest.mark.parametrize("model", ["KDC101", "TDC001"])
def test_controller_that_answers_in_its_own_manner_is_understood(model: str, alter: Callable[[bytes], bytes]) -> None:
    """To address 0, or with a longer status."""
    clock = VirtualClock()
    port = DirectPort(device=Altered(emulated_stage(model=model), alter), clock=clock)
    assert kdc101_stage(port=port, clock=clock).move_to(7.3) == pytest.approx(7.3, abs=0.01)


def test_box_whose_lines_end_with_cr_lf_is_understood() -> None:
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
def test_bytes_of_a_laser_box_that_cannot_be_read_are_no_silence(line: str) -> None:
    make, said = LASER_LINES[line]
    clock = VirtualClock()
    port = DirectPort(device=make(), clock=clock)  # type: ignore[arg-type]
    with pytest.raises(NotConnectedError, match=rf"no answer to HELLO in time: .*{said}"):
        LaserBox(port=port, clock=clock)
    assert clock.now_s() < 4


@pytest.mark.parametrize(("says", "said"), [(b"0\r\n\r\n", r": 30 0d 0a 0d 0a "), (b"", "no byte came")])
def test_bytes_of_a_picolas_driver_that_cannot_be_read_are_no_silence(says: bytes, said: str) -> None:
    clock = VirtualClock()
    port = DirectPort(device=answers(says), clock=clock)  # type: ignore[arg-type]
    with pytest.raises(NotConnectedError, match=f"no answer to 'laseroff' in time: .*{said}"):
        PicolasLaser(port=port, clock=clock)
