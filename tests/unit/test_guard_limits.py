"""Ranges, the lease and the exposure figures of the guard, case by case; NaN and infinity among the cases of each."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from markerseek.core import ConfigError, Interval, LimitError
from markerseek.guard import Lease, Limits, SkinExposure
from markerseek.guard.exposure import CAVEAT, correction_c_a, skin_limit_j_m2

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
        "the stage says that it stands at 36.6 deg, outside its travel range [-36.5, 36.5] deg; "
        "check the probe and the stage's zero"
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


MJ_CM2 = 10.0
"""J/m² in one mJ/cm²."""


@pytest.mark.parametrize(
    ("wavelength_nm", "duration_s", "limit_mj_cm2"),
    [
        # physics.md, at 785 nm: 29.6 up to 100 ns, 43.3 for 500 ns; 296 mW/cm² for ever.
        (785, 1e-9, 29.6),
        (785, 100e-9, 29.6),
        (785, 500e-9, 43.3),
        (785, 100.0, 29_600.0),
        # Beside C_A = 1: 20 mJ/cm²; 1.1 J/cm² for a second; and the two sides of 10 s.
        (532, 10e-9, 20.0),
        (532, 1.0, 1100.0),
        (532, 10.0, 1956.1),
        (532, math.nextafter(10, 11), 2000.0),
        (1064, 10e-9, 100.0),
    ],
)
def test_the_skin_limits_are_the_published_ones(wavelength_nm: float, duration_s: float, limit_mj_cm2: float) -> None:
    limit_j_m2 = skin_limit_j_m2(wavelength_nm=wavelength_nm, duration_s=duration_s)
    assert limit_j_m2 == pytest.approx(limit_mj_cm2 * MJ_CM2, rel=1.2e-3)


def test_the_constants_of_the_limits_are_exact() -> None:
    assert skin_limit_j_m2(wavelength_nm=532, duration_s=1e-8) == 200.0
    assert skin_limit_j_m2(wavelength_nm=532, duration_s=1.0) == 11_000.0
    assert skin_limit_j_m2(wavelength_nm=532, duration_s=100.0) == 200_000.0


@pytest.mark.parametrize(
    ("wavelength_nm", "c_a"), [(400, 1.0), (700, 1.0), (800, 10**0.2), (1049.9, 10**0.6998), (1050, 5.0), (1400, 5.0)]
)
def test_the_correction_of_wavelength(wavelength_nm: float, c_a: float) -> None:
    assert correction_c_a(wavelength_nm) == pytest.approx(c_a, rel=3e-3)


@pytest.mark.parametrize("wavelength_nm", [399.9, 1400.1, NAN])
def test_a_wavelength_without_a_limit_is_refused(wavelength_nm: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        skin_limit_j_m2(wavelength_nm=wavelength_nm, duration_s=1e-7)
    assert str(refusal.value) == f"exposure: wavelength_nm is {wavelength_nm} nm, the limits hold in [400, 1400] nm"


@pytest.mark.parametrize("duration_s", [0.0, 0.9e-9, INF, NAN])
def test_a_duration_without_a_limit_is_refused(duration_s: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        skin_limit_j_m2(wavelength_nm=785, duration_s=duration_s)
    assert str(refusal.value) == f"exposure: a duration of {duration_s} s, the limits hold from 1 ns on"


def diode(**changes: float) -> SkinExposure:
    """2 uJ on a spot of 1 mm, as in physics.md."""
    plain = {
        "wavelength_nm": 785.0,
        "pulse_s": 100e-9,
        "energy_j": 2e-6,
        "spot_m2": math.pi * 0.5e-3**2,
        "rate_hz": 1162.0,
        "train_s": 60.0,
    }
    return SkinExposure(**(plain | changes))


def test_the_marker_diode_beside_its_limits_and_the_officer_named() -> None:
    exposure = diode()
    assert exposure.pulse_share == pytest.approx(0.0086, rel=3e-3)
    assert exposure.train_share == pytest.approx(1.0, rel=3e-3)
    assert diode(train_s=30.0).train_share == pytest.approx(1.0, rel=3e-3)
    assert diode(rate_hz=581.0).train_share == pytest.approx(0.5, rel=3e-3)
    assert str(exposure) == f"skin: a pulse is 0.9% of its limit, the train 100.0%. {CAVEAT}"
    assert re.search("laser safety officer must confirm", CAVEAT)


@pytest.mark.parametrize("name", ["energy_j", "spot_m2", "rate_hz"])
@pytest.mark.parametrize("value", [0.0, -1.0, INF, NAN])
def test_an_exposure_needs_numbers(name: str, value: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        diode(**{name: value})
    assert str(refusal.value) == f"exposure: {name} is {value}, it must be positive and finite"
