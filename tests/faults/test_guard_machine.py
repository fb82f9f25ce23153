"""Stateful test of the guard: random sequences of steps against a model that knows only the promises.

``MARKERSEEK_TRACES=100000 pytest tests/faults/test_guard_machine.py`` walks as many traces as P7 asks for.
"""

from __future__ import annotations

import math
import os

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, invariant, multiple, rule

from markerseek.core import SWEEP_READING_S, ConfigError, DeviceError, FollowPermit, Interval, Permit, SweepPermit
from markerseek.guard import Admission, FiringLimits, Guard, Limits, State
from tests.sizes import examples

TRACES = int(os.environ.get("MARKERSEEK_TRACES", "200"))
FIRING = FiringLimits(
    pulses_per_permit=8, pulses_per_sweep=30, pulses_per_second=20, pulses_per_session=60, lifetime_s=2.0
)

ARRIVAL_DEG = 0.1

FOLLOW = FollowPermit(
    angles=Interval(low_deg=-10.0, high_deg=12.0), speed_deg_s=5.0, duration_s=3.0, pulses=3, pulses_per_second=5
)

ANGLES = st.sampled_from([-36.6, -35.0, 0.0, 0.05, 10.0, 35.0, 35.1, math.nan, math.inf]) | st.floats(-37, 37)
PULSES = st.integers(-1, 10)


