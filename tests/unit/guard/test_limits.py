"""Ranges of the guard, case by case; NaN and infinity among the cases."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, Interval, LimitError
from markerseek.guard import Limits


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
