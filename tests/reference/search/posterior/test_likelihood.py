"""The likelihoods of the posterior search against SciPy, closed forms and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad, quad_vec
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.stats import expon, halfnorm, norm, rice, uniform
from scipy.stats import t as student

from markerseek.acoustics import Absorber, AcousticModel, GaussianAbsorber, Probe
from markerseek.core import USUAL_SOUND_SPEED_M_S, Reading, Sample
from markerseek.search.curve import KNEES, log_curve
from markerseek.search.posterior.arrival import _bending, _spline, off_plane, student_log_likelihood
from markerseek.search.posterior.arrival import log_likelihood as log_moments
from markerseek.search.posterior.asymmetry import (
    NOISE_SIGMA,
    POINT_SIGMA,
    SHIFT_M,
    SPOT_PRIOR,
    asymmetry_probability,
    mean_coherence,
    shift_scale_m,
    shifted_density,
)
from markerseek.search.posterior.grid import Grid
from markerseek.search.posterior.likelihood import (
    OUTLIER_RANGE,
    OUTLIER_SHARE,
    PEAK_NOISE,
    TABLE_HIGH,
    TABLE_LOW,
    TABLE_STEP,
    Observation,
    log_tables,
)
from markerseek.search.posterior.shapes import (
    FRESNEL_NUMBERS,
    MODEL_ERROR,
    STEP_DEG,
    WIDTHS_DEG,
    family,
    log_near_field,
)


@pytest.mark.parametrize("noise", [0.003, 0.03, 0.2])
@pytest.mark.parametrize("error", [0.0, 0.2])
def test_rician_density(noise, error):
    """Where no noise competes, the table is SciPy's Rice, its variance widened by the model's."""
    mu = np.exp(np.arange(TABLE_LOW, TABLE_HIGH + TABLE_STEP / 2, TABLE_STEP))
    spread = np.hypot(PEAK_NOISE * noise, error * mu)
    expected = (1 - OUTLIER_SHARE) * rice.pdf(1.0, mu / spread, scale=spread) + OUTLIER_SHARE / OUTLIER_RANGE
    table = np.exp(log_tables(noise=noise, cells=0, errors=(error,))[0])
    np.testing.assert_allclose(table, expected, rtol=1e-3)


@pytest.mark.parametrize(("noise", "cells"), [(0.01, 12_800), (0.1, 12_800), (0.2, 12_800), (0.24, 1000)])
def test_largest_of_the_marker_and_of_the_noise(noise, cells):
    """p(y|μ) of max(Rice, largest of M Rayleigh cells), by SciPy's distributions; to 5 % of the likeliest."""
    mu = np.exp(np.arange(TABLE_LOW, TABLE_HIGH + TABLE_STEP / 2, TABLE_STEP))
    rayleigh = rice(0.0, scale=noise)
    below = rayleigh.cdf(1.0) ** cells
    largest = cells * rayleigh.pdf(1.0) * rayleigh.cdf(1.0) ** (cells - 1)
    # The peak of the marker varies less than one cell of noise.
    marker = rice(mu / (PEAK_NOISE * noise), scale=PEAK_NOISE * noise)
    expected = marker.pdf(1.0) * below + largest * marker.cdf(1.0)
    expected = (1 - OUTLIER_SHARE) * expected + OUTLIER_SHARE / OUTLIER_RANGE
    table = np.exp(log_tables(noise=noise, cells=cells, errors=(0.0,))[0])
    np.testing.assert_allclose(table, expected, atol=0.05 * expected.max())


@pytest.mark.parametrize(("tail", "knee"), [(tail, knee) for tail, knee, _ in KNEES])
@pytest.mark.parametrize("fwhm_deg", [2.0, 35.0])
def test_width_and_tail_of_the_family(tail, knee, fwhm_deg):
    half, near, far = log_curve(
        np.array([fwhm_deg / 2, 40 * fwhm_deg, 80 * fwhm_deg]), fwhm_deg=fwhm_deg, tail=tail, knee=knee
    )
    assert half == pytest.approx(-math.log(2))
    if math.isfinite(tail):
        assert (near - far) / math.log(2) == pytest.approx(tail, rel=0.01)


@pytest.mark.parametrize("fresnel_number", [number for number, _ in FRESNEL_NUMBERS])
def test_the_near_field_against_quadrature(fresnel_number):
    """The field of a slit, exp(iπn(η − u)²) summed over −1 < η < 1, its square averaged over the band."""
    away = np.linspace(-1.5, 1.5, 13)
    numbers = fresnel_number * (1 + 0.2 * away)

    def envelope(across):
        field = quad_vec(lambda place: np.exp(1j * np.pi * numbers * (place - across) ** 2), -1.0, 1.0)[0]
        return float(np.sqrt(np.exp(-(away**2) / 2) @ (numbers * np.abs(field) ** 2)))

    log = log_near_field(np.array([0.0, 2.0, 3.0, 5.0, 7.0, 10.0]), fwhm_deg=10.0, fresnel_number=fresnel_number)
    half = brentq(lambda across: envelope(across) - envelope(0.0) / 2, 0.8, 2.0)
    expected = [envelope(half * share) / envelope(0.0) for share in (0.0, 0.4, 0.6, 1.0, 1.4, 2.0)]
    np.testing.assert_allclose(np.exp(log), expected, rtol=2e-3)


