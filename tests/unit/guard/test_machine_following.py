"""A permit to follow: its limits, its time, turns in the dark, and pulses at rest only."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from msgspec import structs

from markerseek.core import (
    SWEEP_READING_S,
    ConfigError,
    Interval,
    LaserError,
    LimitError,
    MoveError,
)
from markerseek.guard import FiringLimits, Guard, State
from tests.unit.guard.guards import FOLLOW, armed


def following(*, now_s: float = 10.0, **changes: Any) -> Guard:
    """A guard that follows from that time on."""
    made = armed(**changes)
    made.begin_following(FOLLOW, by="a test", now_s=now_s)
    return made


def turning(to_deg: float = 4.0, *, from_deg: float = 0.0, now_s: float = 10.0, **changes: Any) -> Guard:
    """A guard whose turn begins at that time."""
    made = following(now_s=now_s, **changes)
    made.begin_turn(to_deg, from_deg=from_deg, now_s=now_s)
    return made


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"speed_deg_s": 0.0}, "speed_deg_s is 0.0 deg/s, it must lie in (0, 100] deg/s"),
        ({"speed_deg_s": 100.1}, "speed_deg_s is 100.1 deg/s, it must lie in (0, 100] deg/s"),
        ({"speed_deg_s": math.nan}, "speed_deg_s is nan deg/s"),
        ({"duration_s": 0.0}, "duration_s is 0.0 s, it must lie in (0, 3600] s"),
        ({"duration_s": 3601.0}, "duration_s is 3601.0 s"),
        ({"pulses": 1.5}, "1.5 pulses, 6 a second, these must be whole numbers"),
        ({"pulses_per_second": True}, "4 pulses, True a second, these must be whole numbers"),
        ({"pulses": -1}, "-1 pulses at once and 6 a second"),
        ({"pulses": 7}, "7 pulses at once and 6 a second, it must be at least 0, no more at once than in a second"),
        ({"pulses_per_second": 65}, "and at most 64 a second"),
    ],
)
def test_a_permit_that_bounds_nothing_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        structs.replace(FOLLOW, **changes)
    assert said in str(refusal.value)


def test_a_permit_at_its_bounds_is_one() -> None:
    structs.replace(FOLLOW, speed_deg_s=100.0, duration_s=3600.0, pulses=64, pulses_per_second=64)
    structs.replace(FOLLOW, pulses=0, pulses_per_second=0)


def led_to(state: State) -> Guard:
    """A guard in one of the states in which it follows."""
    if state is State.TURNING:
        return turning()
    made = following()
    if state is State.FIRING:
        made.redeem(made.issue(angle_deg=0.0, pulses=4, now_s=10.0), angle_deg=0.0, now_s=10.0)
    return made


@pytest.mark.parametrize("state", [State.FOLLOWING, State.TURNING, State.FIRING])
def test_disarming_and_a_fault_end_it(state: State) -> None:
    for end in (Guard.disarm, lambda it: it.fail("why")):
        made = led_to(state)
        end(made)
        assert made.state is (State.DISARMED if end is Guard.disarm else State.FAULT)
        if made.state is State.FAULT:
            made.reset(by="a test")
        made.arm(by="a test")
        # Nothing of the permit is left: neither its pulses nor its limits.
        permit = made.issue(angle_deg=0.0, pulses=16, now_s=1e6)
        made.redeem(permit, angle_deg=0.0, now_s=1e6)
        made.end_fire(16)
        assert made.state is State.ARMED


@pytest.mark.parametrize(("low_deg", "high_deg"), [(-35.5, 0.0), (0.0, 35.5)])
def test_angles_beyond_the_search_range_are_refused(low_deg: float, high_deg: float) -> None:
    made = armed()
    permit = structs.replace(FOLLOW, angles=Interval(low_deg=low_deg, high_deg=high_deg))
    with pytest.raises(LimitError, match="outside the search range"):
        made.begin_following(permit, by="a test", now_s=0.0)
    assert made.state is State.ARMED


@pytest.mark.parametrize("now_s", [math.nan, math.inf])
def test_a_time_that_is_none_permits_nothing(now_s: float) -> None:
    made = armed()
    with pytest.raises(LimitError) as refusal:
        made.begin_following(FOLLOW, by="a test", now_s=now_s)
    assert str(refusal.value) == f"guard: it is {now_s!r} s, no number; nothing was permitted"
    assert made.state is State.ARMED


def test_a_permit_of_before_does_not_outlive_its_beginning_or_its_end() -> None:
    for change in (lambda it: it.begin_following(FOLLOW, by="a test", now_s=10.0), Guard.end_following):
        made = following() if change is Guard.end_following else armed()
        permit = made.issue(angle_deg=0.0, pulses=4, now_s=10.0)
        change(made)
        with pytest.raises(LaserError, match="is not open"):
            made.redeem(permit, angle_deg=0.0, now_s=10.0)
        assert made.state is State.FAULT


@pytest.mark.parametrize("now_s", [70.0, 70.001, math.nan])
def test_it_expires_and_a_person_renews_it(now_s: float) -> None:
    made = following(now_s=10.0)
    permit = made.issue(angle_deg=0.0, pulses=4, now_s=70.0)
    steps: list[Callable[[], object]] = [
        lambda: made.begin_turn(4.0, from_deg=0.0, now_s=now_s),
        lambda: made.issue(angle_deg=0.0, pulses=4, now_s=now_s),
        lambda: made.redeem(permit, angle_deg=0.0, now_s=now_s),
    ]
    if now_s == 70.0:
        steps[0]()
        assert made.state is State.TURNING
        return
    for step in steps:
        with pytest.raises(LimitError) as refusal:
            step()
        said = f"guard: the permit to follow has expired at 70.0 s, it is {now_s:.1f} s; a person must renew it"
        assert str(refusal.value) == said
        assert made.state is State.FOLLOWING
    made.begin_following(FOLLOW, by="a test", now_s=71.0)
    made.begin_turn(4.0, from_deg=0.0, now_s=131.0)
    assert made.state is State.TURNING


@pytest.mark.parametrize(
    ("to_deg", "from_deg", "said"),
    [
        (25.1, 22.0, "a turn to 25.1 deg, outside [-20, 25] deg of the permit to follow"),
        (-20.1, -18.0, "a turn to -20.1 deg, outside [-20, 25] deg of the permit to follow"),
        (math.nan, 0.0, "a turn to nan deg, outside"),
        (24.0, 26.0, "a turn from 26.0 deg, outside [-20, 25] deg of the permit to follow"),
        (5.1, 0.0, "a turn from 0.000 to 5.100 deg; the longest while it follows is 5 deg"),
        (-1.0, 4.1, "a turn from 4.100 to -1.000 deg; the longest while it follows is 5 deg"),
        (1.0, 1.0, "a turn from 1.000 to 1.000 deg"),
    ],
)
def test_a_turn_beyond_its_limits_moves_nothing(to_deg: float, from_deg: float, said: str) -> None:
    made = following()
    with pytest.raises(LimitError) as refusal:
        made.begin_turn(to_deg, from_deg=from_deg, now_s=10.0)
    assert str(refusal.value).startswith(said)
    assert "; nothing was moved; " in str(refusal.value)
    assert made.state is State.FOLLOWING


@pytest.mark.parametrize(("to_deg", "from_deg"), [(25.0, 20.0), (-20.0, -15.0), (20.0, 25.0), (-15.0, -20.0)])
def test_the_limits_themselves_are_allowed(to_deg: float, from_deg: float) -> None:
    assert turning(to_deg, from_deg=from_deg).state is State.TURNING


def test_a_readback_outside_the_travel_begins_no_turn() -> None:
    made = following()
    with pytest.raises(LimitError, match="outside its travel range"):
        made.begin_turn(4.0, from_deg=math.nan, now_s=10.0)
    assert made.state is State.FAULT


def test_a_turn_goes_through_its_states() -> None:
    made = turning(0.5)
    made.read_turn(0.0, now_s=10.1)
    made.read_turn(0.5, now_s=10.2)
    made.end_turn(0.45, now_s=10.3)
    assert made.state is State.FOLLOWING
    # And back again, from where it is.
    made.begin_turn(0.0, from_deg=0.45, now_s=10.4)
    made.read_turn(0.0, now_s=10.5)
    made.end_turn(-0.05, now_s=10.6)
    made.end_following()
    assert made.state is State.ARMED
    assert made.fault is None
    assert made.pulses_permitted == 0


@pytest.mark.parametrize("to_deg", [4.0, -4.0])
@pytest.mark.parametrize(
    ("turned_deg", "elapsed_s", "allowed"),
    [
        # 1.25 times 4 deg/s for 0.125 s, and 0.125 deg that two readings may differ by.
        (0.75, 0.125, True),
        (0.751, 0.125, False),
        (-0.125, 0.125, True),
        (-0.126, 0.125, False),
        (0.0, 0.0, False),
        (0.1, -0.01, False),
        (0.1, SWEEP_READING_S - 1e-9, True),
        (0.1, SWEEP_READING_S + 0.001, False),
        (0.1, math.nan, False),
    ],
)
def test_a_turn_that_is_too_fast_backwards_or_read_late_is_a_fault(
    to_deg: float, turned_deg: float, elapsed_s: float, allowed: bool
) -> None:
    made = turning(to_deg, now_s=0.0, arrival_deg=0.125)
    angle_deg = math.copysign(1.0, to_deg) * turned_deg
    if allowed:
        made.read_turn(angle_deg, now_s=elapsed_s)
        assert made.state is State.TURNING
        return
    with pytest.raises(MoveError) as refusal:
        made.read_turn(angle_deg, now_s=elapsed_s)
    assert "outside the permitted turn from 0.00 to " in str(refusal.value)
    assert "at most 5 deg/s" in str(refusal.value)
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


def test_a_turn_beyond_its_end_is_a_fault() -> None:
    made = turning(0.25, now_s=0.0, arrival_deg=0.125)
    made.read_turn(0.375, now_s=0.125)
    with pytest.raises(MoveError, match="outside the permitted turn"):
        made.read_turn(0.376, now_s=0.25)
    assert made.state is State.FAULT


def test_a_turn_that_lasts_too_long_is_a_fault() -> None:
    made = turning(4.0, now_s=0.0)
    # 4 deg at 4 deg/s, and 5 s more.
    for step in range(1, 61):
        made.read_turn(0.0, now_s=0.1 * step)
    with pytest.raises(MoveError, match=r"until 6\.0 s"):
        made.read_turn(0.0, now_s=6.1)
    assert made.state is State.FAULT


def test_a_stage_that_does_not_stop_is_a_fault() -> None:
    made = turning(4.0, now_s=0.0)
    made.read_turn(0.3, now_s=0.1)
    with pytest.raises(MoveError) as refusal:
        made.end_turn(0.5, now_s=0.2)
    assert "the turn ended at 0.300 deg and the probe is at 0.500 deg" in str(refusal.value)
    assert str(refusal.value).endswith("the stage does not stop")
    assert made.state is State.FAULT


def test_there_is_no_light_while_it_turns() -> None:
    made = following()
    permit = made.issue(angle_deg=0.0, pulses=4, now_s=10.0)
    made.begin_turn(4.0, from_deg=0.0, now_s=10.0)
    with pytest.raises(LimitError, match="turning, not allowed to fire"):
        made.redeem(permit, angle_deg=0.0, now_s=10.0)
    with pytest.raises(LimitError, match="turning, not allowed to permit pulses"):
        made.issue(angle_deg=0.0, pulses=0, now_s=10.0)
    made.end_turn(0.1, now_s=10.1)
    # Nor by a permit of before the turn.
    with pytest.raises(LaserError, match="is not open"):
        made.redeem(permit, angle_deg=0.0, now_s=10.1)


def test_pulses_at_rest_are_those_of_the_permit_to_follow() -> None:
    made = following()
    with pytest.raises(LimitError) as refusal:
        made.issue(angle_deg=0.0, pulses=5, now_s=10.0)
    said = "5 pulses at once while it follows; the limit of the permit to follow is 4: ask for fewer"
    assert str(refusal.value) == said
    made.redeem(made.issue(angle_deg=0.0, pulses=4, now_s=10.0), angle_deg=0.0, now_s=10.0)
    assert made.state is State.FIRING
    made.end_fire(4)
    assert made.state is State.FOLLOWING
    made.redeem(made.issue(angle_deg=0.0, pulses=2, now_s=10.5), angle_deg=0.0, now_s=10.5)
    made.end_fire(2)
    permit = made.issue(angle_deg=0.0, pulses=1, now_s=10.9)
    with pytest.raises(LimitError) as refusal:
        made.redeem(permit, angle_deg=0.0, now_s=10.9)
    assert str(refusal.value).startswith("6 pulses within a second and 1 more are asked for; the limit is 6: fire more")
    made.redeem(made.issue(angle_deg=0.0, pulses=4, now_s=11.0), angle_deg=0.0, now_s=11.0)
    assert made.pulses_permitted == 11


def test_the_limit_of_the_rig_holds_on() -> None:
    made = following(firing=FiringLimits(pulses_per_second=3))
    made.redeem(made.issue(angle_deg=0.0, pulses=3, now_s=10.0), angle_deg=0.0, now_s=10.0)
    made.end_fire(3)
    permit = made.issue(angle_deg=0.0, pulses=1, now_s=10.1)
    with pytest.raises(LimitError, match="3 pulses within a second and 1 more are asked for; the limit is 3"):
        made.redeem(permit, angle_deg=0.0, now_s=10.1)


def test_a_permit_holds_at_its_angle_while_it_follows() -> None:
    made = following()
    permit = made.issue(angle_deg=0.0, pulses=4, now_s=10.0)
    with pytest.raises(MoveError, match=r"the permit holds at 0\.000 deg"):
        made.redeem(permit, angle_deg=0.2, now_s=10.0)
    assert made.state is State.FAULT
