"""The likelihood of a symmetric curve, and the expected variance by it, against SciPy and brute force."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp, softmax
from scipy.stats import multivariate_normal

from markerseek.core import PAPER_RANGE, Floor, Interval, Reading, Sample, SweepTiming
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior import energy_spread
from markerseek.search.posterior.centre import refine
from markerseek.search.posterior.grid import ERRORS, LEVELS
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.likelihood import (
    OUTLIER_RANGE,
    OUTLIER_SHARE,
    PEAK_NOISE,
    STRONG_SNR,
    TABLE_LOW,
    TABLE_STEP,
    Observation,
    log_tables,
)
from markerseek.search.posterior.next_angle import expected_variance
from markerseek.search.posterior.shapes import STEP_DEG, family
from markerseek.search.posterior.symmetry import (
    CORRELATION_LENGTH,
    GROUP_WIDTHS,
    LOG_WIDTH_STEP,
    MAX_GROUPS,
    PULSE_ERRORS,
    SAMPLE_ERRORS,
    TEMPLATE_LOG_LEVELS,
    TEMPLATE_SIGMAS,
    Grouped,
    grouped,
    hypotheses_of,
    median_of,
    shift_sigmas_deg,
    symmetric_log_likelihood,
)
from tests.sizes import examples

SHAPES = family()
MEMBERS = np.array([10, 40])
LOG_A = np.linspace(-3.0, 3.0, 6001)


def observation(angle_deg, log_intensity, noise=0.02, ratio=10.0):
    return Observation(angle_deg=angle_deg, log_intensity=log_intensity, noise=noise, cells=10_000, lateral_ratio=ratio)


def log_levels(member, distance_deg):
    """Ln S of a shape, by NumPy's interpolation."""
    return np.interp(distance_deg, np.arange(SHAPES.log_curve.shape[1]) * STEP_DEG, SHAPES.log_curve[member])


def template_sigma(log_level):
    return np.interp(-log_level, -TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS)


def of_samples(samples):
    """Each strong sample in a group of its own."""
    return Grouped(
        strong=[[sample] for sample in samples if sample.strong],
        others=[sample for sample in samples if not sample.strong],
    )


def covariance(member, offset_deg, noise, error, blur_deg=0.0):
    """Of ln y, written out: template, width, and an angle that is known to its step only."""
    distance_deg = np.abs(offset_deg)
    step = math.exp(LOG_WIDTH_STEP / 2)
    s = template_sigma(log_levels(member, distance_deg))
    length_deg = CORRELATION_LENGTH * SHAPES.fwhm_deg[member]

    def alike(apart_deg):
        return 1 / (1 + (apart_deg / length_deg) ** 2 / 2)

    template = np.outer(s, s) * (
        alike(distance_deg[:, None] - distance_deg) + alike(distance_deg[:, None] + distance_deg)
    )
    template /= np.sqrt(np.outer(1 + alike(2 * distance_deg), 1 + alike(2 * distance_deg)))
    width = (log_levels(member, distance_deg / step) - log_levels(member, distance_deg * step)) / math.sqrt(12)
    slope = (
        log_levels(member, np.abs(offset_deg + blur_deg / 2)) - log_levels(member, np.abs(offset_deg - blur_deg / 2))
    ) / math.sqrt(12)
    return template + np.outer(width, width) + np.outer(slope, slope) + np.diag(noise**2 + error**2)


def shared_by_sweeps(samples, angle_deg, member):
    """Covariance of ln y by what shifts the angles of sweeps, to first order: S' of each times its shift."""
    offset_deg = np.array([sample.angle_deg for sample in samples]) - angle_deg
    steep = (log_levels(member, np.abs(offset_deg + STEP_DEG)) - log_levels(member, np.abs(offset_deg - STEP_DEG))) / (
        2 * STEP_DEG
    )
    shifts = np.zeros((len(samples), len(samples)))
    for i, one in enumerate(samples):
        for k, other in enumerate(samples):
            if one.sweep is not None and other.sweep is not None:
                shifts[i, k] = one.sweep.delay_sigma_s**2 * one.sweep.speed_deg_s * other.sweep.speed_deg_s
                shifts[i, k] += one.sweep.play_sigma_deg**2 * (one.sweep.number == other.sweep.number)
    return np.outer(steep, steep) * (shifts + np.diag([sample.angle_sigma_deg**2 for sample in samples]))


