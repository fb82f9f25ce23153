"""The emulated stage by itself: moves, power-up, homing, stops and messages."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.emulators._kdc101_motion import Motor
from markerseek.sim import StageMotion
from tests.sizes import examples


@given(
    distance=st.floats(-80, 80).filter(lambda distance: abs(distance) > 1e-3),
    speed=st.floats(1, 25),
    acceleration=st.floats(1, 25),
)
def test_a_move_takes_the_time_of_a_trapezoid(distance: float, speed: float, acceleration: float) -> None:
    motor = Motor(angle_deg=3.0, target_deg=3.0 + distance, top_speed_deg_s=speed, acceleration_deg_s2=acceleration)
    takes_s = StageMotion(speed_deg_s=speed, acceleration_deg_s2=acceleration).duration_s(distance)
    motor.advance(0.999 * takes_s)
    assert not motor.at_rest
    motor.advance(0.002 * takes_s)
    assert motor.at_rest
    assert motor.angle_deg == 3.0 + distance


@settings(max_examples=examples(50))
@given(
    targets=st.lists(st.tuples(st.floats(-40, 40), st.floats(0.0, 3.0)), min_size=1, max_size=6),
    slices=st.integers(1, 40),
)
def test_a_motor_that_is_sent_elsewhere_keeps_its_speed_and_acceleration(
    targets: list[tuple[float, float]], slices: int
) -> None:
    whole = Motor(angle_deg=0.0, target_deg=0.0)
    sliced = Motor(angle_deg=0.0, target_deg=0.0)
    for target_deg, duration_s in targets:
        whole.target_deg = target_deg
        sliced.target_deg = target_deg
        whole.advance(duration_s)
        for _ in range(slices):
            before = sliced.speed_deg_s
            sliced.advance(duration_s / slices)
            assert abs(sliced.speed_deg_s - before) <= 10.0 * duration_s / slices + 1e-4
            assert abs(sliced.speed_deg_s) <= 10.0 + 1e-9
        # However often it is looked at, it is at the same place.
        assert sliced.angle_deg == pytest.approx(whole.angle_deg, abs=1e-6)
        assert sliced.lowest_deg == pytest.approx(whole.lowest_deg, abs=1e-6)
        assert sliced.highest_deg == pytest.approx(whole.highest_deg, abs=1e-6)
    whole.advance(60.0)
    assert whole.angle_deg == targets[-1][0]
