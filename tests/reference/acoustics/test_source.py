"""Pulses of sources and lasers against numerical solutions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, simpson

from markerseek.acoustics import GaussianAbsorber, GaussianPulse, RectanglePulse

C = 1540.0
A = 0.15e-3
F = np.linspace(0.2e6, 12e6, 60)


def poisson(p0, r: float, t: float) -> float:
    """Poisson's formula: p(r, t) = d/dt [t · mean of p0 over the sphere of radius ct about the receiver].

    For a ball p0(x) about the origin the mean over that sphere is an integral over the distances x that it cuts.
    """

    def t_times_mean(t: float) -> float:
        low = abs(r - C * t)
        high = r + C * t
        edge = min(high, 6 * A)
        if low >= edge:
            return 0.0
        integral = quad(lambda x: p0(x) * x, low, edge, epsabs=0, epsrel=1e-9, limit=200)[0]
        return t * integral / (2 * r * C * t)

    step = 1e-10
    return (t_times_mean(t + step) - t_times_mean(t - step)) / (2 * step)


def test_spectrum_is_that_of_poissons_formula() -> None:
    source = GaussianAbsorber(radius_m=A)

    def p0(x: float) -> float:
        return math.exp(-((x / A) ** 2))

    r = 5e-3
    tau = np.linspace(-5 * A / C, 5 * A / C, 1501)
    pulse = np.array([r * poisson(p0, r, r / C + moment) for moment in tau])
    numeric = np.array([simpson(pulse * np.exp(-2j * np.pi * f * tau), x=tau) for f in F])
    closed = source.spectrum(F, sound_speed_m_s=C)
    assert np.abs(closed - numeric).max() < 5e-3 * np.abs(closed).max()


def test_at_low_frequencies_only_the_heated_volume_counts() -> None:
    """Far below 1/radius Q = i k V/(4π c), with V the integral of p0."""
    f = np.array([1e4])
    k = 2 * math.pi * f / C
    volume = math.pi**1.5 * A**3
    spectrum = GaussianAbsorber(radius_m=A).spectrum(f, sound_speed_m_s=C)
    np.testing.assert_allclose(spectrum, 1j * k * volume / (4 * math.pi * C), rtol=1e-4)


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