def brute_force(samples, angle_deg, member, error, blur_deg=0.0):
    """Ln p, the amplitude summed over a fine grid, and any one sample an outlier."""
    measured_deg = np.array([sample.angle_deg for sample in samples])
    value = np.array([sample.log_intensity for sample in samples]) - log_levels(
        member, np.abs(measured_deg - angle_deg)
    )
    noise = PEAK_NOISE * np.array([sample.noise for sample in samples])
    errors = error * np.array([sample.energy_share for sample in samples])
    whole = covariance(member, measured_deg - angle_deg, noise, errors, blur_deg)
    whole += shared_by_sweeps(samples, angle_deg, member)

    def evidence(kept):
        density = multivariate_normal(np.zeros(len(kept)), whole[np.ix_(kept, kept)])
        return float(np.sum(density.pdf(value[kept] - LOG_A[:, None])) * (LOG_A[1] - LOG_A[0]))

    every = list(range(len(samples)))
    total = evidence(every) + OUTLIER_SHARE / OUTLIER_RANGE * sum(evidence(every[:i] + every[i + 1 :]) for i in every)
    return math.log(total)


def swept(angle_deg, *, number, delay_s=0.005, play_deg=0.0, sigma_deg=0.02):
    """A sample of a sweep upwards with an odd number, of one downwards with an even one."""
    timing = SweepTiming(
        number=number,
        speed_deg_s=12.5 if number % 2 else -12.5,
        delay_sigma_s=delay_s,
        play_sigma_deg=play_deg,
    )
    at = observation(angle_deg, float(log_levels(10, abs(angle_deg))))
    return replace(at, sweep=timing, angle_sigma_deg=sigma_deg)


@pytest.mark.parametrize(
    "samples",
    [
        [swept(t, number=1) for t in (-3.0, -1.5, 0.5, 1.8, 3.3)],
        [swept(t, number=number) for number in (1, 2) for t in (-2.1, 0.3, 2.2)],
        [swept(t, number=number, play_deg=0.1 * (number == 2)) for number in (1, 2) for t in (-2.0, 0.4, 2.5)],
        [
            *(swept(t, number=1, delay_s=0.0) for t in (-2.0, 0.4, 2.5)),
            replace(observation(1.0, -0.1), energy_share=0.5),
        ],
    ],
)
def test_samples_of_sweeps_against_scipys_normal_distribution(samples):
    """A delay that all share, a play for each sweep, an error of each angle: normal unknowns, integrated out."""
    angles_deg = np.array([-0.2, 0.0, 0.3])
    hypotheses = hypotheses_of(SHAPES, MEMBERS, PULSE_ERRORS)
    found, _ = symmetric_log_likelihood(SHAPES, hypotheses, of_samples(samples), angles_deg)
    for row, angle_deg in zip(found, angles_deg, strict=True):
        for log_p, member, error in zip(row, hypotheses.member, hypotheses.sample_error, strict=True):
            assert log_p == pytest.approx(brute_force(samples, angle_deg, member, error), abs=2e-3)


def test_a_delay_widens_one_sweep_and_there_and_back_measures_it():
    """One way the delay is an error of the angle; the other direction shifts by as much to the other side."""
    places = np.arange(-0.6, 0.601, 0.01)
    angles = np.arange(-6.0, 6.01, 0.6)

    def sigma_deg(delay_s, *numbers, late_s=0.0):
        samples = [swept(t, number=number, delay_s=delay_s) for number in numbers for t in angles]
        off = [replace(each, angle_deg=each.angle_deg - late_s * each.sweep.speed_deg_s) for each in samples]
        log_p, _ = symmetric_log_likelihood(SHAPES, hypotheses_of(SHAPES, MEMBERS), of_samples(off), places)
        share = softmax(logsumexp(log_p, axis=1))
        mean_deg = share @ places
        return mean_deg, math.sqrt(share @ (places - mean_deg) ** 2)

    _, exact = sigma_deg(0.0, 1)
    _, one_way = sigma_deg(0.006, 1)
    shifted_deg, _ = sigma_deg(0.005, 1, late_s=0.01)
    both_deg, both = sigma_deg(0.005, 1, 2, late_s=0.01)
    assert one_way == pytest.approx(math.hypot(exact, 0.075), rel=0.15)
    assert shifted_deg == pytest.approx(-0.125, abs=0.03)
    assert abs(both_deg) < 0.02
    assert both < 1.2 * exact


