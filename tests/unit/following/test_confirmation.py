"""What the probe's image says of a prediction: against vectors in space, and Gaussian curves with a known middle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from markerseek.core import FrameHeader, Reading, ReadingFrame, Sample, SpotToSource
from markerseek.following import Aim, Confirmed, NotConfirmed, compare, confirm
from markerseek.following.confirmation import intensity_vertex, shows_source

FACE_M = 10e-3
SPOT = SpotToSource()


def aim(x_m: float, y_m: float, z_m: float, *, sigma_m: float = 0.3e-3) -> Aim:
    """Where a target is, known to this in each direction."""
    covariance_m2 = np.eye(3) * sigma_m**2
    return Aim(at_s=0.0, trus_m=np.array([x_m, y_m, z_m]), covariance_m2=covariance_m2, noise_m2=0.1 * covariance_m2)


def sample(angle_deg: float, source_m: np.ndarray, *, intensity: float = 100.0) -> Sample:
    """A frame of a source, at the distance that space gives: from the face's middle to the source, within the plane."""
    angle = math.radians(angle_deg)
    face_m = FACE_M * np.array([math.sin(angle), 0.0, math.cos(angle)])
    depth_m = float(np.linalg.norm((source_m - face_m)[[0, 2]]))
    reading = Reading(
        intensity=intensity, lateral_m=float(source_m[1]), depth_m=depth_m, noise_sigma=1.0, cells=10_000, coherence=0.9
    )
    header = FrameHeader(sequence=1, token="t", pulses=4, commanded_deg=angle_deg, started_s=0.0, ended_s=0.0)
    return Sample(angle_deg=angle_deg, reading=reading, frame=ReadingFrame(header=header, intensity=intensity))


def around(source_m: np.ndarray, middle_deg: float, *, fwhm_deg: float = 10.0) -> tuple[Sample, Sample, Sample]:
    """Three frames of a source whose intensity is a Gaussian of the angle."""
    at_deg = math.degrees(math.atan2(source_m[0], source_m[2]))
    lower, middle, upper = (
        sample(
            middle_deg + aside_deg,
            source_m,
            intensity=1000 * math.exp(-4 * math.log(2) * ((middle_deg + aside_deg - at_deg) / fwhm_deg) ** 2),
        )
        for aside_deg in (-3.0, 0.0, 3.0)
    )
    return lower, middle, upper


@given(st.floats(-30, 30), st.floats(30e-3, 80e-3), st.floats(-0.015, 0.015), st.floats(-5, 5))
def test_a_frame_of_the_predicted_source_agrees(angle_deg: float, radius_m: float, y_m: float, off_deg: float) -> None:
    angle = math.radians(angle_deg)
    expected = aim(radius_m * math.sin(angle), y_m, radius_m * math.cos(angle))
    compared = compare(sample(angle_deg + off_deg, expected.trus_m), expected, face_radius_m=FACE_M, spot=SPOT)
    assert compared.agrees
    assert (compared.lateral_off_m, compared.depth_off_m) == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(
    ("moved_mm", "agrees"),
    [
        ((0, 1.0, 0), True),
        ((0, 3.0, 0), False),
        ((0, 0, 1.0), True),
        ((0, 0, -3.0), False),
        # Along both axes less than three standard deviations, together more.
        ((0, 1.0, 1.0), False),
    ],
)
def test_a_source_elsewhere_does_not(moved_mm: tuple[float, float, float], agrees: bool) -> None:
    expected = aim(0.0, 0.0, 60e-3)
    source_m = expected.trus_m + 1e-3 * np.array(moved_mm)
    compared = compare(sample(0.0, source_m), expected, face_radius_m=FACE_M, spot=SPOT)
    assert compared.agrees is agrees
    assert (compared.lateral_off_m, compared.depth_off_m) == pytest.approx(1e-3 * np.array(moved_mm[1:]), rel=1e-6)
    # 0.3 mm of the prediction, 0.2 mm from spot to source, 0.05 mm of the image.
    assert compared.depth_sigma_m == pytest.approx(math.hypot(0.3e-3, 0.2e-3, 0.05e-3))
    assert f"{compared.depth_off_m * 1e3:+.1f}" in compared.said


@given(st.floats(-2.5, 2.5), st.floats(5.0, 30.0))
def test_the_vertex_of_a_gaussian_is_its_middle(middle_deg: float, fwhm_deg: float) -> None:
    angle = math.radians(10 + middle_deg)
    source_m = 60e-3 * np.array([math.sin(angle), 0.0, math.cos(angle)])
    vertex = intensity_vertex(around(source_m, 10.0, fwhm_deg=fwhm_deg))
    assert vertex is not None
    at_deg, sigma_deg = vertex
    assert at_deg == pytest.approx(10 + middle_deg, abs=1e-6)
    assert sigma_deg > 0