@pytest.mark.parametrize(
    ("height_m", "focus_m", "radius_m", "grain_m"),
    [
        (5e-3, 30e-3, 60e-3, 0.15e-3),
        (3e-3, None, 40e-3, 0.1e-3),
        (6e-3, 22e-3, 68e-3, 0.3e-3),
        (5.7e-3, None, 37e-3, 0.05e-3),
    ],
)
def test_the_family_holds_the_acoustic_models_curves(height_m, focus_m, radius_m, grain_m):
    """Some member follows the energy of a middle channel's peak to the model error: 8 % of the top, 25 % below."""
    model = AcousticModel(probe=Probe(element_height_m=height_m, elevation_focus_m=focus_m))
    spot = [Absorber(radius_m=radius_m, source=GaussianAbsorber(radius_m=grain_m))]
    distance_deg = np.concatenate([np.arange(0, 4, 0.5), np.arange(4, 25, 2.0)])
    height = [float(np.abs(model.channel_data(spot, angle_deg=float(angle))[64]).max()) for angle in distance_deg]
    curve = np.log(np.array(height) / height[0])
    shapes = family()
    members = shapes.log_curve[:, np.rint(distance_deg / STEP_DEG).astype(int)]
    allowed = np.where(curve > math.log(0.5), 0.08, 0.25)
    missed = np.sqrt(np.mean(((members - curve) / allowed) ** 2, axis=1))
    assert missed.min() < 1.3
    assert 3 < shapes.fwhm_deg[np.argmin(missed)] < 17


def one_shape(angles_deg, *, samples, lowest, phases=1, amplitudes=300, member=40):
    grid = Grid(
        shapes=family(),
        angles_deg=angles_deg,
        members=np.array([member]),
        lowest=lowest,
        phases=phases,
        amplitudes=amplitudes,
        blur=0.0,
    )
    for sample in samples:
        grid.add(sample)
    return grid


def test_marginal_likelihood_against_brute_force():
    """The marginal over ln amplitude of three samples, each angle integrated by SciPy with SciPy's Rice."""
    shapes = family()
    member = 40
    sigma = 0.02
    cells = 12_800
    measured = [(-4.0, 0.30), (1.0, 0.9), (4.5, 0.33)]
    samples = [
        Observation(angle_deg=angle, log_intensity=math.log(y), noise=sigma / y, cells=cells, lateral_ratio=1.0)
        for angle, y in measured
    ]
    angles_deg = np.linspace(-2, 2, 9)  # heights are rounded to the table's 2 %, hence the tolerance
    shares = one_shape(angles_deg, samples=samples, lowest=-2.0).marginals(np.zeros(9), particles=8).angle

    distances = np.arange(shapes.log_curve.shape[1]) * STEP_DEG

    def density(log_amplitude, theta):
        product = 1.0
        for angle, y in measured:
            level = np.interp(abs(angle - theta), distances, shapes.log_curve[member])
            error = next(error for least, error in MODEL_ERROR if math.exp(level) >= least)
            mu = math.exp(log_amplitude + level)
            spread = math.hypot(sigma, error * mu)
            below = (1 - math.exp(-(y**2) / (2 * sigma**2))) ** cells
            product *= (1 - OUTLIER_SHARE) * rice.pdf(
                y, mu / spread, scale=spread
            ) * below * y + OUTLIER_SHARE / OUTLIER_RANGE
        return product

    brute = np.array(
        [quad(density, -2.0, 4.0, args=(theta,), limit=100, epsabs=1e-6, epsrel=1e-4)[0] for theta in angles_deg]
    )
    np.testing.assert_allclose(shares, brute / brute.sum(), atol=0.02)