def test_what_shifts_samples_is_shared_by_the_sweeps_as_their_timing_says():
    samples = [swept(0.0, number=1), swept(1.0, number=2, play_deg=0.1), observation(0.0, 0.0)]
    shifts = shift_sigmas_deg(samples)
    assert shifts.tolist() == [[0.0625, 0.0], [-0.0625, 0.1], [0.0, 0.0]]
    assert shift_sigmas_deg([observation(0.0, 0.0)]).shape == (1, 0)
    assert shift_sigmas_deg([swept(0.0, number=1, delay_s=0.0)]).shape == (1, 0)


def test_samples_of_two_sweeps_are_not_put_into_one_group():
    together = [swept(t, number=number) for number in (1, 2) for t in np.arange(-3, 3.01, 0.25)]
    groups = grouped(together, fwhm_deg=6.0).strong
    assert sum(map(len, groups)) == len(together)
    assert all(len({each.sweep.number for each in group}) == 1 for group in groups)


def test_a_weak_sample_counts_by_its_table():
    """At the amplitude that the strong ones give, and with the model error of its level."""
    strong = [observation(t, float(log_levels(10, abs(t)))) for t in (-2.0, 0.0, 2.5)]
    weak = observation(20.0, -3.0, noise=0.24, ratio=1.0)
    hypotheses = hypotheses_of(SHAPES, np.array([10]))
    without, log_amplitude = symmetric_log_likelihood(SHAPES, hypotheses, of_samples(strong), np.array([0.2]))
    found, _ = symmetric_log_likelihood(SHAPES, hypotheses, of_samples([*strong, weak]), np.array([0.2]))
    level = float(log_levels(10, 19.8))
    error = float(ERRORS[np.searchsorted(-LEVELS, -level)])
    table = log_tables(noise=0.24, cells=10_000, errors=(error,))[0]
    for kind in range(hypotheses.member.size):
        place = round((log_amplitude[0, kind] + level + 3.0 - TABLE_LOW) / TABLE_STEP)
        assert found[0, kind] - without[0, kind] == pytest.approx(table[place], abs=1e-6)


def test_weak_samples_beside_one_another_in_a_sweep_count_as_one():
    """The template is off by the same in all of them: a fast laser must not count that error a hundred times."""
    strong = [swept(t, number=1) for t in (-2.0, 0.0, 2.5)]
    weak = replace(swept(12.0, number=1), log_intensity=-3.0, noise=0.24, cells=10_000)
    hypotheses = hypotheses_of(SHAPES, MEMBERS)
    places = np.array([-0.2, 0.1])

    def log_likelihood(others):
        return symmetric_log_likelihood(SHAPES, hypotheses, grouped([*strong, *others], fwhm_deg=6.0), places)[0]

    one = log_likelihood([weak])
    np.testing.assert_allclose(log_likelihood([weak] * 20), one, rtol=0, atol=1e-6)
    apart = [weak, replace(weak, angle_deg=14.0)]
    both = log_likelihood(apart) - log_likelihood(apart[1:])
    np.testing.assert_allclose(both, one - log_likelihood([]), rtol=0, atol=1e-6)
    at_rest = replace(weak, sweep=None)
    twice = log_likelihood([at_rest] * 2) - log_likelihood([])
    np.testing.assert_allclose(twice, 2 * (log_likelihood([at_rest]) - log_likelihood([])), rtol=0, atol=1e-6)


@settings(max_examples=examples(60), deadline=None)
@given(
    angle_deg=st.floats(-20, 20),
    offsets=st.lists(st.floats(0.5, 6.0), min_size=3, max_size=6, unique=True),
    errors=st.lists(st.floats(-0.3, 0.3), min_size=6, max_size=6),
    mirrored=st.booleans(),
)
def test_equal_flanks_of_any_form_give_the_centre(angle_deg, offsets, errors, mirrored):
    """Pairs of samples, equal on both sides of a centre: the posterior is symmetric about that centre."""
    pairs = [
        (side * t, float(log_levels(10, t)) + e) for t, e in zip(offsets, errors, strict=False) for side in (-1, 1)
    ]
    samples = [observation(angle_deg + t, value) for t, value in pairs]
    if mirrored:
        samples.reverse()
    places = angle_deg + np.linspace(-1.0, 1.0, 21)
    log_p, _ = symmetric_log_likelihood(SHAPES, hypotheses_of(SHAPES, MEMBERS), of_samples(samples), places)
    np.testing.assert_allclose(log_p, log_p[::-1], atol=1e-6)
    posterior = np.exp(log_p - log_p.max()).sum(axis=1)
    assert float(posterior @ places) / posterior.sum() == pytest.approx(angle_deg, abs=1e-6)


