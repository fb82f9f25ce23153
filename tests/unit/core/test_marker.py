"""Position of the marker from the frames of a search, with its standard deviations."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek.core import (
    Doubt,
    Finished,
    Found,
    Interval,
    Measured,
    Reading,
    RigFacts,
    Sample,
    SearchPlan,
    marker_position,
)
from markerseek.records.journal import RunView
from markerseek.show import SearchResult, flat_result

FACE_M = 10e-3
RADIUS_M = 60e-3
SPEED = 1540.0
FACTS = RigFacts(
    kind="simulated",
    description="",
    fingerprint="",
    search=Interval(low_deg=-35.0, high_deg=35.0),
    face_radius_m=FACE_M,
    sound_speed_m_s=SPEED,
)
FOUND = Found(
    mean_deg=12.0, sigma_deg=0.05, interval95_deg=Interval(low_deg=11.9, high_deg=12.1), interval_kind="posterior"
)


def sample(angle_deg: float, intensity: float, *, late_m: float = 0.0, lateral_m: float = 7e-3) -> Sample:
    """A frame whose peak is one of two edges: `late_m` from the centroid of the energy, which has the slant range."""
    off = np.radians(angle_deg - FOUND.mean_deg)
    slant_m = float(np.sqrt(FACE_M**2 + RADIUS_M**2 - 2 * FACE_M * RADIUS_M * np.cos(off)))
    trigger_s = 3e-7
    reading = Reading(
        intensity=intensity,
        lateral_m=lateral_m,
        depth_m=slant_m + late_m,
        arrival_s=(slant_m + late_m) / SPEED + trigger_s,
        centroid_s=slant_m / SPEED + trigger_s,
    )
    return Sample(angle_deg=angle_deg, reading=reading)


SAMPLES = [sample(4.0, 60.0, late_m=0.39e-3), sample(15.0, 80.0, late_m=-0.39e-3), sample(12.1, 100.0, late_m=0.39e-3)]


def test_the_slant_range_of_the_energy_s_centroid_gives_the_exact_place() -> None:
    marker = marker_position(FOUND, SAMPLES, FACTS)
    assert marker is not None
    angle = np.radians(12.0)
    expected = (RADIUS_M * np.sin(angle), 7e-3, RADIUS_M * np.cos(angle))
    assert marker.position_m == pytest.approx(expected, abs=1e-9)
    assert marker.sigma_m[0] == pytest.approx(RADIUS_M * np.radians(0.05), rel=1e-6)


def test_an_answer_that_is_unsure_for_its_width_has_a_place_and_one_of_which_source_has_none() -> None:
    plan = SearchPlan(method="posterior", start_deg=0.0)
    cases: tuple[tuple[Doubt, bool], ...] = (("width", True), ("source", False))
    for doubt, placed in cases:
        view = RunView(plan=plan, facts=FACTS)
        for index, sample in enumerate(SAMPLES, start=1):
            view = view.add(Measured(role="search", index=index, sample=sample), clock_s=0.0)
        unsure = FOUND.as_unsure(doubt, "why")
        end = Finished(estimate=unsure, confirmation=None, acquisitions=3, travel_deg=30.0, elapsed_s=9.0)
        result = SearchResult.of(view.add(end, clock_s=9.0))
        printed = flat_result(result)
        assert (result.marker is not None) == placed
        assert (printed["marker_trus_m"] is not None, printed["marker_sigma_m"] is not None) == (placed, placed)


def test_strong_frames_of_the_same_source_count_by_the_square_of_their_intensity() -> None:
    beside = [
        *SAMPLES,
        sample(9.0, 90.0, lateral_m=7.2e-3),
        sample(10.0, 49.0, lateral_m=8e-3),  # weak
        sample(13.0, 95.0, lateral_m=19e-3),  # another source
    ]
    marker = marker_position(FOUND, beside, FACTS)
    assert marker is not None
    weights = np.array([60.0, 80.0, 100.0, 90.0]) ** 2
    assert marker.position_m[1] == pytest.approx(7e-3 + 0.2e-3 * weights[3] / weights.sum(), rel=1e-9)


def test_an_incoherent_source_is_uneven_and_its_place_less_certain() -> None:
    sigmas = []
    for coherence in (1.0, 0.97, 0.6, None):
        samples = [
            structs.replace(each, reading=structs.replace(each.reading, coherence=coherence)) for each in SAMPLES
        ]
        marker = marker_position(FOUND, samples, FACTS)
        assert marker is not None
        sigmas.append(marker.sigma_m[1:])
    assert sigmas[0] == pytest.approx((0.005e-3, 0.005e-3))
    assert sigmas[1] == pytest.approx((0.015e-3, 0.015e-3))
    # Without a coherence the spot may be a wide stained one.
    assert sigmas[2] == sigmas[3] == pytest.approx((0.2e-3, 0.2e-3))


def test_the_covariance_lies_along_turn_axis_and_depth() -> None:
    marker = marker_position(FOUND, SAMPLES, FACTS)
    assert marker is not None
    for axis, sigma_m in zip(marker.axes, marker.sigma_m, strict=True):
        assert axis @ marker.covariance_m2 @ axis == pytest.approx(sigma_m**2)
    # Away from the axis of the probe, and right-handed: turn × axis × away.
    x, _, z = marker.position_m
    assert marker.axes[2] == pytest.approx(np.array([x, 0, z]) / np.hypot(x, z))


def test_without_a_centroid_or_sound_speed_the_peak_is_taken() -> None:
    for facts, samples in (
        (structs.replace(FACTS, sound_speed_m_s=None), SAMPLES[2:]),
        (FACTS, [structs.replace(SAMPLES[2], reading=structs.replace(SAMPLES[2].reading, centroid_s=None))]),
    ):
        marker = marker_position(FOUND, samples, facts)
        assert marker is not None
        assert np.hypot(marker.position_m[0], marker.position_m[2]) == pytest.approx(RADIUS_M + 0.39e-3, abs=1e-6)


def test_without_face_radius_or_positions_there_is_none() -> None:
    assert marker_position(FOUND, SAMPLES, structs.replace(FACTS, face_radius_m=None)) is None
    assert marker_position(FOUND, [Sample(angle_deg=1.0, reading=Reading(intensity=5.0))], FACTS) is None
    assert marker_position(FOUND, [], FACTS) is None
