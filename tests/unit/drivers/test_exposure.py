"""Skin exposure beside the published limits, and what is shown of it when a rig is armed."""

from __future__ import annotations

import math

import pytest

from markerseek.core import ConfigError
from markerseek.drivers import LaserBoxSettings, exposure_line
from markerseek.drivers.exposure import CAVEAT, correction_c_a, skin_limit_j_m2

NAN = math.nan
INF = math.inf

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


@pytest.mark.parametrize("train_s", [30.0, 60.0])
def test_the_marker_diode_reaches_its_limits_as_published(train_s: float) -> None:
    """2 uJ on a spot of 1 mm, as in physics.md: a pulse is at 0.9 %, 1162 pulses a second without a pause at all."""
    pulse_j_m2 = 2e-6 / (math.pi * 0.5e-3**2)
    assert pulse_j_m2 / skin_limit_j_m2(wavelength_nm=785, duration_s=100e-9) == pytest.approx(0.0086, rel=3e-3)
    limit_j_m2 = skin_limit_j_m2(wavelength_nm=785, duration_s=train_s)
    assert pulse_j_m2 * 1162 * train_s / limit_j_m2 == pytest.approx(1.0, rel=3e-3)


LIGHT = {"wavelength_nm": 785.0, "pulse_energy_j": 2e-6, "pulse_width_s": 100e-9, "spot_diameter_m": 1e-3}


def test_the_exposure_by_a_rig_s_laser_is_one_line_that_names_the_officer() -> None:
    laser = LaserBoxSettings(port="p", pulses=16, rate_hz=1000.0, **LIGHT)  # type: ignore[arg-type]
    assert exposure_line(laser) == (
        "skin exposure: a pulse is 0.9% of its limit, an acquisition of 16 pulses 0.7%, 1000 Hz without a pause 88.0%. "
        "A laser safety officer must confirm this; the eye's limit is hundreds of times lower."
    )


def test_the_keys_that_are_missing_are_named() -> None:
    laser = LaserBoxSettings(port="p", wavelength_nm=785.0, pulse_width_s=1e-7)
    assert exposure_line(laser) == (
        f"skin exposure: not shown, the rig file has no laser.pulse_energy_j, laser.spot_diameter_m. {CAVEAT}"
    )
