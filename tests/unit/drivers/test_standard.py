"""What StandardLaser makes of the verbs of a device, in virtual time; stages and receivers by their own drivers."""

from __future__ import annotations

import importlib
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from markerseek.contract import LaserContract
from markerseek.core import DeviceError, DeviceTimeoutError, Laser, LaserError
from markerseek.drivers import StandardLaser
from markerseek.drivers.standard_laser import LaserLogic
from markerseek.sim import VirtualClock
from tests.emulated_lines import permit


@dataclass
class Lamp:
    """A laser that fires at once, and what can be wrong with it."""

    said: list[str] = field(default_factory=list)
    fires: int | None = None
    breaks: bool = False
    pulses: int = 0

    def fire(self, pulses: int) -> None:
        self.said.append(f"fire {pulses}")
        if self.breaks:
            raise LaserError("its lamp broke")
        self.pulses = pulses if self.fires is None else self.fires

    def fired(self) -> int | None:
        return None if self.pulses < 0 else self.pulses

    def off(self) -> None:
        self.said.append("off")


def laser(**wrong: object) -> tuple[StandardLaser[Lamp], Lamp]:
    lamp = Lamp(**wrong)  # type: ignore[arg-type]
    return StandardLaser(lamp, clock=VirtualClock(), rate_hz=100.0, name="lamp"), lamp


class TestStandardLaser(LaserContract):
    def make(self) -> Laser:
        return laser()[0]


@pytest.mark.parametrize(
    ("wrong", "error", "said"),
    [
        ({"fires": 5}, LaserError, "lamp: 4 pulses were permitted and 5 fired"),
        ({"fires": -1}, DeviceTimeoutError, "lamp: the end of the pulses was not confirmed within 1 s"),
        ({"breaks": True}, LaserError, "its lamp broke"),
    ],
    ids=str,
)
def test_whatever_a_laser_does_it_is_off_and_its_permit_is_used(
    wrong: dict[str, object], error: type[DeviceError], said: str
) -> None:
    made, lamp = laser(**wrong)
    with pytest.raises(error, match=said):
        made.fire(permit())
    assert lamp.said == ["fire 4", "off"]
    with pytest.raises(LaserError, match="used before; nothing was fired"):
        made.fire(permit())
    assert lamp.said == ["fire 4", "off"]


def test_a_permit_that_ends_before_its_pulses_fires_nothing() -> None:
    made, lamp = laser()
    with pytest.raises(LaserError, match=r"good for 0\.03 s more and its pulses take 0\.04 s; nothing was fired"):
        made.fire(permit(expires_s=0.03))
    assert lamp.said == []


class Box:
    """The other end of the template's line: it counts lit and dark triggers."""

    def __init__(self) -> None:
        self.said: list[str] = []
        self._answers = b""
        self._lit = 0

    def write(self, data: bytes) -> None:
        command, *words = data.decode().split()
        self.said.append(data.decode().strip())
        if command == "FIRE":
            self._lit = int(words[0])
        self._answers += (str(self._lit) if command == "COUNT?" else "OK").encode() + b"\n"

    def read(self, size: int, *, timeout_s: float) -> bytes:
        data = self._answers[:size]
        self._answers = self._answers[size:]
        return data

    def close(self) -> None:
        pass


def test_the_template_of_a_laser_triggers_the_receiver_in_the_dark(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "examples" / "plugin"))
    clock = VirtualClock()
    box = Box()
    logic = importlib.import_module("toy_laser").Laser(line=box, clock=clock, pulses=7, rate_hz=20.0)
    made: StandardLaser[LaserLogic] = StandardLaser(logic, clock=clock, rate_hz=20.0, name="toy")
    assert [made.fire(permit("a", pulses=3)), made.fire(permit("b", pulses=0))] == [3, 0]
    assert [each for each in box.said if each.startswith("FIRE")] == ["FIRE 3 0", "FIRE 0 7"]
    assert box.said[0] == "RATE 20"
    assert box.said[-1] == "OFF"