def test_standard_deviation_against_cramer_rao():
    """Samples on both flanks of a known shape: the posterior is as wide as the bound, amplitude unknown."""
    shapes = family()
    member = int(np.argmin(np.abs(WIDTHS_DEG - 8))) + WIDTHS_DEG.size * 3
    distances = np.arange(shapes.log_curve.shape[1]) * STEP_DEG
    places = np.array([-3.0, -2.5, -2.0, -1.5, 0.5, 1.5, 2.0, 2.5, 3.0])
    level = np.interp(np.abs(places), distances, shapes.log_curve[member])
    noise = 0.01
    samples = [
        Observation(angle_deg=float(t), log_intensity=float(s), noise=noise / math.exp(s), cells=100, lateral_ratio=1.0)
        for t, s in zip(places, level, strict=True)
    ]
    angles_deg = np.linspace(-1, 1, 401)
    marginals = one_shape(angles_deg, samples=samples, lowest=-0.6, amplitudes=60, member=member).marginals(
        np.zeros(401), particles=8
    )
    sigma_deg = math.sqrt(marginals.angle @ angles_deg**2 - (marginals.angle @ angles_deg) ** 2)
    slope = (np.interp(np.abs(places) + 0.05, distances, shapes.log_curve[member]) - level) / 0.05 * -np.sign(places)
    error = np.array([next(error for least, error in MODEL_ERROR if height >= least) for height in np.exp(level)])
    weight = 1 / (error**2 + (noise / np.exp(level)) ** 2)
    fisher = np.array([[weight @ slope**2, weight @ slope], [weight @ slope, weight.sum()]])
    assert sigma_deg == pytest.approx(math.sqrt(np.linalg.inv(fisher)[0, 0]), rel=0.1)


def test_range_is_linear_in_cosine_and_sine():
    """r² = A − C cos θ − S sin θ, fitted by least squares to the delays, gives the angle back."""
    theta = 12.0
    depth_m = 50e-3
    probe_deg = np.linspace(-35, 35, 15)
    range_m = off_plane(probe_deg - theta, face_radius_m=10e-3, depth_m=depth_m)[0] * USUAL_SOUND_SPEED_M_S + depth_m
    turned = np.radians(probe_deg)
    design = np.column_stack([np.ones(15), -np.cos(turned), -np.sin(turned)])
    _, c, s = np.linalg.lstsq(design, range_m**2, rcond=None)[0]
    assert math.degrees(math.atan2(s, c)) == pytest.approx(theta, abs=1e-6)


def moments_of(theta, measured_deg, *, height_m=5e-3, radius_m=11e-3):
    late_s, sine = off_plane(measured_deg - theta, face_radius_m=radius_m, depth_m=50e-3)
    spread_s = np.hypot(0.2e-6, height_m * sine / (2 * USUAL_SOUND_SPEED_M_S))
    return np.column_stack([33e-6 + 0.7e-6 + late_s, spread_s])


def test_exact_moments_point_at_the_marker():
    """With one outlier among the arrivals, and unknown offset, face radius and element height."""
    theta = -8.0
    measured_deg = np.array([-34.0, -20.0, -8.0, 5.0, 20.0, 34.0])
    moments_s = moments_of(theta, measured_deg)
    moments_s[4, 0] += 9e-6
    angles_deg = np.arange(-35.0, 36.0)
    log = log_moments(angles_deg, measured_deg, moments_s, np.array([20.0, 30.0, 100.0, 30.0, 20.0, 10.0]))
    assert abs(angles_deg[np.argmax(log)] - theta) <= 1
    assert log.max() - log[angles_deg == 25.0] > 5


def test_two_moments_determine_the_side():
    """One frame nearer than the other: the marker lies on the side of the earlier and shorter one."""
    angles_deg = np.arange(-35.0, 36.0)
    measured_deg = np.array([-10.0, 10.0])
    log = log_moments(angles_deg, measured_deg, moments_of(5.0, measured_deg), np.array([15.0, 60.0]))
    share = np.exp(log - log.max())
    assert share[angles_deg > 0].sum() > 0.9 * share.sum()


@pytest.mark.parametrize("knots", [2, 3, 4, 5, 71])
def test_the_spline_is_scipys_beyond_its_ends_too(knots: int) -> None:
    values = np.random.default_rng(knots).normal(size=knots)
    at = np.linspace(-4.0, 12.0, 1001)
    spline = _spline(-3.0, 14.0 / (knots - 1), values, _bending(knots) @ values, at)
    assert spline == pytest.approx(CubicSpline(np.linspace(-3.0, 11.0, knots), values)(at), rel=1e-9, abs=1e-9)


def test_moments_against_brute_force():
    """Laplace's method over the nuisances against a sum over a grid of them, with SciPy's Student."""
    design = np.array([[[1.0, 0.2], [1.0, 0.9], [1.0, 2.0]], [[1.0, 1.5], [1.0, 0.4], [1.0, 0.1]]])
    value = np.array([[0.1, 0.9, 2.2], [1.4, 0.45, 0.05]])
    scale = np.full((2, 3), 0.15)
    precision = np.array([1 / 4, 1.0])
    log = student_log_likelihood(design, value, scale, precision, iterations=8)
    a, b = np.meshgrid(np.linspace(-4, 4, 801), np.linspace(-4, 4, 801), indexing="ij")
    brute = []
    for rows, values in zip(design, value, strict=True):
        density = norm.pdf(a, scale=2) * norm.pdf(b)
        for row, each in zip(rows, values, strict=True):
            density = density * student.pdf((each - row[0] * a - row[1] * b) / 0.15, 4)
        brute.append(math.log(density.sum()))
    assert log[0] - log[1] == pytest.approx(brute[0] - brute[1], abs=0.1)


