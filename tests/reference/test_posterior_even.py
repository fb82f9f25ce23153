"""The likelihood of an even curve, and the choice of the next angle by it, against SciPy and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from markerseek.search.posterior._variance import expected_variance
from markerseek.search.posterior.even import (
    LENGTH,
    LOG_LEVELS,
    LOUD,
    MOST_LOUD,
    OWN,
    STRAYS,
    even_log_likelihood,
    kinds_of,
    loud_ones,
)
from markerseek.search.posterior.grid import ERRORS, LEVELS, Heard
from markerseek.search.posterior.heard import LOW, SPOILT, SPOILT_RANGE, STEP, log_tables
from markerseek.search.posterior.shapes import STEP_DEG, family

SHAPES = family()
MEMBERS = np.array([10, 40])
LOG_A = np.linspace(-3.0, 3.0, 6001)


def heard(angle_deg, log_intensity, noise=0.02, ratio=10.0):
    return Heard(angle_deg=angle_deg, log_intensity=log_intensity, noise=noise, cells=10_000, ratio=ratio)


def log_levels(member, distance_deg):
    """Ln S of a shape, by NumPy's interpolation."""
    return np.interp(distance_deg, np.arange(SHAPES.log_curve.shape[1]) * STEP_DEG, SHAPES.log_curve[member])


def stray(log_level):
    return np.interp(-log_level, -LOG_LEVELS, STRAYS)


def covariance(member, distance_deg, noise, own):
    """Of ln y, written out."""
    s = stray(log_levels(member, distance_deg))
    apart = (distance_deg[:, None] - distance_deg) / (LENGTH * SHAPES.fwhm_deg[member])
    return np.outer(s, s) / (1 + apart**2 / 2) + np.diag(noise**2 + own**2)


def brute_force(samples, angle_deg, member, own):
    """Ln p, the amplitude summed over a fine grid, and any one sample spoilt."""
    heard_deg = np.array([sample.angle_deg for sample in samples])
    value = np.array([sample.log_intensity for sample in samples]) - log_levels(member, np.abs(heard_deg - angle_deg))
    whole = covariance(member, np.abs(heard_deg - angle_deg), np.array([sample.noise for sample in samples]), own)

    def evidence(kept):
        density = multivariate_normal(np.zeros(len(kept)), whole[np.ix_(kept, kept)])
        return float(np.sum(density.pdf(value[kept] - LOG_A[:, None])) * (LOG_A[1] - LOG_A[0]))

    every = list(range(len(samples)))
    total = evidence(every) + SPOILT / SPOILT_RANGE * sum(evidence(every[:i] + every[i + 1 :]) for i in every)
    return math.log(total)


@pytest.mark.parametrize("bump", [0.0, 0.8])
def test_loud_samples_against_scipys_normal_distribution(bump):
    """Amplitude integrated out, and one frame of five perhaps spoilt: SciPy's density, summed over both."""
    angles_deg = np.array([-1.0, 0.0, 0.6])
    samples = [heard(t, float(log_levels(10, abs(t))) + 0.1) for t in (-3.0, -1.5, 0.5, 1.8, 3.3)]
    samples[3] = heard(1.8, samples[3].log_intensity + bump)
    kinds = kinds_of(SHAPES, MEMBERS)
    found, _ = even_log_likelihood(SHAPES, kinds, samples, angles_deg)
    for row, angle_deg in zip(found, angles_deg, strict=True):
        for log_p, member, own in zip(row, kinds.member, kinds.own, strict=True):
            assert log_p == pytest.approx(brute_force(samples, angle_deg, member, own), abs=1e-4)


def test_a_faint_sample_counts_by_its_table():
    """At the amplitude that the loud ones give, and with the table's own error of its level."""
    loud = [heard(t, float(log_levels(10, abs(t)))) for t in (-2.0, 0.0, 2.5)]
    faint = heard(20.0, -3.0, noise=0.24, ratio=1.0)
    kinds = kinds_of(SHAPES, np.array([10]))
    without, log_amplitude = even_log_likelihood(SHAPES, kinds, loud, np.array([0.2]))
    found, _ = even_log_likelihood(SHAPES, kinds, [*loud, faint], np.array([0.2]))
    level = float(log_levels(10, 19.8))
    error = float(ERRORS[np.searchsorted(-LEVELS, -level)])
    table = log_tables(noise=0.24, cells=10_000, errors=(error,))[0]
    for kind in range(kinds.member.size):
        place = round((log_amplitude[0, kind] + level + 3.0 - LOW) / STEP)
        assert found[0, kind] - without[0, kind] == pytest.approx(table[place], abs=1e-6)


