"""Turns in the dark while it follows, judged by the simulated truth: where the probe is, and what ends one."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import ConfigError, FollowPermit, Interval, LimitError, MarkerseekError, MoveError, StageReading
from markerseek.drivers.guided import GuidedStage
from markerseek.guard import State
from markerseek.scan.turning import turning_stage
from markerseek.sim import SimulatedStage, StageMotion
from tests.sizes import examples
from tests.unit.scan.sweep_bench import Fast, SweepBench

PERMIT = FollowPermit(
    angles=Interval(low_deg=-35.0, high_deg=35.0), speed_deg_s=5.0, duration_s=600.0, pulses=4, pulses_per_second=8
)


def following(kind: type[SimulatedStage] = SimulatedStage, **motion: float) -> SweepBench:
    """A bench that follows, with such a stage, from 0 deg on."""
    stage = structs.replace(StageMotion(speed_deg_s=12.5, acceleration_deg_s2=25.0), **motion)
    bench = SweepBench(motion=stage, start_deg=0.0)
    bench.stage.__class__ = kind
    bench.scanner.begin_following(PERMIT, by="a test")
    return bench


def turned(
    bench: SweepBench, to_deg: float, *, speed_deg_s: float = 5.0, goes_on: Callable[[], bool] = lambda: True
) -> float:
    """Turn, and return the angle at rest; the angles on the way lead there."""
    turning = bench.scanner.turn_to(to_deg, speed_deg_s=speed_deg_s, goes_on=goes_on)
    while True:
        try:
            assert next(turning) == pytest.approx(bench.world.angle_deg, abs=0.002)
        except StopIteration as end:
            return float(end.value)


def turn(bench: SweepBench, to_deg: float, *, speed_deg_s: float = 5.0) -> float:
    """Turn there, and return the duration."""
    began_s = bench.scanner.clock.now_s()
    reached_deg = turned(bench, to_deg, speed_deg_s=speed_deg_s)
    assert reached_deg == pytest.approx(to_deg, abs=0.002)
    return bench.scanner.clock.now_s() - began_s


@pytest.mark.parametrize(
    ("way_deg", "speed_deg_s", "takes_s"),
    # Rest to rest with 25 deg/s²: way/v + v/a where the speed is reached, else 2·sqrt(way/a).
    [(5.0, 5.0, 1.2), (2.0, 5.0, 0.6), (0.25, 5.0, 0.2), (4.0, 2.0, 2.08), (-4.9, 5.0, 1.2)],
)
def test_a_turn_keeps_its_speed(way_deg: float, speed_deg_s: float, takes_s: float) -> None:
    bench = following()
    # A few readings more, 50 ms apart: the last ones show that it is at rest.
    assert 0 <= turn(bench, way_deg, speed_deg_s=speed_deg_s) - takes_s <= 0.25
    assert bench.scanner.guard.state is State.FOLLOWING


@settings(deadline=None, max_examples=examples(40))
@given(st.lists(st.floats(-5, 5), min_size=1, max_size=6), st.floats(0.0, 0.3))
def test_the_probe_is_where_the_turn_says_whatever_the_backlash(ways_deg: list[float], backlash_deg: float) -> None:
    bench = following(backlash_deg=backlash_deg)
    for way_deg in ways_deg:
        before_deg = bench.world.angle_deg
        to_deg = min(max(before_deg + 0.9 * way_deg, -34.0), 34.0)
        if abs(to_deg - before_deg) < 0.2:
            continue
        turn(bench, to_deg)
        # By half a count of the encoder, and by what two readings at rest may differ.
        assert bench.world.angle_deg == pytest.approx(to_deg, abs=0.01)
        assert bench.scanner.probe_deg == pytest.approx(bench.world.angle_deg, abs=1e-3)
    assert bench.flashes() == []


def test_a_turn_is_broken_off_where_it_can_brake() -> None:
    bench = following()
    asked = iter([True] * 5 + [False] * 1000)
    reached_deg = turned(bench, 4.0, goes_on=lambda: next(asked))
    # Asked at 0.05 s apart: 0.2 s of running up over 0.5 deg, then 5 deg/s, then 0.5 deg of braking.
    assert 1.0 < reached_deg < 2.2
    assert bench.world.angle_deg == pytest.approx(reached_deg, abs=0.01)
    assert bench.scanner.guard.state is State.FOLLOWING
    turn(bench, reached_deg - 2.0)


def test_a_turn_that_is_closed_early_stops_the_rig() -> None:
    bench = following()
    turning = bench.scanner.turn_to(4.0, speed_deg_s=5.0)
    for _ in range(6):
        next(turning)
    turning.close()
    assert bench.scanner.guard.state is State.DISARMED
    here_deg = bench.stage.angle_deg
    bench.scanner.clock.wait(1.0)
    # 5 deg/s at 25 deg/s²: half a degree of braking.
    assert bench.stage.angle_deg == pytest.approx(here_deg + 0.5, abs=0.01)
    bench.scanner.clock.wait(1.0)
    assert bench.stage.angle_deg == pytest.approx(here_deg + 0.5, abs=0.01)


def test_pulses_come_at_rest_and_the_sample_has_the_angle_of_the_probe() -> None:
    bench = following()
    turn(bench, 4.0)
    turn(bench, 2.0)
    sample = bench.scanner.look(4)
    assert sample.angle_deg == pytest.approx(bench.world.angle_deg, abs=0.002)
    assert sample.angle_deg == pytest.approx(2.0, abs=0.002)
    assert sample.frame is not None
    assert sample.frame.header.angle_after_deg == pytest.approx(1.9, abs=0.002)
    assert [flash.pulses for flash in bench.flashes()] == [4]
    with pytest.raises(LimitError, match="5 pulses at once"):
        bench.scanner.look(5)


class Stalling(SimulatedStage):
    """Stops on its way."""

    def read_sweep(self) -> StageReading:
        reading = super().read_sweep()
        if reading.angle_deg > 1.0:
            self.brake()
        return reading


class Frozen(SimulatedStage):
    """Does not begin to turn."""

    def begin_sweep(self, to_deg: float) -> None:
        self._sweep_to_deg = self.angle_deg
        self._legs = [self._leg(self.angle_deg, 0.0)]


class Unstoppable(SimulatedStage):
    """Ignores a brake while it turns."""

    def brake(self) -> None:
        pass


class Wild(SimulatedStage):
    """Reads back no number."""

    def read_sweep(self) -> StageReading:
        return structs.replace(super().read_sweep(), angle_deg=math.nan)


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        (Stalling, "the stage stands at 1."),
        (Frozen, "the stage stands at 0.000 deg on its way to 4.000 deg; look for an obstacle"),
        (Fast, "outside the permitted turn from 0.00 to 4.00 deg"),
        (Wild, "outside its travel range"),
    ],
)
def test_a_stage_that_does_not_do_its_part_ends_in_a_fault(kind: type[SimulatedStage], said: str) -> None:
    bench = following(kind)
    with pytest.raises(MarkerseekError) as refusal:
        list(bench.scanner.turn_to(4.0, speed_deg_s=5.0))
    assert said in str(refusal.value)
    assert bench.scanner.guard.state is State.FAULT
    with pytest.raises(LimitError, match="a person must reset it"):
        list(bench.scanner.turn_to(4.0, speed_deg_s=5.0))


def test_a_stage_that_does_not_brake_ends_in_a_fault() -> None:
    bench = following(Unstoppable)
    with pytest.raises(MoveError, match="the stage does not stop"):
        turned(bench, 5.0, speed_deg_s=2.0, goes_on=lambda: bench.scanner.clock.now_s() < 0.3)
    assert bench.scanner.guard.state is State.FAULT


def test_what_is_refused_moves_nothing() -> None:
    bench = following()
    for to_deg, said in ((6.0, "the longest while it follows is 5 deg"), (math.nan, "outside"), (35.5, "outside")):
        with pytest.raises(LimitError, match=said):
            list(bench.scanner.turn_to(to_deg, speed_deg_s=5.0))
    assert bench.world.angle_deg == 0.0
    assert bench.scanner.guard.state is State.FOLLOWING
    bench.scanner.end_following()
    with pytest.raises(LimitError, match="armed, not allowed to turn"):
        list(bench.scanner.turn_to(1.0, speed_deg_s=5.0))


def test_a_rig_that_cannot_follow_says_so() -> None:
    bench = SweepBench(start_deg=0.0)
    with pytest.raises(ConfigError) as refusal:
        bench.scanner.begin_following(structs.replace(PERMIT, speed_deg_s=13.0), by="a test")
    said = "follow permit: speed_deg_s is 13 deg/s, this stage turns with at most 12.5 deg/s"
    assert str(refusal.value) == said
    by_hand = object.__new__(GuidedStage)
    with pytest.raises(ConfigError, match=r"this rig cannot follow: its stage .* does not report where it is"):
        turning_stage(by_hand)
