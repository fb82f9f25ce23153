"""The stage's driver over the emulated stage, in virtual time: connecting, moving, and dying on the way."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, DeviceTimeoutError, Interval, LimitError, MoveError, NotConnectedError
from markerseek.drivers._approach import DOWN, UP, plan_approach
from markerseek.drivers._kdc101_move import MoveRules
from markerseek.drivers.kdc101 import Kdc101Stage, StageSettings
from markerseek.emulators import DirectPort
from markerseek.emulators._motor import Motor
from markerseek.emulators.kdc101 import Kdc101Emulator, Kdc101Settings
from markerseek.sim import StageMotion, VirtualClock
from markerseek.wire import apt
from markerseek.wire.apt_frames import CONTROLLER, TO_CONTROLLER, AptFramer

TRAVEL = Interval(low_deg=-36.5, high_deg=36.5)


class Killed(BaseException):
    """The program dies."""


class WatchedClock(VirtualClock):
    """Knows the longest wait, and ends the program at some moment."""

    def __init__(self) -> None:
        super().__init__()
        self.longest_s = 0.0
        self.killed_at_s = np.inf

    def wait(self, duration_s: float) -> None:
        self.longest_s = max(self.longest_s, duration_s)
        super().wait(duration_s)
        if self.now_s() >= self.killed_at_s:
            raise Killed


class WatchedPort(DirectPort):
    """Keeps what was said to the controller; can be cut, or made to swallow a kind of message."""

    def __init__(self, **parts: Any) -> None:
        super().__init__(**parts)
        self.said: list[int] = []
        self.cut = False
        self.swallowed: int | None = None
        self.dead_from_s = np.inf
        self.angle_at_death_deg: float | None = None

    def write(self, data: bytes) -> None:
        if self.cut:
            raise NotConnectedError("cut")
        if self._clock.now_s() >= self.dead_from_s:
            if self.angle_at_death_deg is None:
                self.read(0, timeout_s=0.0)
                self.angle_at_death_deg = self._device._stage._probe.angle_deg  # type: ignore[attr-defined]
            return
        for message in AptFramer(TO_CONTROLLER, to=CONTROLLER).feed(data):
            self.said.append(message.ident)
            if message.ident != self.swallowed:
                super().write(message.raw)


@dataclass
class Bench:
    clock: WatchedClock
    probe: SimpleNamespace
    emulator: Kdc101Emulator
    port: WatchedPort

    def stage(self, **fields: Any) -> Kdc101Stage:
        return Kdc101Stage(port=self.port, clock=self.clock, settings=StageSettings(**fields))

    def let_be(self, duration_s: float) -> None:
        self.clock.killed_at_s = np.inf
        self.clock.wait(duration_s)
        self.emulator.advance(self.clock.now_s())


def bench(*, start_deg: float = 0.0, **fields: Any) -> Bench:
    clock, probe = WatchedClock(), SimpleNamespace(angle_deg=start_deg)
    emulator = Kdc101Emulator(probe=probe, settings=Kdc101Settings(**fields))
    return Bench(clock, probe, emulator, WatchedPort(device=emulator, clock=clock))


def test_it_says_who_it_is_and_writes_what_power_up_lost() -> None:
    rig = bench()
    stage = rig.stage(speed_deg_s=12.0, acceleration_deg_s2=15.0)
    assert (stage.identity.model, stage.identity.serial_number) == ("KDC101", 27000001)
    rig.port.write(apt.ask_velocity() + apt.ask_backlash() + apt.ask_limits())
    answers = [apt.decode(message) for message in AptFramer().feed(rig.port.read(4096, timeout_s=0.0))]
    assert answers == [
        apt.Velocity(acceleration=220, speed=515300),  # 15 x 14.6574 = 219.9; 12 x 42941.66 = 515299.9
        apt.Counts(counts=0),
        apt.SoftLimits(low=-70066, high=70066, mode=2, switches=4),
    ]
    assert rig.clock.now_s() == 0.0
    assert rig.emulator.moves == 0


@pytest.mark.parametrize(
    ("stands", "wanted", "error", "words"),
    [
        ({"homed": False}, {}, MoveError, "outside the patient|out of the patient.*home it"),
        ({"model": "KST101"}, {}, NotConnectedError, "KST101"),
        ({}, {"serial_number": 1}, NotConnectedError, "27000001"),
        ({"start_deg": 40.0}, {}, LimitError, "40.00 deg"),
        ({"start_deg": 10.0, "zero_deg": 50.0}, {}, LimitError, "60.00 deg"),
    ],
)
def test_what_cannot_be_used_is_refused_at_connect(
    stands: dict[str, Any], wanted: dict[str, Any], error: type[Exception], words: str
) -> None:
    rig = bench(**stands)
    with pytest.raises(error, match=words):
        rig.stage(**wanted)
    assert rig.emulator.moves == 0


@pytest.mark.parametrize("swallowed", [0x0413, 0x043A, 0x0423])
def test_parameters_that_are_not_kept_are_refused(swallowed: int) -> None:
    rig = bench()
    rig.port.swallowed = swallowed
    with pytest.raises(MoveError, match="does not keep its"):
        rig.stage()


def test_a_stage_that_moves_is_not_taken_over() -> None:
    rig = bench()
    rig.port.write(apt.set_target(5000) + apt.move())
    rig.let_be(0.2)
    with pytest.raises(MoveError, match="is moving"):
        rig.stage()


def test_nobody_there() -> None:
    rig = bench()
    rig.port.swallowed = 0x0005
    with pytest.raises(DeviceTimeoutError, match="no answer"):
        rig.stage()


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
    }


@pytest.mark.parametrize(("zero_deg", "turns"), [(0.0, 1), (0.0, -1), (340.0, 0), (-350.0, 2)])
def test_it_does_not_turn_the_long_way_round(zero_deg: float, turns: int) -> None:
    rig = bench(zero_deg=zero_deg, turns=turns, start_deg=-20.0)
    stage = rig.stage(zero_deg=zero_deg)
    assert stage.angle_deg == pytest.approx(-20.0, abs=1e-3)
    for target in (-35.0, 35.0, -35.0):
        assert stage.move_to(target) == pytest.approx(target, abs=1e-3)
        assert rig.probe.angle_deg == pytest.approx(target, abs=1e-3)
    low, high = rig.emulator.truth_range_deg
    assert low in TRAVEL
    assert high in TRAVEL


def test_play_falls_on_the_same_side_always() -> None:
    rig = bench(play_deg=0.4)
    stage = rig.stage()
    rng = np.random.Generator(np.random.PCG64(5))
    for target in [*rng.uniform(-35, 35, 12).tolist(), 10.0, 10.2, 10.1, 10.1]:
        reached = stage.move_to(target)
        assert not stage.approach_reversed
        assert rig.probe.angle_deg == pytest.approx(reached, abs=1e-9)


def test_an_approach_that_had_to_be_reversed_is_marked() -> None:
    rig = bench(play_deg=0.4)
    stage = rig.stage()
    reached = stage.move_to(-36.2)
    assert stage.approach_reversed
    assert rig.probe.angle_deg == pytest.approx(reached + 0.4, abs=1e-9)
    reached = stage.move_to(-35.4)
    assert not stage.approach_reversed
    assert rig.probe.angle_deg == pytest.approx(reached, abs=1e-9)


def test_a_stage_that_was_stopped_on_its_way_takes_up_its_play_again() -> None:
    rig = bench(play_deg=0.4)
    stage = rig.stage()
    stage.move_to(0.0)
    rig.clock.killed_at_s = rig.clock.now_s() + 1.0
    with pytest.raises(Killed):
        stage.move_to(-30.0)
    rig.clock.killed_at_s = np.inf
    here = stage.angle_deg
    assert rig.probe.angle_deg > here + 0.3
    assert stage.move_to(here) == here
    assert rig.probe.angle_deg == pytest.approx(here, abs=1e-9)


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


def test_all_waiting_is_short_so_that_the_loop_can_show_that_it_lives() -> None:
    rig = bench()
    stage = rig.stage()
    stage.move_to(-35.0)
    stage.stop()
    assert rig.clock.longest_s <= 0.05


@pytest.mark.parametrize("after_s", np.linspace(0.02, 5.4, 12).tolist())
def test_a_computer_that_dies_leaves_the_stage_five_degrees_on_at_most(after_s: float) -> None:
    rig = bench()
    stage = rig.stage()
    rig.port.dead_from_s = after_s  # not even the stop of a dying program is heard
    with pytest.raises(DeviceTimeoutError):
        stage.move_to(-35.0)
    assert rig.port.angle_at_death_deg is not None
    rig.let_be(20.0)
    assert not rig.emulator.moving
    assert 0.0 <= abs(rig.probe.angle_deg - rig.port.angle_at_death_deg) <= 5.0
    assert rig.emulator.largest_lead_deg <= 5.0


@pytest.mark.parametrize("number", range(20, 44))
def test_one_reading_that_is_a_little_wrong_carries_no_target_further(number: int) -> None:
    rig = bench()
    stage = rig.stage()
    read, count = rig.port.read, 0

    def read_wrongly(size: int, *, timeout_s: float) -> bytes:
        nonlocal count
        data = read(size, timeout_s=timeout_s)
        if data[:2] == b"\x91\x04":
            count += 1
            if count == number:
                position = int.from_bytes(data[8:12], "little", signed=True) - 192  # 0.1 deg further on its way
                data = data[:8] + position.to_bytes(4, "little", signed=True) + data[12:]
        return data

    rig.port.read = read_wrongly  # type: ignore[method-assign]
    # It is either outvoted or refused.
    with contextlib.suppress(MoveError):
        assert stage.move_to(-35.0) == pytest.approx(-35.0, abs=1e-3)
    assert count >= number
    assert rig.emulator.largest_lead_deg <= 5.0


def test_an_interrupted_move_is_stopped_at_once() -> None:
    rig = bench()
    stage = rig.stage()
    rig.clock.killed_at_s = 2.0
    with pytest.raises(Killed):
        stage.move_to(-35.0)
    there = rig.probe.angle_deg
    rig.let_be(20.0)
    assert rig.probe.angle_deg == there
    assert -15 < there < -5


def test_a_line_that_is_cut_is_an_error_and_not_a_wait() -> None:
    rig = bench()
    stage = rig.stage()
    rig.port.cut = True
    for act in (lambda: stage.move_to(1.0), lambda: stage.angle_deg, stage.stop):
        with pytest.raises(NotConnectedError):
            act()


def test_a_stage_turned_by_hand_at_rest_is_noticed() -> None:
    rig = bench()
    stage = rig.stage()
    stage.move_to(3.0)
    rig.port.write(apt.set_target(0) + apt.move())
    rig.let_be(5.0)
    with pytest.raises(MoveError, match="wheel"):
        _ = stage.angle_deg


def test_updates_that_nobody_asked_for_do_no_harm() -> None:
    rig = bench(talking=True)
    rig.let_be(0.35)
    stage = rig.stage()
    assert stage.move_to(7.0) == pytest.approx(7.0, abs=1e-3)


@given(speed=st.floats(0.1, 25), acceleration=st.floats(0.1, 25), duration_s=st.floats(0, 20))
def test_no_motor_of_its_speed_and_acceleration_gets_further(
    speed: float, acceleration: float, duration_s: float
) -> None:
    """Against the emulated motor, whose speed is integrated phase by phase."""
    rules = MoveRules(
        low=-(10**9), high=10**9, speed=speed, acceleration=acceleration,
        lead=1, renew_s=0.1, arrival=1, unexpected=1, begin_s=0.5,
    )  # fmt: skip
    motor = Motor(angle_deg=0.0, target_deg=1e6, top_speed_deg_s=speed, acceleration_deg_s2=acceleration)
    motor.advance(duration_s)
    assert rules.reach(duration_s) == pytest.approx(1.25 * motor.angle_deg, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    ("speed_deg_s", "acceleration_deg_s2"), [(0.1, 0.1024), (25.0, 25.0), (25.0, 0.1024), (1.0, 10.0)]
)
def test_a_sound_stage_is_never_too_fast_however_it_is_set(speed_deg_s: float, acceleration_deg_s2: float) -> None:
    """An acceleration of 0.1024 is rounded to a word that is a third more."""
    rig = bench()
    stage = rig.stage(speed_deg_s=speed_deg_s, acceleration_deg_s2=acceleration_deg_s2, arrival_deg=0.001)
    for target in (-1.0, 1.0, 1.02, 1.3):
        assert stage.move_to(target) == pytest.approx(target, abs=1e-3)


@settings(max_examples=15, deadline=None)
@given(targets=st.lists(st.floats(-36.5, 36.5), min_size=1, max_size=4), start=st.floats(-36.0, 36.0))
def test_wherever_it_goes_it_arrives_and_stays_inside(targets: list[float], start: float) -> None:
    rig = bench(start_deg=start, play_deg=0.0)
    stage = rig.stage()
    for target in targets:
        assert stage.move_to(target) == pytest.approx(target, abs=1e-3)
    low, high = rig.emulator.truth_range_deg
    assert low >= TRAVEL.low_deg
    assert high <= TRAVEL.high_deg
    assert rig.emulator.largest_lead_deg <= 5.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"speed_deg_s": 0.0},
        {"speed_deg_s": float("nan")},
        {"acceleration_deg_s2": 26.0},
        {"lead_deg": 5.1},
        {"zero_deg": 1000.0},
        {"approach_from": "left"},
        {"travel": Interval(low_deg=-0.5, high_deg=0.5)},
        {"travel": Interval(low_deg=-180.0, high_deg=180.0)},
        {"age_s": 0.0},
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        StageSettings(**wrong)
