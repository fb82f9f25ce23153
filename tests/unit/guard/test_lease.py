"""The lease of the guard, case by case; NaN and infinity among the cases."""

from __future__ import annotations

import math

import pytest

from markerseek.core import ConfigError
from markerseek.guard import Lease

NAN, INF = math.nan, math.inf


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
