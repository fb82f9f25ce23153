"""Ranges and the lease of the guard, case by case; NaN and infinity among the cases of each."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, Interval, LimitError
from markerseek.guard import Lease, Limits

NAN, INF = math.nan, math.inf


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
