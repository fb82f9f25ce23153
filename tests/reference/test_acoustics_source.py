"""Pulses of sources and lasers against numerical solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, simpson

from markerseek.acoustics import Disc, GaussianAbsorber, GaussianPulse, RectanglePulse, Sphere

C = 1540.0
A = 0.15e-3
F = np.linspace(0.2e6, 12e6, 60)


def poisson(p0, r: float, t: float) -> float:
    """Poisson's formula: p(r, t) = d/dt [t · mean of p0 over the sphere of radius ct about the place of hearing].

    For a ball p0(x) about the origin the mean over that sphere is an integral over the distances x that it cuts.
    """

    def t_times_mean(t: float) -> float:
        low, high = abs(r - C * t), r + C * t
        edge = min(high, 6 * A)
        if low >= edge:
            return 0.0
        points = [A] if low < A < edge else None
        integral = quad(lambda x: p0(x) * x, low, edge, points=points, epsabs=0, epsrel=1e-9, limit=200)[0]
        return t * integral / (2 * r * C * t)

    step = 1e-10
    return (t_times_mean(t + step) - t_times_mean(t - step)) / (2 * step)


BALLS = {
    "Gaussian": (GaussianAbsorber(radius_m=A), lambda x: math.exp(-((x / A) ** 2))),
    "sphere": (Sphere(radius_m=A), lambda x: 1.0 if x < A else 0.0),
}


@pytest.mark.parametrize("ball", BALLS.values(), ids=BALLS.keys())
def test_spectrum_of_a_ball_is_that_of_poissons_formula(ball) -> None:
    source, p0 = ball
    r = 5e-3
    tau = np.linspace(-5 * A / C, 5 * A / C, 1501)
    pulse = np.array([r * poisson(p0, r, r / C + moment) for moment in tau])
    numeric = np.array([simpson(pulse * np.exp(-2j * np.pi * f * tau), x=tau) for f in F])
    closed = source.spectrum(F, sound_speed_m_s=C)
    assert np.abs(closed - numeric).max() < 5e-3 * np.abs(closed).max()


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0, 30.0, 90.0])
def test_spectrum_of_a_disc_is_that_of_its_volume_summed_point_by_point(tilt_deg: float) -> None:
    radius, layer = 0.3e-3, 0.08e-3
    x = np.linspace(-radius, radius, 4001)
    z = np.linspace(-5 * layer, 5 * layer, 801)
    tilt = math.radians(tilt_deg)
    chord = 2 * np.sqrt(np.maximum(radius**2 - x**2, 0))
    closed = Disc(radius_m=radius, thickness_m=layer, tilt_deg=tilt_deg).spectrum(F, sound_speed_m_s=C)
    for f, expected in zip(F, closed, strict=True):
        k = 2 * math.pi * f / C
        across = simpson(chord * np.exp(-1j * k * math.sin(tilt) * x), x=x)
        through = simpson(np.exp(-((z / layer) ** 2)) * np.exp(-1j * k * math.cos(tilt) * z), x=z)
        numeric = 1j * k / (4 * math.pi * C) * across * through
        assert abs(numeric - expected) < 1e-3 * np.abs(closed).max()


def test_small_absorbers_of_one_volume_sound_alike_at_low_frequencies() -> None:
    """Far below 1/radius only the heated volume counts: Q = i k V/(4π c)."""
    f = np.array([1e4])
    k = 2 * math.pi * f / C
    for source, volume in (
        (Sphere(radius_m=A), 4 / 3 * math.pi * A**3),
        (GaussianAbsorber(radius_m=A), math.pi**1.5 * A**3),
        (Disc(radius_m=A, thickness_m=A / 10, tilt_deg=20.0), math.pi * A**2 * math.sqrt(math.pi) * A / 10),
    ):
        np.testing.assert_allclose(
            source.spectrum(f, sound_speed_m_s=C), 1j * k * volume / (4 * math.pi * C), rtol=1e-4
        )


def test_laser_spectra_are_transforms_of_the_light() -> None:
    t = np.linspace(-2e-6, 2e-6, 80001)
    width = 3e-7
    gaussian = np.exp2(-((2 * t / width) ** 2))
    assert t[gaussian >= 0.5].max() - t[gaussian >= 0.5].min() == pytest.approx(width, rel=1e-3)
    inside = np.linspace(-width / 2, width / 2, 20001)
    for f in F[::6]:
        numeric = simpson(gaussian * np.exp(-2j * np.pi * f * t), x=t) / simpson(gaussian, x=t)
        np.testing.assert_allclose(GaussianPulse(fwhm_s=width).spectrum(np.array([f])), [numeric], atol=1e-6)
        box = simpson(np.exp(-2j * np.pi * f * inside), x=inside) / width
        np.testing.assert_allclose(RectanglePulse(duration_s=width).spectrum(np.array([f])), [box], atol=1e-6)
