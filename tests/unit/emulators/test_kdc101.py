"""The emulated stage by itself: moves, power-up, homing, stops and messages."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.emulators import EmulatedKdc101
from markerseek.emulators._prm1z8 import Motor
from markerseek.emulators.kdc101 import Kdc101Emulator
from markerseek.sim import StageMotion
from markerseek.wire import AptFramer, AptMessage, apt
from tests.sizes import examples

HOME = bytes.fromhex("43 04 01 00 50 01")


class Talk:
    """Sends messages to an emulated stage and keeps its answers."""

    def __init__(self, *, start_deg: float = 0.0, **fields: object) -> None:
        self.probe = SimpleNamespace(angle_deg=start_deg)
        self.emulator = Kdc101Emulator(probe=self.probe, settings=EmulatedKdc101(**fields))  # type: ignore[arg-type]
        self.now_s = 0.0
        self._framer = AptFramer()

    def say(self, *messages: bytes) -> list[AptMessage]:
        return self._framer.feed(b"".join(self.emulator.feed(message) for message in messages))

    def let_be(self, duration_s: float) -> list[AptMessage]:
        self.now_s += duration_s
        return self._framer.feed(self.emulator.advance(self.now_s))

    def status(self) -> apt.Status:
        (message,) = self.say(apt.ask(apt.STATUS))
        said = apt.decode(message)
        assert isinstance(said, apt.Status)
        return said

    def go(self, angle_deg: float) -> None:
        self.say(apt.set_target(apt.counts_of(angle_deg)), apt.move())

    def quiet(self) -> None:
        """The usual speed, and no backlash correction."""
        velocity = apt.Velocity(acceleration=apt.acceleration_word(10), speed=apt.speed_word(10))
        self.say(apt.set_velocity(velocity), apt.set_backlash(0))


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
    whole, sliced = Motor(angle_deg=0.0, target_deg=0.0), Motor(angle_deg=0.0, target_deg=0.0)
    for target_deg, duration_s in targets:
        whole.target_deg = sliced.target_deg = target_deg
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
