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


def test_it_powers_up_with_default_parameters() -> None:
    talk = Talk()
    velocity, backlash, limits = (
        apt.decode(message) for message in talk.say(apt.ask(apt.VELOCITY), apt.ask(apt.BACKLASH), apt.ask(apt.LIMITS))
    )
    assert isinstance(velocity, apt.Velocity)
    assert velocity.speed > apt.speed_word(10)
    assert backlash == apt.Counts(counts=1920)
    assert isinstance(limits, apt.SoftLimits)
    assert limits.mode == 1


def test_the_moving_bits_are_clear_before_motion_begins() -> None:
    talk = Talk()
    talk.go(10.0)
    assert not talk.status().moving
    talk.let_be(0.05)
    assert talk.status().moving
    talk.let_be(10.0)
    assert talk.status() == apt.Status(position=apt.counts_of(10.0), moving=False, homing=False, homed=True, faults=())


def test_it_reports_once_that_a_move_is_over() -> None:
    talk = Talk()
    talk.quiet()
    talk.go(1.0)
    said = [message.ident for _ in range(40) for message in talk.let_be(0.05)]
    assert said == [0x0464]


def test_its_own_backlash_correction_overshoots_and_comes_back() -> None:
    talk = Talk(play_deg=0.0)
    talk.go(-5.0)
    talk.let_be(20.0)
    assert talk.probe.angle_deg == pytest.approx(-5.0, abs=1e-3)
    assert talk.emulator.truth_range_deg[0] == pytest.approx(-6.0, abs=1e-3)


def test_play_leaves_the_probe_behind() -> None:
    talk = Talk(play_deg=0.3)
    talk.quiet()
    talk.go(5.0)
    talk.let_be(10.0)
    assert talk.probe.angle_deg == pytest.approx(5.0, abs=1e-3)
    talk.go(2.0)
    talk.let_be(10.0)
    assert talk.probe.angle_deg == pytest.approx(2.3, abs=1e-3)


def test_it_stops_dead_at_its_soft_limits_and_may_turn_back() -> None:
    talk = Talk(play_deg=0.0)
    talk.quiet()
    talk.say(apt.set_limits(apt.SoftLimits(low=apt.counts_of(-3), high=apt.counts_of(3))))
    talk.go(20.0)
    talk.let_be(20.0)
    assert talk.probe.angle_deg == pytest.approx(3.0, abs=1e-3)
    talk.go(0.0)
    talk.let_be(20.0)
    assert talk.probe.angle_deg == pytest.approx(0.0, abs=1e-3)


def test_homing_ignores_the_soft_limits_and_sets_the_counter() -> None:
    talk = Talk(start_deg=-30.0, homed=False, play_deg=0.0)
    assert talk.status().position == 0
    assert not talk.status().homed
    talk.say(apt.set_limits(apt.SoftLimits(low=-100, high=100)), HOME)
    talk.let_be(0.5)
    assert talk.status().homing
    said = talk.let_be(60.0)
    assert [message.ident for message in said] == [0x0444]
    assert talk.status() == apt.Status(position=0, moving=False, homing=False, homed=True, faults=())
    assert talk.probe.angle_deg == pytest.approx(-360.0, abs=1e-3)


def test_it_stops_on_the_command() -> None:
    talk = Talk()
    talk.quiet()
    talk.go(30.0)
    talk.let_be(1.0)
    assert [message.ident for message in talk.say(apt.stop())] == [0x0466]
    there = talk.probe.angle_deg
    talk.let_be(10.0)
    assert talk.probe.angle_deg == there
    assert 0 < there < 10
    talk.go(20.0)
    talk.let_be(10.0)
    assert talk.probe.angle_deg == pytest.approx(20.0, abs=1e-3)


def test_a_counter_that_is_a_turn_ahead_reads_so() -> None:
    talk = Talk(start_deg=-35.0, turns=1)
    assert talk.status().position == apt.counts_of(325.0)


def test_it_reports_its_status_unasked_if_another_program_left_it_so() -> None:
    talk = Talk(talking=True)
    assert [message.ident for _ in range(5) for message in talk.let_be(0.1)] == [0x0491] * 5
    talk.say(apt.stop_updates())
    assert talk.let_be(1.0) == []