class Traces(RuleBasedStateMachine):
    """The guard, and a model of what devices did with its permission."""

    permits = Bundle("permits")

    def __init__(self) -> None:
        super().__init__()
        self.guard = Guard(limits=Limits(), firing=FIRING, admission=Admission(), arrival_deg=ARRIVAL_DEG)
        self.now_s = 0.0
        self.before = State.DISARMED
        self.was_reset = False
        self.issued: dict[str, Permit] = {}
        self.redeemed: list[tuple[float, Permit]] = []
        self.target_deg = math.nan
        self.fired: list[tuple[float, int]] = []
        self.read: tuple[float, float] = (math.nan, math.nan)
        self.follows_until_s: float | None = None
        self.turn: tuple[float, float] = (math.nan, math.nan)

    def tried(self, step: str, *arguments: object, **named: object) -> bool:
        """Whether the guard allowed a step."""
        self.before = self.guard.state
        self.was_reset = False
        try:
            getattr(self.guard, step)(*arguments, **named)
        except (DeviceError, ConfigError):
            return False
        return True

    @rule(seconds=st.sampled_from([0.0, 0.1, 0.5, 1.0, 3.0]))
    def time_goes_by(self, seconds: float) -> None:
        self.before = self.guard.state
        self.now_s += seconds

    @rule(by=st.sampled_from(["a person", ""]))
    def arm(self, by: str) -> None:
        if self.tried("arm", by=by):
            assert by
            assert self.before in (State.DISARMED, State.ARMED)

    @rule()
    def disarm(self) -> None:
        self.tried("disarm")

    @rule()
    def fail(self) -> None:
        self.tried("fail", "a fault")
        assert self.guard.state is State.FAULT

    @rule(by=st.sampled_from(["a person", ""]))
    def reset(self, by: str) -> None:
        if self.tried("reset", by=by):
            assert by
            assert self.before is State.FAULT
            assert self.guard.state is State.DISARMED
            self.was_reset = True

    @rule(angle_deg=ANGLES)
    def begin_move(self, angle_deg: float) -> None:
        if self.tried("begin_move", angle_deg):
            assert -35 <= angle_deg <= 35
            assert self.before is State.ARMED
            self.target_deg = angle_deg

    @rule(reached_deg=ANGLES)
    def end_move(self, reached_deg: float) -> None:
        if self.tried("end_move", reached_deg):
            assert self.before is State.MOVING
            assert abs(reached_deg - self.target_deg) <= ARRIVAL_DEG

    @rule()
    def arrive(self) -> None:
        self.end_move(self.target_deg)

    @rule(target=permits, angle_deg=ANGLES, pulses=PULSES)
    def issue(self, angle_deg: float, pulses: int) -> object:
        before = self.guard.state
        try:
            permit = self.guard.issue(angle_deg=angle_deg, pulses=pulses, now_s=self.now_s)
        except DeviceError:
            return multiple()
        assert before in (State.ARMED, State.FOLLOWING)
        if before is State.FOLLOWING:
            assert pulses <= FOLLOW.pulses
            assert self.follows_until_s is not None
            assert self.now_s <= self.follows_until_s
        assert permit.token not in self.issued
        assert permit.pulses == pulses
        assert 0 <= pulses <= FIRING.pulses_per_permit
        self.issued[permit.token] = permit
        assert sum(each.pulses for each in self.issued.values()) <= FIRING.pulses_per_session
        return permit

    @rule(permit=permits, off_deg=st.sampled_from([0.0, 0.05, 0.2, math.nan]))
    def redeem(self, permit: Permit, off_deg: float) -> None:
        angle_deg = permit.angle_deg + off_deg
        if not self.tried("redeem", permit, angle_deg=angle_deg, now_s=self.now_s):
            return
        assert self.before in (State.ARMED, State.FOLLOWING)
        sweep = isinstance(permit, SweepPermit)
        assert not (sweep and self.before is State.FOLLOWING)
        assert self.guard.state is (State.SWEEPING if sweep else State.FIRING)
        assert permit.token not in [old.token for _, old in self.redeemed]
        assert permit.token == list(self.issued)[-1]
        assert abs(angle_deg - permit.angle_deg) <= ARRIVAL_DEG
        assert -36.5 <= angle_deg <= 36.5
        assert self.now_s <= permit.expires_s
        self.redeemed.append((self.now_s, permit))
        self.fired.append((self.now_s, permit.pulses_in_1_s))
        self.read = angle_deg, self.now_s
        second = sum(pulses for then_s, pulses in self.fired if self.now_s - then_s < 1)
        assert second <= (FIRING if self.before is State.ARMED else FOLLOW).pulses_per_second

    @rule(target=permits, angle_deg=ANGLES, to_deg=ANGLES, pulses=st.integers(-1, 40), period_s=st.floats(0.02, 1))
    def issue_sweep(self, angle_deg: float, to_deg: float, pulses: int, period_s: float) -> object:
        before = self.guard.state
        try:
            wanted = SweepPermit(
                token="",
                angle_deg=angle_deg,
                pulses=pulses,
                expires_s=0.0,
                to_deg=to_deg,
                slowest_deg_s=2.0,
                fastest_deg_s=12.0,
                period_s=period_s,
            )
            permit = self.guard.issue_sweep(wanted, now_s=self.now_s)
        except (DeviceError, ConfigError):
            return multiple()
        assert before is State.ARMED
        assert permit.token not in self.issued
        assert 0 <= pulses <= FIRING.pulses_per_sweep
        assert -35 <= to_deg <= 35
        assert permit.expires_s == self.now_s + FIRING.lifetime_s
        self.issued[permit.token] = permit
        assert sum(each.pulses for each in self.issued.values()) <= FIRING.pulses_per_session
        return permit

    @rule(speed_deg_s=st.sampled_from([0.0, 1.0, 5.0, 12.0, 30.0, -5.0, math.nan]), seconds=st.floats(0, 0.2))
    def read_sweep(self, speed_deg_s: float, seconds: float) -> None:
        self.now_s += seconds
        permit = self.redeemed[-1][1] if self.redeemed else None
        (before_deg, before_s) = self.read
        forward = permit.forward if isinstance(permit, SweepPermit) else 1.0
        angle_deg = before_deg + forward * speed_deg_s * seconds
        if not self.tried("read_sweep", angle_deg, now_s=self.now_s):
            return
        assert self.before is State.SWEEPING
        assert isinstance(permit, SweepPermit)
        assert 0 < self.now_s - before_s <= SWEEP_READING_S
        assert self.now_s <= permit.expires_s
        low_deg, high_deg = sorted((permit.angle_deg, permit.to_deg))
        assert low_deg - ARRIVAL_DEG <= angle_deg <= high_deg + ARRIVAL_DEG
        # What two readings may be off by is part of the limit of speed.
        assert abs(speed_deg_s) * (self.now_s - before_s) <= 12.0 * (self.now_s - before_s) + 1.001 * ARRIVAL_DEG
        self.read = angle_deg, self.now_s

    @rule(off_deg=st.sampled_from([0.0, 0.05, 0.2, math.nan]), pulses=st.integers(-1, 45))
    def end_sweep(self, off_deg: float, pulses: int) -> None:
        self.now_s += 0.05
        angle_deg = self.read[0] + off_deg
        if self.tried("end_sweep", angle_deg, pulses=pulses, now_s=self.now_s):
            permit = self.redeemed[-1][1]
            assert self.before is State.SWEEPING
            assert self.guard.state is State.ARMED
            assert abs(off_deg) <= ARRIVAL_DEG
            assert 0 <= pulses <= permit.pulses
            self.fired.append((self.now_s, permit.pulses_in_1_s))

    @rule(to_deg=st.floats(-35, 35), pulses=st.integers(1, 30), readings=st.integers(0, 5))
    def sweep(self, to_deg: float, pulses: int, readings: int) -> None:
        """The regular order of the steps of a sweep, as far as the guard permits."""
        permit = self.issue_sweep(0.0, to_deg, pulses, 0.1)
        if isinstance(permit, SweepPermit):
            self.redeem(permit, 0.0)
            for _ in range(readings):
                self.read_sweep(5.0, 0.1)
            self.end_sweep(0.0, 1)

    @rule(angle_deg=st.floats(-35, 35), pulses=st.integers(0, 8))
    def measure(self, angle_deg: float, pulses: int) -> None:
        """The regular order of steps, as far as the guard permits."""
        self.begin_move(angle_deg)
        self.end_move(angle_deg)
        permit = self.issue(angle_deg, pulses)
        if isinstance(permit, Permit):
            self.redeem(permit, 0.0)
            self.end_fire(permit.pulses)

    @rule(by=st.sampled_from(["a person", ""]))
    def begin_following(self, by: str) -> None:
        if self.tried("begin_following", FOLLOW, by=by, now_s=self.now_s):
            assert by
            assert self.before in (State.ARMED, State.FOLLOWING)
            self.follows_until_s = self.now_s + FOLLOW.duration_s

    @rule()
    def end_following(self) -> None:
        if self.tried("end_following"):
            assert self.before is State.FOLLOWING
            assert self.guard.state is State.ARMED

    @rule(to_deg=ANGLES, from_deg=ANGLES)
    def begin_turn(self, to_deg: float, from_deg: float) -> None:
        if self.tried("begin_turn", to_deg, from_deg=from_deg, now_s=self.now_s):
            assert self.before is State.FOLLOWING
            assert self.follows_until_s is not None
            assert self.now_s <= self.follows_until_s
            assert -10 <= to_deg <= 12
            assert -10 <= from_deg <= 12
            assert abs(to_deg - from_deg) <= 5
            self.turn = (from_deg, to_deg)
            self.read = from_deg, self.now_s

    @rule(from_deg=st.floats(-10, 12), way_deg=st.floats(-5, 5))
    def begin_short_turn(self, from_deg: float, way_deg: float) -> None:
        self.begin_turn(from_deg + way_deg, from_deg)

    @rule(speed_deg_s=st.sampled_from([0.0, 1.0, 5.0, 6.0, 12.0, -5.0, math.nan]), seconds=st.floats(0, 0.2))
    def read_turn(self, speed_deg_s: float, seconds: float) -> None:
        self.now_s += seconds
        (from_deg, to_deg) = self.turn
        (before_deg, before_s) = self.read
        angle_deg = before_deg + math.copysign(1.0, to_deg - from_deg) * speed_deg_s * seconds
        if not self.tried("read_turn", angle_deg, now_s=self.now_s):
            return
        assert self.before is State.TURNING
        assert 0 < self.now_s - before_s <= SWEEP_READING_S
        low_deg, high_deg = sorted((from_deg, to_deg))
        assert low_deg - ARRIVAL_DEG <= angle_deg <= high_deg + ARRIVAL_DEG
        assert abs(speed_deg_s) * seconds <= 1.25 * 5.0 * seconds + 1.001 * ARRIVAL_DEG
        self.read = angle_deg, self.now_s

    @rule(off_deg=st.sampled_from([0.0, 0.05, 0.2, math.nan]))
    def end_turn(self, off_deg: float) -> None:
        self.now_s += 0.05
        if self.tried("end_turn", self.read[0] + off_deg, now_s=self.now_s):
            assert self.before is State.TURNING
            assert self.guard.state is State.FOLLOWING
            assert abs(off_deg) <= ARRIVAL_DEG

    @rule(from_deg=st.floats(-9, 11), way_deg=st.floats(-1, 1), readings=st.integers(0, 4), pulses=st.integers(0, 4))
    def follow(self, from_deg: float, way_deg: float, readings: int, pulses: int) -> None:
        """The regular order of the steps of following, as far as the guard permits."""
        self.arm("a person")
        self.begin_following("a person")
        self.begin_turn(from_deg + way_deg, from_deg)
        for _ in range(readings):
            self.read_turn(1.0, 0.1)
        self.end_turn(0.0)
        permit = self.issue(self.read[0], pulses)
        if isinstance(permit, Permit):
            self.redeem(permit, 0.0)
            self.end_fire(permit.pulses)

    @rule(fired=st.integers(0, 10))
    def end_fire(self, fired: int) -> None:
        if self.tried("end_fire", fired):
            assert self.before is State.FIRING
            assert fired == self.redeemed[-1][1].pulses

    @invariant()
    def nothing_is_followed_without_a_person(self) -> None:
        following = self.guard.state in (State.FOLLOWING, State.TURNING)
        was = self.before in (State.ARMED, State.FOLLOWING, State.TURNING, State.FIRING)
        assert not following or (was and self.follows_until_s is not None)

    @invariant()
    def fault_is_left_by_a_reset_alone(self) -> None:
        if self.before is State.FAULT and self.guard.state is not State.FAULT:
            assert self.was_reset
        assert (self.guard.fault is None) == (self.guard.state is not State.FAULT)

    @invariant()
    def pulses_are_no_more_than_permitted(self) -> None:
        fired = sum(permit.pulses for _, permit in self.redeemed)
        permitted = sum(permit.pulses for permit in self.issued.values())
        assert fired <= permitted == self.guard.pulses_permitted <= FIRING.pulses_per_session

    @invariant()
    def nothing_fires_but_by_the_last_permit(self) -> None:
        if self.guard.state in (State.FIRING, State.SWEEPING):
            assert self.redeemed
            assert self.redeemed[-1][1].token == list(self.issued)[-1]


TestTraces = Traces.TestCase
TestTraces.settings = settings(
    max_examples=examples(TRACES),
    stateful_step_count=40,
    deadline=None,
    derandomize=True,
    suppress_health_check=list(HealthCheck),
)