def test_the_vertex_is_known_as_well_as_the_intensities() -> None:
    """By (2) with 5 % of each intensity, at the middle: 0.05·√2·d/2 over 8·ln 2·(d/fwhm)²."""
    vertex = intensity_vertex(around(np.array([0.0, 0.0, 60e-3]), 0.0, fwhm_deg=10.0))
    assert vertex is not None
    assert vertex[1] == pytest.approx(0.05 * math.sqrt(2) * 1.5 / (8 * math.log(2) * 0.09), rel=0.02)


@pytest.mark.parametrize("intensities", [(1, 1, 2), (2, 1, 2), (0, 1, 0.5)])
def test_without_a_maximum_there_is_no_vertex(intensities: tuple[float, float, float]) -> None:
    lower, middle, upper = (
        sample(angle_deg, np.array([0.0, 0.0, 0.06]), intensity=each)
        for angle_deg, each in zip((-3.0, 0.0, 3.0), intensities, strict=True)
    )
    assert intensity_vertex((lower, middle, upper)) is None


def test_a_spot_where_it_is_expected_confirms() -> None:
    expected = aim(0.0, 0.0, 60e-3)
    verdict = confirm(around(np.array([0.0, 0.4e-3, 60e-3]), 0.0), expected, face_radius_m=FACE_M, spot=SPOT)
    assert isinstance(verdict, Confirmed)
    assert verdict.said == "confirmed, 0.4 mm from the prediction"


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0.7, -0.7), (0.6, 0.6, 0.5)])
@pytest.mark.parametrize("sigma_mm", [0.1, 0.3, 0.6])
def test_a_source_3_mm_beside_confirms_nothing(direction: tuple[float, float, float], sigma_mm: float) -> None:
    expected = aim(0.0, 0.0, 60e-3, sigma_m=1e-3 * sigma_mm)
    beside_m = 3e-3 * np.array(direction) / np.linalg.norm(direction)
    verdict = confirm(around(expected.trus_m + beside_m, 0.0), expected, face_radius_m=FACE_M, spot=SPOT)
    assert isinstance(verdict, NotConfirmed)


def test_a_source_unlikely_along_three_axes_together_confirms_nothing() -> None:
    expected = aim(0.0, 0.0, 60e-3)
    verdict = confirm(around(expected.trus_m + 0.95e-3, 0.0), expected, face_radius_m=FACE_M, spot=SPOT)
    assert isinstance(verdict, NotConfirmed)
    assert "the source is 1.6 mm from the prediction" in verdict.said


def test_errors_that_go_together_are_looked_at_together() -> None:
    """A registration known badly along one oblique line: a source on the line agrees, beside it not."""
    line = np.array([0.0, 1.0, 1.0]) / math.sqrt(2)
    covariance_m2 = 1e-6 * np.outer(line, line)
    oblique = Aim(at_s=0.0, trus_m=np.array([0.0, 0.0, 60e-3]), covariance_m2=covariance_m2, noise_m2=0 * covariance_m2)
    for moved_mm, agrees in (((0, 1.2, 1.2), True), ((0, 1.2, -1.2), False)):
        seen = compare(
            sample(0.0, oblique.trus_m + 1e-3 * np.array(moved_mm)), oblique, face_radius_m=FACE_M, spot=SPOT
        )
        assert seen.agrees is agrees


def test_the_share_of_right_predictions_that_agree_is_that_of_three_standard_deviations() -> None:
    rng = np.random.default_rng(5)
    expected = aim(0.0, 0.0, 60e-3)
    # The image's own 0.05 mm along the array and in depth, and 0.2 mm from spot to source.
    places_m = expected.trus_m + rng.normal(scale=math.hypot(0.3e-3, 0.2e-3, 0.05e-3), size=(4000, 3))
    agree = [compare(sample(0.0, each), expected, face_radius_m=FACE_M, spot=SPOT).agrees for each in places_m]
    assert np.mean(agree) == pytest.approx(0.9973, abs=0.0025)


def test_an_angle_that_is_hardly_known_confirms_nothing() -> None:
    expected = aim(0.0, 0.0, 60e-3)
    # Of a curve of 25 deg the three intensities differ by 4 %.
    verdict = confirm(around(expected.trus_m, 0.0, fwhm_deg=25.0), expected, face_radius_m=FACE_M, spot=SPOT)
    assert isinstance(verdict, NotConfirmed)
    assert "deg only, so that nothing is confirmed" in verdict.said


def test_noise_is_no_source() -> None:
    expected = aim(0.0, 0.0, 60e-3)
    # The largest of 10,000 cells of noise is below 5.7 sigma in all but one of 1,000 frames.
    for intensity, seen in ((5.6, False), (5.8, True)):
        frame = sample(0.0, expected.trus_m, intensity=intensity)
        assert shows_source(frame.reading) is seen
    lower, _, upper = around(expected.trus_m, 0.0)
    dark = sample(0.0, expected.trus_m, intensity=3.0)
    verdict = confirm((lower, dark, upper), expected, face_radius_m=FACE_M, spot=SPOT)
    assert verdict.said.startswith("no source here: the spot is not on tissue that the probe sees")