def coherence_of(*coherences):
    """Of samples 60 times as strong as noise."""
    readings = [Reading(intensity=60.0, focused_coherence=each) for each in coherences]
    return mean_coherence([Sample(angle_deg=0.0, reading=each) for each in readings], sigma=1.0)


def test_a_sample_without_an_intensity_says_nothing_of_the_coherence():
    """A reader of the user's own may state a coherence of a frame in which there is nothing."""
    silent, strong = (
        Sample(angle_deg=0.0, reading=Reading(intensity=each, focused_coherence=0.9)) for each in (0.0, 60.0)
    )
    assert mean_coherence([silent, strong], sigma=1.0) == mean_coherence([strong], sigma=1.0)
    assert mean_coherence([silent], sigma=1.0) is None


@pytest.mark.parametrize("width_m", [2e-3, 9e-3, 20e-3])
def test_a_spot_is_distinguished_from_a_point(width_m):
    """Bayes' rule with SciPy's densities; samples without a coherence say nothing."""

    def probability(*coherences):
        return asymmetry_probability(coherence_of(*coherences), width_m=width_m)

    sigma = math.hypot(POINT_SIGMA, math.hypot(POINT_SIGMA, NOISE_SIGMA / 60) / math.sqrt(2))
    of_point = 0.03 + 0.97 * halfnorm.pdf(0.02, scale=sigma)
    unresolved = 1 / (1 + (9e-3 / width_m) ** 6)
    of_spot = (1 - unresolved) * uniform.pdf(0.02) + unresolved * expon.pdf(0.02, scale=0.05)
    of_spot = 0.03 + 0.97 * of_spot
    expected = SPOT_PRIOR * of_spot / (SPOT_PRIOR * of_spot + (1 - SPOT_PRIOR) * of_point)
    assert probability(0.97, 0.99) == pytest.approx(expected)
    assert probability(1.0, 0.99, 0.995) < 0.25 < 0.5 < probability(0.8, 0.6)
    assert probability(None, None) == SPOT_PRIOR


def test_a_spot_of_which_hardly_any_sound_is_in_phase_is_no_point():
    """A third of the patches of 5 mm have coherences below 0.35; they passed for points with a probability of 0.7."""
    of_point, *of_spots = (
        asymmetry_probability(coherence_of(each, each), width_m=5e-3) for each in (0.99, 0.9, 0.5, 0.36, 0.34, 0.1)
    )
    assert of_point < 0.5 < 0.9 < min(of_spots)


def test_a_wide_curve_says_less_of_a_coherence_of_one():
    narrow, wide = (asymmetry_probability(coherence_of(1.0, 0.995), width_m=each) for each in (3e-3, 14e-3))
    assert narrow < 0.02 < 0.05 < wide < 0.5


def test_the_shift_of_an_asymmetric_marker():
    """A mixture of the density of the centre and of its convolution with SciPy's Student density."""
    angle_deg = np.arange(-1, 1.0001, 0.01)
    share = norm.pdf(angle_deg, scale=0.1) * 0.01
    wanted = np.linspace(-1.5, 1.5, 31)
    density = shifted_density(angle_deg, share, wanted, probability=0.3, scale_deg=0.3)
    shifted = np.sum(student.pdf(wanted[:, None] - angle_deg, 4, scale=0.3) * share, axis=1)
    np.testing.assert_allclose(density, 0.7 * norm.pdf(wanted, scale=0.1) + 0.3 * shifted, atol=2e-3)


def test_the_shift_grows_as_less_of_the_sound_is_in_phase_as_that_differs_and_with_the_width():
    point = coherence_of(1.0, 1.0)
    spot = coherence_of(0.5, 0.5)
    uneven = coherence_of(0.4, 0.6)
    assert uneven.scatter == pytest.approx(0.1)
    assert shift_scale_m(point, width_m=5e-3) == pytest.approx(SHIFT_M)
    assert shift_scale_m(spot, width_m=5e-3) == pytest.approx(0.13e-3)
    assert shift_scale_m(uneven, width_m=5e-3) == pytest.approx(0.28e-3)
    assert shift_scale_m(uneven, width_m=20e-3) == pytest.approx(0.56e-3)
    assert SHIFT_M < shift_scale_m(None, width_m=20e-3) < shift_scale_m(uneven, width_m=5e-3)
