"""The stage's driver against its emulator in virtual time: connection, moves, sense of rotation, and interruptions."""

from __future__ import annotations

import contextlib
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, DeviceTimeoutError, Interval, LimitError, MoveError, NotConnectedError
from markerseek.drivers import StageRules
from markerseek.drivers.standard_stage import DOWN, UP, plan_approach
from markerseek.emulators._kdc101_motion import Motor
from markerseek.sim import StageMotion
from markerseek.wire import apt
from tests.unit.drivers.kdc101_bench import TRAVEL, Killed, bench


def test_it_identifies_itself_and_writes_the_settings_that_power_up_lost() -> None:
    rig = bench()
    rig.port.write(apt.set_trigger_ports(apt.TriggerPorts(first=0x0D)))
    stage = rig.stage(speed_deg_s=12.0, acceleration_deg_s2=15.0)
    assert (stage.logic.identity.model, stage.logic.identity.serial_number) == ("KDC101", 27000001)
    asked = (apt.VELOCITY, apt.BACKLASH, apt.LIMITS, apt.TRIGGER_PORTS)
    rig.port.write(b"".join(map(apt.ask, asked)))
    answers = [apt.decode(message) for message in apt.AptFramer().feed(rig.port.read(4096, timeout_s=0.0))]
    assert answers == [
        apt.Velocity(acceleration=220, speed=515300),  # 15 x 14.6574 = 219.9; 12 x 42941.66 = 515299.9
        apt.Counts(counts=0),
        apt.SoftLimits(low=-70066, high=70066, mode=2, switches=4),
        apt.TriggerPorts(first=apt.TRIGGER_OFF),
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


@pytest.mark.parametrize("swallowed", [0x0413, 0x043A, 0x0423, 0x0523])
def test_parameters_that_are_not_kept_are_refused(swallowed: int) -> None:
    rig = bench()
    rig.port.write(apt.set_trigger_ports(apt.TriggerPorts(first=0x0D)))
    rig.port.swallowed = swallowed
    with pytest.raises(MoveError, match="does not keep its"):
        rig.stage()


def test_a_stage_that_moves_is_not_taken_over() -> None:
    rig = bench()
    rig.port.write(apt.set_target(5000) + apt.move())
    rig.let_be(0.2)
    with pytest.raises(MoveError, match="is moving"):
        rig.stage()


@pytest.mark.parametrize(
    "wrong",
    [
        {"travel": Interval(low_deg=-0.5, high_deg=0.5)},
        {"travel": Interval(low_deg=-180.0, high_deg=180.0)},
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        bench().stage(**wrong)


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
    moves = rig.emulator.moves
    began_s = rig.clock.now_s()
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


UNEVEN = Interval(low_deg=-20.0, high_deg=36.5)
"""A range that shows whether its ends were swapped."""

PLAY_DEG = 0.4


@settings(max_examples=35, deadline=None)
@given(
    targets=st.lists(st.floats(-20.0, 36.5), min_size=1, max_size=4),
    start=st.floats(-19.5, 36.0),
    zero_deg=st.sampled_from([0.0, 12.5, 340.0, -350.0]),
    turns=st.sampled_from([-1, 0, 1]),
    mirrored=st.booleans(),
)
def test_a_stage_turns_its_probe_where_it_should_be_by_the_short_way(
    targets: list[float], start: float, zero_deg: float, turns: int, mirrored: bool
) -> None:
    rig = bench(start_deg=start, play_deg=0.0, mirrored=mirrored, zero_deg=zero_deg, turns=turns)
    stage = rig.stage(travel=UNEVEN, direction="reverse" if mirrored else "forward", zero_deg=zero_deg)
    assert stage.angle_deg == pytest.approx(start, abs=1e-3)
    for target in targets:
        assert stage.move_to(target) == pytest.approx(target, abs=1e-3)
        assert rig.probe.angle_deg == pytest.approx(target, abs=1e-3)
    low, high = rig.emulator.truth_range_deg
    assert low >= UNEVEN.low_deg
    assert high <= UNEVEN.high_deg
    assert rig.emulator.largest_lead_deg <= 5.0


def test_the_limits_in_the_controller_are_those_of_the_probe() -> None:
    rig = bench(play_deg=0.0, mirrored=True)
    rig.stage(travel=UNEVEN, direction="reverse")
    # A program that ignores us is held by the controller itself, at the probe's own ends.
    for counts, end_deg in ((apt.counts_of(90.0), UNEVEN.low_deg), (apt.counts_of(-90.0), UNEVEN.high_deg)):
        rig.port.write(apt.set_target(counts) + apt.move())
        rig.let_be(30.0)
        assert rig.probe.angle_deg == pytest.approx(end_deg, abs=1e-3)
        assert rig.probe.angle_deg in UNEVEN


def test_a_target_outside_the_probe_s_range_is_refused_although_the_stage_s_own_range_holds_it() -> None:
    rig = bench(play_deg=0.0, mirrored=True)
    stage = rig.stage(travel=UNEVEN, direction="reverse")
    with pytest.raises(LimitError, match="outside its travel"):
        stage.move_to(-30.0)
    assert rig.emulator.moves == 0


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("side", ["below", "above"])
def test_the_play_falls_on_the_same_side_always(mirrored: bool, side: Literal["below", "above"]) -> None:
    rig = bench(play_deg=PLAY_DEG, mirrored=mirrored)
    stage = rig.stage(direction="reverse" if mirrored else "forward", approach_from=side)
    off_deg = []
    for target in (10.0, -20.0, 5.0, 4.8, 5.2, 30.0):
        reached = stage.move_to(target)
        assert not stage.approach_reversed
        off_deg.append(rig.probe.angle_deg - reached)
    assert max(off_deg) - min(off_deg) < 1e-6
    # Driven by the motor's rising reading the probe stands at the encoder's angle, else by the play behind it.
    rising = (side == "below") != mirrored
    assert off_deg[0] == pytest.approx(0.0 if rising else PLAY_DEG * (-1 if mirrored else 1), abs=1e-6)


def test_a_mirrored_probe_under_the_default_goes_to_the_mirrored_angle() -> None:
    """Nothing in the stage's answers shows it: this is what `doctor --source-deg` is for."""
    rig = bench(play_deg=0.0, mirrored=True)
    stage = rig.stage()
    assert stage.move_to(12.0) == pytest.approx(12.0, abs=1e-3)
    assert rig.probe.angle_deg == pytest.approx(-12.0, abs=1e-3)


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
    rig.port.dead_from_s = after_s  # not even the stop of a dying program arrives
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
    read = rig.port.read
    count = 0

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