def test_the_laser_error_is_inferred_from_repeated_samples():
    """Repeated angles that differ by 15 % speak for an unsteady laser; equal ones for a steady one."""
    hypotheses = hypotheses_of(SHAPES, np.array([10]))
    errors = [error for error, _ in SAMPLE_ERRORS]

    def likeliest(differ):
        samples = [
            observation(t, float(log_levels(10, 1.0)) + differ * k, noise=0.005)
            for t in (-1.0, 1.0)
            for k in (-1, 0, 1)
        ]
        log_p, _ = symmetric_log_likelihood(SHAPES, hypotheses, grouped(samples, fwhm_deg=5.0), np.array([0.0]))
        return float(hypotheses.sample_error[np.argmax(log_p[0])])

    assert likeliest(0.15) == max(errors)
    # The samples' own noise is 0.4 %.
    assert likeliest(0.001) < 0.01 < likeliest(0.03) < max(errors)


def test_dark_frames_without_any_noise_do_not_hide_the_marker():
    """A noise floor of 0 is a floor, and every sample is above it."""
    lit = [
        Sample(angle_deg=each, reading=Reading(intensity=100 / (1 + (each / 3) ** 2)))
        for each in (-4, -2, -1, 0, 1, 2, 4)
    ]
    dark = Sample(angle_deg=0.0, reading=Reading(intensity=0.0), dark=True)
    spread = energy_spread(lit, [dark], limits=Interval(low_deg=-10.0, high_deg=10.0))
    assert spread is not None
    assert 0.0 < spread < 0.1


def test_a_group_of_one_angle_counts_as_its_samples():
    """Three repeats of an angle, one of them an outlier: equal to all samples one by one."""
    samples = [observation(t, float(log_levels(10, abs(t - 0.1)))) for t in (-3.0, -1.5, 1.8, 3.3)]
    repeats = [observation(0.5, e, noise=0.02 + abs(e) / 50) for e in (0.0, 0.02, 0.9)]
    angles_deg = np.array([-0.4, 0.1, 0.6])
    hypotheses = hypotheses_of(SHAPES, MEMBERS)
    apart = symmetric_log_likelihood(SHAPES, hypotheses, of_samples([*samples, *repeats]), angles_deg)
    together = Grouped(strong=[*([sample] for sample in samples), repeats], others=[])
    for one, other in zip(symmetric_log_likelihood(SHAPES, hypotheses, together, angles_deg), apart, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-6)


def test_how_samples_are_grouped():
    """Weak ones alone, repeats together, the strongest groups only; in a wider group a sample may differ by more."""
    samples = [observation(float(k), -0.1 * k, noise=0.01) for k in range(3)]
    samples += [observation(1.01, 0.2, noise=0.01), observation(1.02, -0.11, noise=0.01)]
    weak = [observation(30.0, 0.0, noise=1.01 / STRONG_SNR), observation(31.0, 0.0, noise=0.001, ratio=0.02)]
    found = grouped([*samples, *weak], fwhm_deg=5.0)
    assert sorted(each.angle_deg for each in found.others) == [30.0, 31.0]
    assert [[each.angle_deg for each in group] for group in found.strong] == [[0.0], [1.0, 1.01, 1.02], [2.0]]
    median = median_of(found.strong[1])
    assert (median.angle_deg, median.log_intensity) == (1.01, -0.1)
    assert median.noise == pytest.approx(0.01 / math.sqrt(3))
    many = [observation(t, -(t**2) / 20) for t in np.linspace(-10, 10, 401).tolist()]
    found = grouped(many, fwhm_deg=5.0)
    assert len(found.strong) == MAX_GROUPS
    assert all(abs(group[-1].angle_deg - group[0].angle_deg) <= max(GROUP_WIDTHS) * 5.0 for group in found.strong)
    assert max(abs(each.angle_deg) for group in found.strong for each in group) < min(
        abs(each.angle_deg) for each in found.others
    )