@settings(max_examples=60, deadline=None)
@given(
    angle_deg=st.floats(-20, 20),
    offsets=st.lists(st.floats(0.5, 6.0), min_size=3, max_size=6, unique=True),
    strays=st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6),
    mirrored=st.booleans(),
)
def test_whatever_the_curve_both_flanks_alike_give_its_middle(angle_deg, offsets, strays, mirrored):
    """Samples in pairs about a middle, equal on both sides, whatever they are: likeliest there, and even about it."""
    pairs = [
        (side * t, float(log_levels(10, t)) + e) for t, e in zip(offsets, strays, strict=False) for side in (-1, 1)
    ]
    samples = [heard(angle_deg + t, value) for t, value in pairs]
    if mirrored:
        samples.reverse()
    places = angle_deg + np.linspace(-1.0, 1.0, 21)
    log_p, _ = even_log_likelihood(SHAPES, kinds_of(SHAPES, MEMBERS), samples, places)
    np.testing.assert_allclose(log_p, log_p[::-1], atol=1e-6)
    posterior = np.exp(log_p - log_p.max()).sum(axis=1)
    assert float(posterior @ places) / posterior.sum() == pytest.approx(angle_deg, abs=1e-6)


def test_the_laser_is_as_unsteady_as_the_samples_say():
    """Repeated angles that differ by 15 % speak for an unsteady laser; equal ones for a steady one."""
    kinds = kinds_of(SHAPES, np.array([10]))
    errors = [error for error, _ in OWN]

    def likeliest(differ):
        samples = [heard(t, float(log_levels(10, 1.0)) + differ * k, noise=0.005) for t in (-1, 1) for k in (-1, 0, 1)]
        log_p, _ = even_log_likelihood(SHAPES, kinds, samples, np.array([0.0]))
        return float(kinds.own[np.argmax(log_p[0])])

    assert likeliest(0.15) == max(errors)
    assert likeliest(0.005) == min(errors)


def test_which_samples_are_loud():
    samples = [heard(float(k), 0.0, noise=0.01 + 0.001 * k) for k in range(20)]
    samples += [heard(30.0, 0.0, noise=1.01 / LOUD), heard(31.0, 0.0, noise=0.001, ratio=0.02)]
    loud = loud_ones(samples)
    assert [sample.angle_deg for sample in loud] == [float(k) for k in range(MOST_LOUD)]


@pytest.mark.parametrize("heard_deg", [(), (1.0, 4.5)])
def test_the_variance_expected_of_a_sample_is_the_sum_over_all_pairs(heard_deg):
    """Against the double sum written out in NumPy, for markers of two shapes; flanks that were heard tell of others."""
    rng = np.random.default_rng(4)
    floor, own = 4.2, 0.04
    theta_deg, member = rng.normal(3.0, 2.0, 40), rng.choice(MEMBERS, 40)
    log_snr, candidates_deg = rng.normal(4.0, 0.3, 40), np.array([-20.0, 0.0, 2.5, 8.0])
    heard_log = np.array([3.6, 3.9])[: len(heard_deg)]
    length_deg = LENGTH * SHAPES.fwhm_deg
    out = np.empty(candidates_deg.size)
    expected_variance(
        candidates_deg,
        theta_deg,
        member,
        SHAPES.log_curve,
        log_snr,
        STEP_DEG,
        floor,
        np.array(heard_deg, dtype=np.float64),
        heard_log,
        length_deg,
        LOG_LEVELS,
        STRAYS,
        own,
        out,
    )
    for candidate_deg, found in zip(candidates_deg, out, strict=True):
        height, spread = np.empty(40), np.empty(40)
        for p in range(40):
            distance_deg = abs(candidate_deg - theta_deg[p])
            level = float(log_levels(member[p], distance_deg))
            shift, left = 0.0, stray(level) ** 2
            if heard_deg:
                there_deg = np.abs(np.array(heard_deg) - theta_deg[p])
                twin = int(np.argmin(np.abs(there_deg - distance_deg)))
                alike = 1 / (1 + ((there_deg[twin] - distance_deg) / length_deg[member[p]]) ** 2 / 2)
                expected = float(log_levels(member[p], there_deg[twin]))
                shift = alike * stray(level) / stray(expected) * (heard_log[twin] - log_snr[p] - expected)
                left *= 1 - alike**2
            loud = math.exp(2 * (log_snr[p] + level + shift)) + floor**2
            height[p], spread[p] = 0.5 * math.log(loud), left + own**2 + 1 / loud
        apart = (height[:, None] - height) ** 2 / (spread[:, None] + spread)
        weight = (1 + apart / 8) ** -4
        weight /= weight.sum(axis=1, keepdims=True)
        variance = weight @ theta_deg**2 - (weight @ theta_deg) ** 2
        assert found == pytest.approx(variance.mean(), rel=1e-6)
