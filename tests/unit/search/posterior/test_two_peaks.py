"""A dip between two peaks, and the angles at which one would show."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from markerseek.core import Ambiguous, Found, LocalMaxima, Reading, Sample, SweepTiming
from markerseek.search.curve import log_curve
from markerseek.search.posterior import Posterior
from markerseek.search.posterior.shapes import log_near_field
from markerseek.search.posterior.sources import asymmetric_sample, dip_deg, gap_angle_deg
from tests.sizes import examples

BLOCKS = LocalMaxima(
    first_lateral_m=0.0,
    first_depth_m=0.0,
    lateral_step_m=2e-3,
    depth_step_m=2e-3,
    columns=1,
    noise_peaks=10.0,
    intensities=b"\0\0\0\0",
)


def samples(angles_deg, intensities, *, frames=False):
    return [
        Sample(angle_deg=angle, reading=Reading(intensity=value, local_maxima=BLOCKS if frames else None))
        for angle, value in zip(angles_deg, intensities, strict=True)
    ]


def test_a_dip_divides_two_peaks():
    at = samples([0.0, 3.0, 6.0, 9.0, 12.0], [50.0, 100.0, 40.0, 80.0, 30.0])
    assert dip_deg(at, sigma=1.0, level=6.0) == 6.0
    assert dip_deg(at[::-1], sigma=1.0, level=6.0) == 6.0
    # Nearer to one another they are absorbers of one spot.
    assert dip_deg(samples([0.0, 1.5, 3.0, 4.5, 6.0], [50.0, 100.0, 40.0, 80.0, 30.0]), sigma=1.0, level=6.0) is None
    # As deep as noise makes it, or below what noise reaches, it is none.
    assert dip_deg(at, sigma=20.0, level=6.0) is None
    assert dip_deg(at, sigma=1.0, level=90.0) is None


def test_a_burst_and_a_misfire_are_contradicted_by_the_sample_beside_them():
    rising = [0.0, 3.0, 6.0, 9.0, 12.0, 12.5]
    assert dip_deg(samples(rising, [10.0, 20.0, 40.0, 90.0, 30.0, 31.0]), sigma=1.0, level=6.0) is None
    assert dip_deg(samples(rising, [60.0, 90.0, 40.0, 20.0, 95.0, 11.0]), sigma=1.0, level=6.0) is None
    assert dip_deg(samples(rising, [60.0, 90.0, 40.0, 20.0, 95.0, 90.0]), sigma=1.0, level=6.0) == 9.0


def test_a_weak_pulse_among_hundreds_of_a_sweep_is_no_dip():
    angles_deg = np.arange(-10, 10.01, 0.125)
    heights = 50 / (1 + (angles_deg / 4) ** 2) * (1 + 0.1 * np.random.default_rng(2).standard_normal(angles_deg.size))
    heights[60] *= 0.5
    at_rest = samples(angles_deg.tolist(), heights.tolist(), frames=True)
    swept = [structs.replace(each, sweep=SweepTiming(number=1, speed_deg_s=12.5)) for each in at_rest]
    assert dip_deg(swept, sigma=1.0, level=6.0) is None
    assert asymmetric_sample(swept, centre_deg=0.0, sigma=1.0, level=6.0) is None
    # A dip that all pulses about it show is one.
    two = [
        structs.replace(each, reading=structs.replace(each.reading, intensity=height))
        for each, height in zip(swept, (heights * (1 - 0.8 * np.exp(-((angles_deg / 3) ** 2)))).tolist(), strict=True)
    ]
    assert dip_deg(two, sigma=1.0, level=6.0) == pytest.approx(0.0, abs=0.5)


def test_an_angle_measured_twice_at_the_end_is_no_dip():
    """The marker moved in between. A search of the table of failures had no sample beyond its dip, and failed."""
    angles_deg = [14.2, 22.4, 25.4, 29.1, 32.0, 32.0]
    intensities = [51.4, 233.2, 291.2, 150.0, 65.7, 187.6]
    assert dip_deg(samples(angles_deg, intensities), sigma=1.0, level=6.7) is None
    assert dip_deg(samples([-angle_deg for angle_deg in angles_deg], intensities), sigma=1.0, level=6.7) is None


@settings(max_examples=examples(200), deadline=None)
@given(at=st.lists(st.tuples(st.sampled_from([0.0, 6.0, 12.0]), st.sampled_from([9.0, 40.0, 99.0])), min_size=3))
def test_a_dip_has_samples_on_both_sides(at):
    dip = dip_deg(samples(*zip(*at, strict=True)), sigma=1.0, level=6.0)
    assert dip is None or {angle_deg < dip for angle_deg, _ in at if angle_deg != dip} == {True, False}


@settings(max_examples=examples(60), deadline=None)
@given(
    middle_deg=st.floats(-20, 20),
    fwhm_deg=st.floats(2.5, 20),
    tail=st.floats(1.0, 3.0),
    knee=st.floats(2.0, 5.0),
    angles=st.lists(st.floats(-35, 35), min_size=3, max_size=16),
)
def test_no_curve_of_the_family_has_one(middle_deg, fwhm_deg, tail, knee, angles):
    heights = 100 * np.exp(log_curve(np.array(angles) - middle_deg, fwhm_deg=fwhm_deg, tail=tail, knee=knee))
    assert dip_deg(samples(angles, heights.tolist()), sigma=1.0, level=6.0) is None


def test_a_sample_stronger_than_one_nearer_to_the_centre_on_the_other_side_is_of_another_curve():
    """Nothing dips: the second peak, at -11°, lies between the samples."""
    at = samples([-12.0, -4.0, -2.0, 0.0, 2.0, 5.0], [30.0, 32.0, 60.0, 100.0, 58.0, 20.0])
    assert dip_deg(at, sigma=1.0, level=6.0) is None
    assert asymmetric_sample(at, centre_deg=0.0, sigma=1.0, level=6.0) is at[0]
    assert asymmetric_sample(at, centre_deg=0.0, sigma=5.0, level=6.0) is None
    assert asymmetric_sample(at[1:], centre_deg=0.0, sigma=1.0, level=6.0) is None


def test_the_wider_gap_beside_a_sample_is_halved_until_both_are_narrow():
    assert gap_angle_deg(-12.0, [-20.0, -12.0, -4.0, 0.0]) == pytest.approx(-8.0)
    assert gap_angle_deg(-12.0, [-20.0, -12.0, -8.0, 0.0]) == pytest.approx(-16.0)
    assert gap_angle_deg(-12.0, [-13.9, -12.0, -10.5]) is None
    assert gap_angle_deg(-12.0, [-12.0, -10.5]) is None


def test_in_the_near_field_of_an_element_a_frame_has_one_source_and_intensities_may_have_two():
    angles = np.linspace(-15, 15, 25)
    heights = (100 * np.exp(log_near_field(angles, fwhm_deg=20.0, fresnel_number=1.5))).tolist()
    assert dip_deg(samples(angles.tolist(), heights, frames=True), sigma=1.0, level=6.0) is None
    assert dip_deg(samples(angles.tolist(), heights), sigma=1.0, level=6.0) == pytest.approx(0.0, abs=1.3)


@pytest.mark.parametrize("apart_deg", [6.0, pytest.param(9.0, marks=pytest.mark.long)])
def test_two_peaks_in_a_file_of_intensities_are_ambiguous(apart_deg):
    """Before, every second of these was Found between the two."""
    answers = []
    rng = np.random.default_rng(7)
    for _ in range(8):
        low_deg = rng.uniform(-25, 15)
        ratio = rng.uniform(0.7, 1.0)
        markers_deg = (low_deg, low_deg + apart_deg)

        def sample(angle_deg, dark=False, markers_deg=markers_deg, ratio=ratio):
            curves = [
                height * float(np.exp(log_curve(np.array([angle_deg - each]), fwhm_deg=5.0, tail=1.5, knee=2.2)[0]))
                for each, height in zip(markers_deg, (100.0, 100.0 * ratio), strict=True)
            ]
            signal = 0.0 if dark else max(curves) * (1 + 0.0125 * rng.standard_normal())
            envelope = max(abs(signal + complex(*rng.standard_normal(2))), 4.3 + 0.3 * rng.standard_normal())
            return Sample(
                angle_deg=angle_deg, reading=Reading(intensity=envelope, noise_sigma=1.0, cells=12_800), dark=dark
            )

        policy = Posterior(acquisitions=24)
        for _ in range(3):
            policy.tell(sample(0.0, dark=True))
        while True:
            while (angle_deg := policy.ask()) is not None:
                policy.tell(sample(angle_deg))
            answer = policy.estimate()
            if not isinstance(answer, Found):
                break
            policy.confirm(sample(answer.mean_deg))
            if policy.ask() is None:
                answer = policy.estimate()
                break
        if isinstance(answer, Found):
            assert min(abs(answer.mean_deg - each) for each in markers_deg) < 1
        if isinstance(answer, Ambiguous):
            assert all(min(abs(mode - each) for mode in answer.modes_deg) < 1 for each in markers_deg)
        answers.append(answer)
    assert sum(isinstance(answer, Ambiguous) for answer in answers) >= 7