@pytest.mark.parametrize("strong_deg", [(), (1.0, 4.5)])
def test_the_variance_expected_of_a_sample_is_the_sum_over_all_pairs(strong_deg):
    """Against the double sum written out in NumPy, for markers of two shapes, with strong samples and without."""
    rng = np.random.default_rng(4)
    floor = 4.2
    error = 0.04
    theta_deg = rng.normal(3.0, 2.0, 40)
    member = rng.choice(MEMBERS, 40)
    log_snr = rng.normal(4.0, 0.3, 40)
    candidates_deg = np.array([-20.0, 0.0, 2.5, 8.0])
    strong_log = np.array([3.6, 3.9])[: len(strong_deg)]
    length_deg = CORRELATION_LENGTH * SHAPES.fwhm_deg
    out = np.empty(candidates_deg.size)
    expected_variance(
        candidates_deg,
        theta_deg,
        member,
        SHAPES.log_curve,
        log_snr,
        STEP_DEG,
        floor,
        np.array(strong_deg, dtype=np.float64),
        strong_log,
        length_deg,
        TEMPLATE_LOG_LEVELS,
        TEMPLATE_SIGMAS,
        error,
        out,
    )
    for candidate_deg, found in zip(candidates_deg, out, strict=True):
        height = np.empty(40)
        spread = np.empty(40)
        for p in range(40):
            distance_deg = abs(candidate_deg - theta_deg[p])
            level = float(log_levels(member[p], distance_deg))
            shift = 0.0
            left = template_sigma(level) ** 2
            if strong_deg:
                there_deg = np.abs(np.array(strong_deg) - theta_deg[p])
                twin = int(np.argmin(np.abs(there_deg - distance_deg)))
                alike = 1 / (1 + ((there_deg[twin] - distance_deg) / length_deg[member[p]]) ** 2 / 2)
                expected = float(log_levels(member[p], there_deg[twin]))
                shift = (
                    alike
                    * template_sigma(level)
                    / template_sigma(expected)
                    * (strong_log[twin] - log_snr[p] - expected)
                )
                left *= 1 - alike**2
            strong = math.exp(2 * (log_snr[p] + level + shift)) + floor**2
            height[p] = 0.5 * math.log(strong)
            spread[p] = left + error**2 + 1 / strong
        apart = (height[:, None] - height) ** 2 / (spread[:, None] + spread)
        weight = (1 + apart / 8) ** -4
        weight /= weight.sum(axis=1, keepdims=True)
        variance = weight @ theta_deg**2 - (weight @ theta_deg) ** 2
        assert found == pytest.approx(variance.mean(), rel=1e-6)


def test_a_narrow_mode_beside_a_wide_one_is_not_stepped_over():
    """A marker at 34° that is measured up to 35° may lie at 40° as well; by all shapes, in fine steps."""
    measured = [(-21.9, 4.6), (-5.0, 5.5), (4.4, 6.7), (28.44, 19.3), (29.84, 28.4), (29.99, 30.9), (30.47, 40.9)]
    measured += [(31.19, 57.5), (31.78, 70.0), (33.2, 92.1), (33.51, 98.5), (33.77, 100.5), (34.64, 100.3)]
    measured += [(35.0, 95.9), (35.0, 95.1), (35.0, 96.2)]
    lit = [
        Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity, noise_sigma=1.0, cells=1400))
        for angle_deg, intensity in measured
    ]
    inference = Inference(limits=PAPER_RANGE, cues=frozenset({"intensity"}))
    coarse = inference._coarse(lit, [], SearchNoise(floor=Floor(level=6.4, source="dark frames"), sigma=1.0))
    angles_deg = np.arange(30.0, 46.0, 0.02)
    hypotheses = hypotheses_of(SHAPES, np.arange(SHAPES.fwhm_deg.size))
    samples = grouped(inference._observations, fwhm_deg=10.0)
    log_p, _ = symmetric_log_likelihood(SHAPES, hypotheses, samples, angles_deg)
    by_angle = logsumexp(log_p + hypotheses.log_prior, axis=1)
    for lift, tolerance in ((0.0, 0.2), (5.0, 0.1)):

        def log_prior(angles_deg, lift=lift):
            return np.where(angles_deg > 36.0, lift, 0.0)

        known = coarse.marginals(log_prior(coarse.angles_deg), particles=8)
        centre = refine(SHAPES, coarse, known, inference._observations, log_prior, particles=8)
        beyond = softmax(by_angle + log_prior(angles_deg))[angles_deg > 36].sum()
        assert centre.probability[centre.angles_deg > 36].sum() == pytest.approx(beyond, abs=tolerance)
