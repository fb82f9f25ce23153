"""An encoder that jumps in mid-move, at random moments, both ways: refused; and sound stages on any line: believed."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from markerseek.core import MoveError
from markerseek.drivers import Kdc101Settings, Kdc101Stage
from markerseek.emulators import EmulatedKdc101
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import VirtualClock
from markerseek.wire import apt
from tests.emulated_lines import DirectPort, FaultyLine

RUNS = 25


class StruckClock(VirtualClock):
    """Does something once, at a moment within a wait."""

    def __init__(self) -> None:
        super().__init__()
        self.strikes_s = math.inf
        self.strike = lambda: None

    def wait(self, duration_s: float) -> None:
        ends_s = self.now_s() + duration_s
        if self.now_s() <= self.strikes_s < ends_s:
            super().wait(self.strikes_s - self.now_s())
            self.strikes_s = math.inf
            self.strike()
        super().wait(max(0.0, ends_s - self.now_s()))


class Tour:
    """One move from somewhere to somewhere, of a stage that approaches from below or above."""

    def __init__(self, number: int, *, late_s: tuple[float, float] = (0.0, 0.0)) -> None:
        rng = np.random.Generator(np.random.PCG64(number))
        start_deg, self.target_deg = rng.uniform(-34, 34, 2).tolist()
        self.moment = float(rng.uniform())
        self.clock = StruckClock()
        self.probe = SimpleNamespace(angle_deg=start_deg)
        self.emulator = Kdc101Emulator(probe=self.probe, settings=EmulatedKdc101(play_deg=0.0))
        port = DirectPort(device=self.emulator, clock=self.clock, line=FaultyLine(late_s=late_s, seed=number))
        self.settings = Kdc101Settings(
            port="",
            zero_deg=0.0,
            speed_deg_s=10.0,
            acceleration_deg_s2=10.0,
            approach_from="above" if number % 2 else "below",
        )
        self.stage = Kdc101Stage(port=port, clock=self.clock, settings=self.settings)
        self.heading: float | None = None

    def duration_s(self) -> float:
        began_s = self.clock.now_s()
        assert self.stage.move_to(self.target_deg) == pytest.approx(self.target_deg, abs=0.01)
        return self.clock.now_s() - began_s

    def refusal(self, jump_deg: float, *, within_s: float) -> MoveError | None:
        """What is said when the counter jumps against the heading (negative) or with it, once it turns."""

        def jump() -> None:
            self.emulator.advance(self.clock.now_s())
            motor = self.emulator._stage.motor
            if not motor.at_rest:
                self.heading = math.copysign(1.0, motor.speed_deg_s or motor.target_deg - motor.angle_deg)
                self.emulator._stage.offset += round(self.heading * jump_deg * apt.COUNTS_PER_DEG)

        self.clock.strikes_s = self.clock.now_s() + self.moment * within_s
        self.clock.strike = jump
        try:
            self.stage.move_to(self.target_deg)
        except MoveError as refusal:
            return refusal
        return None


def detected(jump_deg: float, *, runs: int, late_s: tuple[float, float] = (0.0, 0.0)) -> list[bool]:
    """Whether each of so many jumps of a turning stage was refused."""
    refused: list[bool] = []
    number = 0
    while len(refused) < runs:
        within_s = Tour(number, late_s=late_s).duration_s()
        tour = Tour(number, late_s=late_s)
        refusal = tour.refusal(jump_deg, within_s=within_s)
        if tour.heading is not None:
            refused.append(refusal is not None)
        low_deg, high_deg = tour.emulator.truth_range_deg
        assert low_deg >= -36.5
        assert high_deg <= 36.5
        number += 1
    return refused


@pytest.mark.parametrize("jump_deg", [-1.0, -0.2, 0.2, 1.0])
def test_a_counter_that_jumps_in_mid_move_is_refused(jump_deg: float) -> None:
    assert all(detected(jump_deg, runs=RUNS))


@pytest.mark.parametrize("jump_deg", [-0.5, 0.5])
def test_so_it_is_on_a_line_with_a_latency_of_some_milliseconds(jump_deg: float) -> None:
    assert all(detected(jump_deg, runs=RUNS, late_s=(0.001, 0.005)))
