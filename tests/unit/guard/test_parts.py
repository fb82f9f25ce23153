"""Permits out of three budgets, ranges of angles, and the lease; NaN and infinity among the cases."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import ConfigError, Interval, LaserError, LimitError
from markerseek.guard import FiringLimits, Lease, Limits, Permits

NAN = math.nan
INF = math.inf


def test_permits_are_named_once_and_expire() -> None:
    permits = Permits(FiringLimits(lifetime_s=5.0))
    first = permits.issue(angle_deg=1.0, pulses=16, now_s=10.0)
    second = permits.issue(angle_deg=2.0, pulses=8, now_s=11.0)
    assert (first.token, first.angle_deg, first.pulses, first.expires_s) == ("permit-1", 1.0, 16, 15.0)
    assert (second.token, second.angle_deg, second.pulses, second.expires_s) == ("permit-2", 2.0, 8, 16.0)
    assert permits.pulses_permitted == 24


@pytest.mark.parametrize("pulses", [-1, 129])
def test_one_acquisition_has_a_limit_of_pulses(pulses: int) -> None:
    permits = Permits(FiringLimits())
    with pytest.raises(LimitError) as refusal:
        permits.issue(angle_deg=0.0, pulses=pulses, now_s=0.0)
    assert str(refusal.value) == f"{pulses} pulses under one permit; the limit is 128: ask for fewer"
    assert permits.pulses_permitted == 0


@pytest.mark.parametrize("pulses", [0, 128])
def test_the_least_and_the_most_pulses_are_permitted(pulses: int) -> None:
    assert Permits(FiringLimits()).issue(angle_deg=0.0, pulses=pulses, now_s=0.0).pulses == pulses


def test_the_session_has_a_limit_of_pulses_and_counts_what_was_permitted() -> None:
    permits = Permits(FiringLimits(pulses_per_session=40))
    permits.issue(angle_deg=0.0, pulses=30, now_s=0.0)
    with pytest.raises(LimitError) as refusal:
        permits.issue(angle_deg=0.0, pulses=11, now_s=0.0)
    assert str(refusal.value) == (
        "30 pulses were permitted in this session and 11 more are asked for; the limit is 40: "
        "a person must start a new session"
    )
    permits.issue(angle_deg=0.0, pulses=10, now_s=0.0)
    assert permits.pulses_permitted == 40


def not_open(token: str) -> str:
    return f"the permit {token!r} is not open: used, voided or never issued; nothing was fired"


def test_a_permit_that_was_replaced_voided_or_altered_is_void() -> None:
    permits = Permits(FiringLimits())
    first = permits.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    second = permits.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    for other in (
        first,
        structs.replace(second, pulses=17),
        structs.replace(second, angle_deg=1.0),
        structs.replace(second, expires_s=99.0),
    ):
        with pytest.raises(LaserError, match="is not open"):
            permits.redeem(other, now_s=0.0)
    permits.redeem(second, now_s=0.0)
    third = permits.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    permits.void()
    permits.void()
    with pytest.raises(LaserError, match="is not open"):
        permits.redeem(third, now_s=0.0)


@pytest.mark.parametrize("now_s", [math.nextafter(15.0, 16.0), math.nan])
def test_an_expired_permit_is_refused_and_gone(now_s: float) -> None:
    permits = Permits(FiringLimits(lifetime_s=5.0))
    permit = permits.issue(angle_deg=0.0, pulses=16, now_s=10.0)
    with pytest.raises(LaserError) as refusal:
        permits.redeem(permit, now_s=now_s)
    assert str(refusal.value) == "the permit 'permit-1' has expired; nothing was fired; what took so long?"
    with pytest.raises(LaserError) as refusal:
        permits.redeem(permit, now_s=10.0)
    assert str(refusal.value) == not_open("permit-1")


def test_a_permit_holds_until_its_last_moment() -> None:
    permits = Permits(FiringLimits(lifetime_s=5.0))
    permits.redeem(permits.issue(angle_deg=0.0, pulses=16, now_s=10.0), now_s=15.0)


def fire(permits: Permits, pulses: int, now_s: float) -> None:
    permits.redeem(permits.issue(angle_deg=0.0, pulses=pulses, now_s=now_s), now_s=now_s)


def test_no_second_holds_more_pulses_than_its_limit() -> None:
    permits = Permits(FiringLimits(pulses_per_second=40))
    fire(permits, 20, 0.0)
    fire(permits, 20, 0.5)
    with pytest.raises(LimitError) as refusal:
        fire(permits, 1, 0.75)
    assert str(refusal.value) == (
        "40 pulses within a second and 1 more are asked for; the limit is 40: fire more slowly; nothing was fired"
    )
    with pytest.raises(LimitError, match="40 pulses within a second"):
        fire(permits, 1, math.nextafter(1.0, 0.0))
    fire(permits, 0, 0.9)
    fire(permits, 20, 1.0)
    with pytest.raises(LimitError, match="40 pulses within a second"):
        fire(permits, 1, 1.25)
    fire(permits, 20, 1.5)


def test_several_firings_leave_the_second_at_once() -> None:
    permits = Permits(FiringLimits(pulses_per_second=40))
    for _ in range(4):
        fire(permits, 10, 0.0)
    fire(permits, 40, 3.0)


@pytest.mark.parametrize("lifetime_s", [0.0, -1.0, 600.1, math.nan, math.inf])
def test_a_permit_without_an_end_is_refused(lifetime_s: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        FiringLimits(lifetime_s=lifetime_s)
    assert str(refusal.value) == f"firing limits: lifetime_s is {lifetime_s} s, it must lie in (0, 600] s"


def test_the_limits_unless_told_otherwise() -> None:
    limits = FiringLimits()
    assert (limits.pulses_per_permit, limits.pulses_per_second, limits.pulses_per_session) == (128, 1000, 100_000)
    assert limits.lifetime_s == 30.0
    assert FiringLimits(lifetime_s=600).lifetime_s == 600
    assert FiringLimits(lifetime_s=0.5).lifetime_s == 0.5


def test_pulses_of_before_count_as_those_of_now() -> None:
    permits = Permits(FiringLimits(pulses_per_session=100))
    permits.charge(40)
    permits.charge(0)
    permits.charge(20)
    assert permits.pulses_permitted == 60
    permits.issue(angle_deg=0.0, pulses=40, now_s=0.0)
    with pytest.raises(LimitError, match="100 pulses were permitted in this session and 1 more"):
        permits.issue(angle_deg=0.0, pulses=1, now_s=0.0)


@settings(deadline=None)
@given(angle_deg=st.floats(allow_nan=True, allow_infinity=True))
def test_an_angle_is_let_through_exactly_when_it_is_inside(angle_deg: float) -> None:
    limits = Limits()
    for require, most_deg in ((limits.require_search, 35.0), (limits.require_travel, 36.5)):
        if -most_deg <= angle_deg <= most_deg:
            require(angle_deg)
        else:
            with pytest.raises(LimitError):
                require(angle_deg)


@pytest.mark.parametrize("angle_deg", [35.0, -35.0])
def test_both_ends_of_the_search_are_inside(angle_deg: float) -> None:
    Limits().require_search(angle_deg)
    with pytest.raises(LimitError) as refusal:
        Limits().require_search(math.nextafter(angle_deg, 2 * angle_deg))
    assert str(refusal.value) == (
        f"angle {angle_deg:g} deg is outside the search range [-35, 35] deg; nothing was moved; ask for an angle inside"
    )


def test_a_readback_outside_the_travel_is_refused_with_its_cure() -> None:
    Limits().require_travel(36.5)
    with pytest.raises(LimitError) as refusal:
        Limits().require_travel(36.6)
    assert str(refusal.value) == (
        "the stage reads 36.6 deg, outside its travel range [-36.5, 36.5] deg; check the probe and the stage's zero"
    )


@pytest.mark.parametrize("search", [Interval(low_deg=-40, high_deg=35), Interval(low_deg=-35, high_deg=36.6)])
def test_a_search_range_outside_the_travel_is_refused(search: Interval) -> None:
    with pytest.raises(ConfigError) as refusal:
        Limits(search=search)
    assert str(refusal.value) == (
        f"limits: the search range {search} leaves the travel range [-36.5, 36.5] deg; "
        "widen the travel range or narrow the search range"
    )


def test_a_search_range_as_wide_as_the_travel_is_allowed() -> None:
    travel = Interval(low_deg=-36.5, high_deg=36.5)
    assert Limits(search=travel).travel == travel


@pytest.mark.parametrize("period_s", [0.0, -0.1, 1.001, NAN, INF])
def test_a_lease_without_a_period_is_refused(period_s: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        Lease(period_s=period_s)
    assert str(refusal.value) == f"lease: period_s is {period_s} s, it must lie in (0, 1] s"


def test_the_longest_lease_is_a_second() -> None:
    lease = Lease(period_s=1)
    lease.hold(now_s=5.0)
    assert lease.ends_s == 6.0


def test_a_lease_lapses_after_its_period_and_not_at_it() -> None:
    lease = Lease(period_s=0.5)
    assert not lease.lapsed(now_s=1e9)
    lease.hold(now_s=10.0)
    assert not lease.lapsed(now_s=10.5)
    assert lease.lapsed(now_s=10.75)
    assert lease.lapsed(now_s=NAN)


def test_only_a_step_above_all_before_renews_a_lease() -> None:
    lease = Lease(period_s=0.5)
    lease.hold(now_s=0.0)
    lease.beat(0, now_s=0.25)
    assert lease.ends_s == 0.5
    lease.beat(1, now_s=0.25)
    assert lease.ends_s == 0.75
    lease.beat(1, now_s=0.5)
    assert lease.ends_s == 0.75
    lease.beat(7, now_s=0.5)
    lease.beat(6, now_s=0.75)
    assert lease.ends_s == 1.0
    lease.beat(7, now_s=0.75)
    assert lease.ends_s == 1.0
    lease.beat(8, now_s=1.0)
    assert lease.ends_s == 1.5


def test_holding_again_renews_nothing() -> None:
    lease = Lease(period_s=0.5)
    lease.hold(now_s=0.0)
    lease.hold(now_s=0.25)
    assert lease.ends_s == 0.5


def test_a_beat_that_comes_too_late_revives_nothing_and_neither_does_holding() -> None:
    lease = Lease(period_s=0.5)
    lease.hold(now_s=0.0)
    lease.beat(1, now_s=0.75)
    lease.hold(now_s=0.75)
    assert lease.lapsed(now_s=0.75)
    lease.release()
    assert lease.ends_s is None
    assert not lease.lapsed(now_s=0.75)
    lease.hold(now_s=1.0)
    assert not lease.lapsed(now_s=1.5)


def test_a_step_told_while_nothing_is_held_is_used_up_and_holds_nothing() -> None:
    lease = Lease(period_s=0.5)
    lease.beat(5, now_s=0.0)
    assert lease.ends_s is None
    lease.hold(now_s=0.0)
    lease.beat(5, now_s=0.25)
    assert lease.ends_s == 0.5
