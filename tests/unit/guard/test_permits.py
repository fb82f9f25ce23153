"""Leave to fire: written once, taken back once, out of three budgets."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from markerseek.core import ConfigError, LaserError, LimitError
from markerseek.guard import FiringLimits, Permits


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


def test_a_permit_is_good_once() -> None:
    permits = Permits(FiringLimits())
    permit = permits.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    permits.redeem(permit, now_s=0.0)
    with pytest.raises(LaserError) as refusal:
        permits.redeem(permit, now_s=0.0)
    assert str(refusal.value) == not_open("permit-1")


def test_a_permit_that_was_replaced_voided_or_altered_is_void() -> None:
    permits = Permits(FiringLimits())
    first = permits.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    second = permits.issue(angle_deg=0.0, pulses=16, now_s=0.0)
    for other in (first, replace(second, pulses=17), replace(second, angle_deg=1.0), replace(second, expires_s=99.0)):
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


@pytest.mark.parametrize("name", ["pulses_per_permit", "pulses_per_second", "pulses_per_session"])
@pytest.mark.parametrize("value", [0, -1, math.nan])
def test_pulses_that_limit_nothing_are_refused(name: str, value: int) -> None:
    with pytest.raises(ConfigError) as refusal:
        FiringLimits(**{name: value})
    assert str(refusal.value) == f"firing limits: {name} is {value}, it must be a whole number of at least 1"
    assert getattr(FiringLimits(**{name: 1}), name) == 1


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


@pytest.mark.parametrize("pulses", [-1, math.nan])
def test_pulses_of_before_cannot_be_taken_back(pulses: int) -> None:
    permits = Permits(FiringLimits())
    with pytest.raises(ConfigError) as refusal:
        permits.charge(pulses)
    assert str(refusal.value) == f"permits: {pulses} pulses cannot have been permitted before; count them again"
    assert permits.pulses_permitted == 0
