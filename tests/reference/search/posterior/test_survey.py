"""What may still hide, against searches of drawn sources, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from markerseek.core import PAPER_RANGE, Floor, Reading, Sample, SweepTiming
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.shapes import STEP_DEG, WIDTHS_DEG, family, log_curve
from markerseek.search.posterior.sources import BESIDE_DEG, Candidate
from markerseek.search.posterior.survey import HIDDEN_DB, HIDDEN_STEPS, TAIL_ERROR, noise_shares, survey_of, undetected

SHAPES = family()
NOISE = SearchNoise(floor=Floor(level=6.4, source="dark frames"), sigma=1.0)


def candidate(angles_deg, *, peak=50.0, fwhm_deg=6.0, marker_deg=0.0):
    """A source that was measured at these angles without noise, by intensities alone."""
    height = peak * np.exp(log_curve(np.asarray(angles_deg) - marker_deg, fwhm_deg=fwhm_deg, tail=1.2, knee=2.4))
    lit = [
        Sample(angle_deg=angle, reading=Reading(intensity=max(4.5, value), noise_sigma=1.0, cells=10_000))
        for angle, value in zip(angles_deg, height.tolist(), strict=True)
    ]
    inference = Inference(limits=PAPER_RANGE, cues=frozenset({"intensity"}))
    posterior = inference.posterior(lit, NOISE, particles=48)
    candidate = Candidate(
        source=None, side=(), samples=lit, missing=None, posterior=posterior, seen=len(lit), measured=True
    )
    return candidate, lit


def test_the_probability_of_staying_undetected_is_that_of_drawn_samples():
    source, _ = candidate([-6.0, -3.0, 0.0, 3.0, 6.0])
    rng = np.random.default_rng(1)
    at_deg = np.array([-20.0, 4.0])
    angles_deg = np.linspace(-35, 35, 15)
    needed = np.array([6.4, 9.0])
    noise = np.array([1.0, 0.25])
    chance = undetected(source.posterior, at_deg, needed, angles_deg, noise=noise)
    drawn = np.linspace(0, 47, len(HIDDEN_STEPS)).astype(int)
    steps = np.arange(SHAPES.log_curve.shape[1]) * STEP_DEG
    for row, k in enumerate(drawn):
        # A curve of the same kind, wider by so many tenths, and weaker.
        member = source.posterior.member[k] + HIDDEN_STEPS[row]
        assert SHAPES.fwhm_deg[member] / SHAPES.fwhm_deg[source.posterior.member[k]] == pytest.approx(
            (35 / 2) ** (HIDDEN_STEPS[row] / (WIDTHS_DEG.size - 1)), rel=0.02
        )
        for i in range(2):
            log_s = np.interp(np.abs(at_deg[i] - angles_deg), steps, SHAPES.log_curve[member])
            height = np.exp(source.posterior.log_snr[k] + log_s) * 10 ** (HIDDEN_DB[row] / 20)
            sample = height + np.hypot(noise[i], TAIL_ERROR * height) * rng.standard_normal((20_000, 15))
            assert chance[row, i] == pytest.approx((sample < needed[i]).mean(axis=0), abs=0.015)


def test_a_source_beside_a_wide_one_may_be_narrow():
    source, _ = candidate([-12.0, -6.0, 0.0, 6.0, 12.0], fwhm_deg=14.0)
    at_deg = np.array([-20.0])
    angles_deg = np.array([-29.0])
    needed = np.array([6.4])
    chance = undetected(source.posterior, at_deg, needed, angles_deg, noise=np.ones(needed.size))[:, 0, 0]
    steps = np.array(HIDDEN_STEPS)
    # A source of about 50 σ, nine degrees off: seen at 12 to 14 degrees of width, at 6 often not.
    assert chance[np.abs(steps) <= 1].max() < 0.1 < 0.3 < chance[steps == min(steps)].min()


def test_a_range_measured_everywhere_hides_nothing_and_a_gap_hides_a_source():
    source, lit = candidate([-33.0, -27.0, -21.0, -15.0, -9.0, -3.0, 0.0, 3.0, 9.0, 15.0, 21.0, 27.0, 33.0])
    assert survey_of(source, lit, NOISE, limits=PAPER_RANGE).surveyed > 0.99
    source, lit = candidate([-33.0, -27.0, -21.0, -15.0, -9.0, -3.0, 0.0, 3.0])
    survey = survey_of(source, lit, NOISE, limits=PAPER_RANGE)
    assert 0.5 < survey.surveyed < 0.9
    assert survey.hidden_deg > 12
    assert 12 < survey.next_deg < 35


def test_an_average_at_rest_shows_more_than_a_pulse_of_a_sweep():
    source, lit = candidate(np.arange(-34.0, 35.0, 2.0).tolist(), peak=9.0)
    swept = [replace(sample, sweep=SweepTiming(number=1, speed_deg_s=10.0)) for sample in lit]
    # Of sixteen pulses: a quarter of the noise.
    reading = Reading(intensity=1.2, noise_sigma=0.25, cells=10_000)
    at_rest = [Sample(angle_deg=angle, reading=reading) for angle in np.arange(-34.0, -12.0, 2.0).tolist()]
    pulses = survey_of(source, swept, NOISE, limits=PAPER_RANGE).surveyed
    both = survey_of(source, [*swept, *at_rest], NOISE, limits=PAPER_RANGE).surveyed
    assert pulses < 0.8
    # All of the third of the range that was measured at rest.
    assert both == pytest.approx(pulses + (1 - pulses) / 3, abs=0.05)
    assert noise_shares([*swept, *at_rest], NOISE).tolist() == [1.0] * len(swept) + [0.25] * len(at_rest)
    # Where nothing was swept, frames differ by chance only.
    assert noise_shares(at_rest, NOISE).tolist() == [1.0] * len(at_rest)


def test_the_next_angle_leaves_least_hidden():
    """Each candidate in turn is measured without a detection, travel apart."""
    source, lit = candidate([-33.0, -20.0, -9.0, -3.0, 0.0, 3.0])
    survey = survey_of(source, lit, NOISE, limits=PAPER_RANGE)

    def left(angle_deg):
        more = [*lit, Sample(angle_deg=angle_deg, reading=Reading(intensity=4.5, noise_sigma=1.0, cells=10_000))]
        return survey_of(source, more, NOISE, limits=PAPER_RANGE).surveyed

    shares = [left(angle_deg) for angle_deg in np.linspace(-35, 35, 36).tolist()]
    assert left(survey.next_deg) > max(shares) - 0.03


def test_no_angle_is_measured_twice():
    """A search of intensities measured one angle four times, at which the marker hides another source."""
    angles = [-33.0, -20.0, -9.0, -3.0, 0.0, 3.0]
    for _ in range(8):
        source, lit = candidate(angles)
        angles.append(survey_of(source, lit, NOISE, limits=PAPER_RANGE).next_deg)
        assert min(abs(angles[-1] - each) for each in angles[:-1]) > BESIDE_DEG


def test_a_stronger_source_hides_less():
    angles = [-30.0, -10.0, -3.0, 0.0, 3.0, 12.0, 30.0]
    shares = []
    for peak in (12.0, 50.0, 300.0):
        source, lit = candidate(angles, peak=peak)
        shares.append(survey_of(source, lit, NOISE, limits=PAPER_RANGE).surveyed)
    assert shares == sorted(shares)
    assert shares[0] < 0.8 < 0.95 < shares[-1]
