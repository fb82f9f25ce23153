"""The guard's state machine: each step from each state, and what a step that is refused leaves behind."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from markerseek.core import ConfigError, Interval, LaserError, LimitError, MoveError, Permit
from markerseek.guard import FiringLimits, Guard, Limits, State
from tests.unit.guard.guards import FOLLOW, WANTED, armed, disarmed

FOREIGN = Permit(token="foreign", angle_deg=0.0, pulses=1, expires_s=1e9)
SWEEP = replace(WANTED, angle_deg=0.0, pulses=16)


def guard(state: State = State.ARMED) -> Guard:
    """A guard that was led to a state by the steps allowed."""
    made = disarmed() if state in (State.DISARMED, State.FAULT) else armed()
    if state is State.FAULT:
        made.fail("the stage is on fire")
    if state is State.MOVING:
        made.begin_move(5.0)
    if state is State.FIRING:
        made.redeem(made.issue(angle_deg=0.0, pulses=16, now_s=0.0), angle_deg=0.0, now_s=0.0)
    if state is State.SWEEPING:
        made.redeem(made.issue_sweep(SWEEP, now_s=0.0), angle_deg=0.0, now_s=0.0)
    if state in (State.FOLLOWING, State.TURNING):
        made.begin_following(FOLLOW, by="a test", now_s=0.0)
    if state is State.TURNING:
        made.begin_turn(4.0, from_deg=0.0, now_s=0.0)
    return made


AT_REST = {State.ARMED, State.FOLLOWING}

STEPS: dict[str, tuple[Callable[[Guard], object], set[State], str]] = {
    "arm": (lambda it: it.arm(by="a test"), {State.DISARMED, State.ARMED}, "arm"),
    "reset": (lambda it: it.reset(by="a test"), {State.FAULT}, "reset"),
    "begin_move": (lambda it: it.begin_move(1.0), {State.ARMED}, "move"),
    "end_move": (lambda it: it.end_move(5.0), {State.MOVING}, "end a move"),
    "issue": (lambda it: it.issue(angle_deg=0.0, pulses=1, now_s=0.0), AT_REST, "permit pulses"),
    "issue_sweep": (lambda it: it.issue_sweep(SWEEP, now_s=0.0), {State.ARMED}, "permit pulses"),
    "redeem": (lambda it: it.redeem(FOREIGN, angle_deg=0.0, now_s=0.0), AT_REST, "fire"),
    "end_fire": (lambda it: it.end_fire(16), {State.FIRING}, "end a firing"),
    "read_sweep": (lambda it: it.read_sweep(0.0, now_s=0.1), {State.SWEEPING}, "sweep"),
    "end_sweep": (lambda it: it.end_sweep(0.0, pulses=0, now_s=0.1), {State.SWEEPING}, "sweep"),
    "begin_following": (lambda it: it.begin_following(FOLLOW, by="a test", now_s=0.0), AT_REST, "follow"),
    "end_following": (lambda it: it.end_following(), {State.FOLLOWING}, "end following"),
    "begin_turn": (lambda it: it.begin_turn(4.0, from_deg=0.0, now_s=0.0), {State.FOLLOWING}, "turn"),
    "read_turn": (lambda it: it.read_turn(0.1, now_s=0.1), {State.TURNING}, "turn"),
    "end_turn": (lambda it: it.end_turn(0.05, now_s=0.1), {State.TURNING}, "turn"),
}


@pytest.mark.parametrize("state", State)
@pytest.mark.parametrize("name", STEPS)
def test_a_step_out_of_its_state_is_refused_and_changes_nothing(name: str, state: State) -> None:
    step, allowed, words = STEPS[name]
    made = guard(state)
    if state in allowed:
        if name == "redeem":
            with pytest.raises(LaserError):
                step(made)
        else:
            step(made)
        return
    with pytest.raises(LimitError) as refusal:
        step(made)
    cure = (
        "a person must reset it after: the stage is on fire"
        if state is State.FAULT
        else "arm it, and end each step first"
    )
    assert str(refusal.value) == f"guard: {state.value}, not allowed to {words}; {cure}"
    assert made.state is state
    assert made.fault == ("the stage is on fire" if state is State.FAULT else None)
    assert made.pulses_permitted == (16 if state in (State.FIRING, State.SWEEPING) else 0)


@pytest.mark.parametrize("state", State)
def test_disarming_ends_every_state_but_fault(state: State) -> None:
    made = guard(state)
    made.disarm()
    made.disarm()
    assert made.state is (State.FAULT if state is State.FAULT else State.DISARMED)


@pytest.mark.parametrize("state", State)
def test_every_state_can_fail_and_the_first_reason_stays(state: State) -> None:
    made = guard(state)
    made.fail("the stage is on fire")
    made.fail("the laser too")
    assert made.state is State.FAULT
    assert made.fault == "the stage is on fire"


def test_a_person_leaves_fault_for_disarmed_and_forgets_the_reason() -> None:
    made = guard(State.FAULT)
    made.reset(by="a test")
    assert made.state is State.DISARMED
    assert made.fault is None
    made.fail("again")
    assert made.fault == "again"


@pytest.mark.parametrize("by", ["", "  ", None, 7, b"me"])
def test_nobody_may_neither_arm_nor_reset(by: Any) -> None:
    for made, step in ((guard(State.DISARMED), Guard.arm), (guard(State.FAULT), Guard.reset)):
        before = made.state
        with pytest.raises(ConfigError) as refusal:
            step(made, by=by)
        assert str(refusal.value) == "guard: by is empty; name the person who arms or resets it"
        assert made.state is before


@pytest.mark.parametrize("end", [Guard.disarm, lambda it: it.fail("why"), lambda it: it.begin_move(0.0)])
def test_an_open_permit_does_not_outlive_the_state(end: Callable[[Guard], None]) -> None:
    made = guard()
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    end(made)
    if made.state is State.FAULT:
        made.reset(by="a test")
    if made.state is State.MOVING:
        made.end_move(0.0)
    made.arm(by="a test")
    with pytest.raises(LaserError, match="is not open"):
        made.redeem(permit, angle_deg=0.0, now_s=0.0)
    assert made.state is State.FAULT


@pytest.mark.parametrize("readback_deg", [36.6, -36.6, math.nan])
@pytest.mark.parametrize("read", [Guard.readback, Guard.end_move])
def test_a_readback_outside_the_travel_is_a_fault(read: Callable[[Guard, float], object], readback_deg: float) -> None:
    made = guard(State.MOVING)
    with pytest.raises(LimitError, match="outside its travel range") as refusal:
        read(made, readback_deg)
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


@pytest.mark.parametrize("reached_deg", [4.875, 5.125])
def test_the_probe_may_stop_beside_its_target_by_the_limit(reached_deg: float) -> None:
    made = armed(arrival_deg=0.125)
    made.begin_move(5.0)
    made.end_move(reached_deg)
    assert made.state is State.ARMED


@pytest.mark.parametrize("reached_deg", [4.8, 5.2, -5.0])
def test_a_probe_that_did_not_arrive_is_a_fault(reached_deg: float) -> None:
    made = guard(State.MOVING)
    with pytest.raises(MoveError) as refusal:
        made.end_move(reached_deg)
    assert str(refusal.value) == (
        f"the stage was sent to 5.000 deg and the probe is at {reached_deg:.3f} deg, more than 0.1 deg away; "
        "check for an obstacle"
    )
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


@pytest.mark.parametrize(("angle_deg", "allowed"), [(3.125, True), (2.875, True), (3.2, False), (2.8, False)])
def test_a_permit_is_good_at_its_angle_only(angle_deg: float, allowed: bool) -> None:
    made = armed(arrival_deg=0.125)
    permit = made.issue(angle_deg=3.0, pulses=16, now_s=0.0)
    if allowed:
        made.redeem(permit, angle_deg=angle_deg, now_s=0.0)
        assert made.state is State.FIRING
        return
    with pytest.raises(MoveError) as refusal:
        made.redeem(permit, angle_deg=angle_deg, now_s=0.0)
    assert str(refusal.value) == (
        f"the permit holds at 3.000 deg and the probe is at {angle_deg:.3f} deg, more than 0.125 deg away; "
        "nothing was fired; check what moved it"
    )
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


def test_a_permit_expires_by_the_rigs_clock() -> None:
    made = guard()
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=7.0)
    assert permit == Permit(token="permit-1", angle_deg=0.0, pulses=16, expires_s=37.0)
    with pytest.raises(LaserError, match="has expired") as refusal:
        made.redeem(permit, angle_deg=0.0, now_s=37.5)
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


def test_a_dose_that_is_exceeded_is_refused_and_no_fault() -> None:
    made = armed(firing=FiringLimits(pulses_per_second=20))
    with pytest.raises(LimitError, match="129 pulses under one permit"):
        made.issue(angle_deg=0.0, pulses=129, now_s=0.0)
    made.redeem(made.issue(angle_deg=0.0, pulses=16, now_s=0.0), angle_deg=0.0, now_s=0.0)
    made.end_fire(16)
    permit = made.issue(angle_deg=0.0, pulses=16, now_s=0.5)
    with pytest.raises(LimitError, match="16 pulses within a second"):
        made.redeem(permit, angle_deg=0.0, now_s=0.5)
    assert made.state is State.ARMED


@pytest.mark.parametrize("fired", [0, 15, 17])
def test_other_pulses_than_permitted_are_a_fault(fired: int) -> None:
    made = guard(State.FIRING)
    with pytest.raises(LaserError) as refusal:
        made.end_fire(fired)
    assert str(refusal.value) == (f"the laser fired {fired} pulses, 16 were permitted; check the laser and its trigger")
    assert made.state is State.FAULT
    assert made.fault == str(refusal.value)


@pytest.mark.parametrize("arrival_deg", [0.0, -0.1, 73.0, math.nan])
def test_an_arrival_that_could_be_anywhere_is_refused(arrival_deg: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        disarmed(arrival_deg=arrival_deg)
    assert str(refusal.value) == (
        f"guard: arrival_deg is {arrival_deg} deg, it must be positive and less than the travel"
    )


def test_the_limits_are_those_given() -> None:
    limits = Limits(search=Interval(low_deg=-1, high_deg=1))
    assert disarmed(limits=limits).limits is limits
