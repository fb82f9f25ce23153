"""Stages of one's own whose readings are in another unit, or of the other sign, than what they are asked for."""

from __future__ import annotations

import math

import pytest

from markerseek.core import DeviceError, Interval
from markerseek.drivers import StageRules, StageStatus, StandardStage
from markerseek.drivers._unit_doubt import unit_doubt
from markerseek.sim import VirtualClock


class Turning:
    """A stage that turns evenly, and reads and goes by its own scales."""

    def __init__(self, clock: VirtualClock, *, reads: float, goes: float, speed_deg_s: float, start_deg: float) -> None:
        self._clock = clock
        self._reads = reads
        self._goes = goes
        self._speed_deg_s = speed_deg_s
        self.at_deg = start_deg
        self._target_deg = start_deg
        self._then_s = clock.now_s()

    def _turn(self) -> None:
        now_s = self._clock.now_s()
        most_deg = self._speed_deg_s * (now_s - self._then_s)
        self.at_deg += max(-most_deg, min(most_deg, self._target_deg - self.at_deg))
        self._then_s = now_s

    def read(self) -> StageStatus:
        self._turn()
        return StageStatus(angle_deg=self._reads * self.at_deg, moving=self.at_deg != self._target_deg)

    def go(self, angle_deg: float) -> None:
        self._turn()
        self._target_deg = self._goes * angle_deg

    def stop(self) -> None:
        self._turn()
        self._target_deg = self.at_deg


RADIANS = math.pi / 180


@pytest.mark.parametrize(
    ("reads", "goes", "start_deg", "target_deg", "said"),
    [
        (RADIANS, 1.0, 0.0, 21.0, r"1/57\.3 x what was asked: one of read\(\) and go\(\) is in radians"),
        (RADIANS, 1.0, 9.0, -13.0, r"1/57\.3 x what was asked: one of read\(\) and go\(\) is in radians"),
        (1.0, RADIANS, 0.0, -17.0, r"1/57\.3 x what was asked: one of read\(\) and go\(\) is in radians"),
        (-RADIANS, 1.0, 0.0, 8.0, r"-1/57\.3 x what was asked: .* radians and the signs of read\(\) and go\(\) differ"),
        (1e-3, 1.0, 0.0, 30.0, r"1/1000 x what was asked"),
        (1000 * RADIANS, 1.0, 0.0, 12.0, r"the reading grows \d+ x or more as fast as was asked: are read\(\) and"),
        (1000.0, 1.0, 0.0, 4.0, r"left its travel range .* the reading grows \d+ x or more as fast as was asked"),
        (-1.0, 1.0, 0.0, 6.0, r"turn its wheel.*it turned the other way: .* the signs of read\(\) and go\(\) differ"),
        (1.0, -1.0, 0.0, -11.0, r"it turned the other way: .* the signs of read\(\) and go\(\) differ \(-1 x\)"),
        (-1.0, 1.0, 7.0, 19.0, r"the reading is -1 x what was asked: the signs of read\(\) and go\(\) differ"),
        (0.21, 1.0, 0.0, 19.0, r"look for an obstacle, or for another unit: the reading is 0\.2\d+ x what was asked"),
    ],
)
def test_a_reading_in_another_unit_or_of_the_other_sign_is_named(
    reads: float, goes: float, start_deg: float, target_deg: float, said: str
) -> None:
    clock = VirtualClock()
    made = Turning(clock, reads=reads, goes=goes, speed_deg_s=15.0, start_deg=start_deg)
    rules = StageRules(speed_deg_s=15.0, resolution_deg=0.01, unexpected_deg=0.5, unsteady_deg=0.5, begin_s=1.0)
    stage = StandardStage(made, clock=clock, travel=Interval(low_deg=-36.5, high_deg=36.5), rules=rules)
    with pytest.raises(DeviceError, match=said):
        stage.move_to(target_deg)


@pytest.mark.parametrize(
    ("asked_deg", "reading_deg"), [(5.0, 5.0), (5.0, 5.05), (5.0, 2.1), (0.0, 3.0), (3.0, 0.0), (5.0, -2.0)]
)
def test_a_reading_that_no_unit_explains_raises_no_doubt(asked_deg: float, reading_deg: float) -> None:
    assert unit_doubt(asked_deg, reading_deg) == ""


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (17.45, "17.45 x what was asked: read() is in mrad"),
        (57.2, "57.3 x what was asked: go() is in radians"),
        (60.0, "60 x what was asked: read() is in arcminutes"),
        (-1000.0, "-1000 x what was asked: one of read() and go() is in thousandths of a degree and the signs of"),
    ],
)
def test_a_factor_is_said_with_its_unit(factor: float, said: str) -> None:
    assert unit_doubt(4.9, 4.9 * factor).startswith(f"; the reading is {said}")
