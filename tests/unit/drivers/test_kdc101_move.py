"""Moves of the stage's driver: target, side of approach, speed, and never outside its travel."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.drivers import StageRules
from markerseek.drivers.standard_stage import DOWN, UP, plan_approach
from markerseek.emulators._kdc101_motion import Motor
from markerseek.sim import StageMotion
from tests.unit.drivers.kdc101_bench import TRAVEL, bench


def test_it_never_homes_and_never_jogs() -> None:
    rig = bench()
    stage = rig.stage()
    for target in (-35.0, 35.0, -36.4, 0.0):
        stage.move_to(target)
    stage.stop()
    assert set(rig.port.said) == {0x0012, 0x0005, 0x0490, 0x0413, 0x0414, 0x043A, 0x043B, 0x0423, 0x0424} | {
        0x0450,
        0x0451,
        0x0453,
        0x0465,
        0x0523,
        0x0524,
    }


def test_an_approach_that_had_to_be_reversed_is_marked() -> None:
    rig = bench(play_deg=0.4)
    stage = rig.stage()
    reached = stage.move_to(-36.2)
    assert stage.approach_reversed
    assert rig.probe.angle_deg == pytest.approx(reached + 0.4, abs=1e-9)
    reached = stage.move_to(-35.4)
    assert not stage.approach_reversed
    assert rig.probe.angle_deg == pytest.approx(reached, abs=1e-9)


@given(
    target=st.floats(-36.5, 36.5),
    here=st.floats(-36.5, 36.5),
    pushed=st.sampled_from([UP, DOWN, None]),
    usual=st.sampled_from([UP, DOWN]),
)
def test_the_last_way_takes_up_the_play_and_stays_inside(
    target: float, here: float, pushed: int | None, usual: int
) -> None:
    plan = plan_approach(target, here_deg=here, pushed=pushed, usual=usual, room_deg=1.0, travel=TRAVEL, same_deg=5e-4)
    assert all(stop in TRAVEL for stop in plan.stops_deg)
    places = (here, *plan.stops_deg)
    if plan.stops_deg:
        assert plan.stops_deg[-1] == target
        last = plan.direction * (places[-1] - places[-2])
        assert last >= 0
        assert last >= 1.0 - 1e-12 or (pushed == plan.direction and len(places) == 2)
    else:
        assert abs(target - here) <= 5e-4
        assert pushed == plan.direction
    assert plan.reversed == (plan.direction != usual)
    assert plan.reversed == (target - usual * 1.0 not in TRAVEL)


def test_a_renewed_target_costs_little_time_and_is_never_far_ahead() -> None:
    rig = bench(start_deg=-35.0)
    stage = rig.stage(approach_deg=0.5)
    stage.move_to(-34.0)
    moves, began_s = rig.emulator.moves, rig.clock.now_s()
    stage.move_to(35.0)
    took_s = rig.clock.now_s() - began_s
    single_s = StageMotion(speed_deg_s=10.0, acceleration_deg_s2=10.0).duration_s(69.0)
    assert rig.emulator.moves == moves + 1  # it stood nowhere in between
    assert single_s < took_s < single_s + 0.6
    assert rig.emulator.largest_lead_deg <= 5.0


def test_unsolicited_updates_do_no_harm() -> None:
    rig = bench(talking=True)
    rig.let_be(0.35)
    stage = rig.stage()
    assert stage.move_to(7.0) == pytest.approx(7.0, abs=1e-3)


@given(speed=st.floats(0.1, 25), acceleration=st.floats(0.1, 25), duration_s=st.floats(0, 20))
def test_no_motor_of_its_speed_and_acceleration_gets_further(
    speed: float, acceleration: float, duration_s: float
) -> None:
    """Against the emulated motor, whose speed is integrated phase by phase."""
    rules = StageRules(speed_deg_s=speed, acceleration_deg_s2=acceleration, resolution_deg=1e-3)
    motor = Motor(angle_deg=0.0, target_deg=1e6, top_speed_deg_s=speed, acceleration_deg_s2=acceleration)
    motor.advance(duration_s)
    assert rules.reach_deg(duration_s) == pytest.approx(1.25 * motor.angle_deg, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("speed_deg_s", "acceleration_deg_s2"), [(0.1, 0.1024), (25.0, 25.0), (25.0, 0.1024), (1.0, 10.0)]
)
def test_a_sound_stage_is_never_too_fast_however_it_is_set(speed_deg_s: float, acceleration_deg_s2: float) -> None:
    """An acceleration of 0.1024 is rounded to a word that is a third more."""
    rig = bench()
    stage = rig.stage(speed_deg_s=speed_deg_s, acceleration_deg_s2=acceleration_deg_s2)
    for target in (-1.0, 1.0, 1.02, 1.3):
        assert stage.move_to(target) == pytest.approx(target, abs=1e-3)
