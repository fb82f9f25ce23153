"""Samples of a displaced marker, against the same marker at rest: both by distances between points in space."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from markerseek.core import (
    USUAL_SOUND_SPEED_M_S,
    Arrival,
    Displacement,
    Found,
    Interval,
    LocalMaxima,
    Reading,
    RigFacts,
    Sample,
    SpotEnergy,
    displacement_sigmas,
    marker_position,
    undisplaced,
)

FACE_M = 10e-3
SIGMA = 4.0
NONE = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def reading_of(place_m: np.ndarray, *, probe_deg: float) -> Reading:
    """What a probe at that angle reads of a point in space: a Gaussian over the angle between them."""
    away_deg = math.degrees(math.atan2(place_m[0], place_m[2])) - probe_deg
    probe = math.radians(probe_deg)
    face_m = FACE_M * np.array([math.sin(probe), 0.0, math.cos(probe)])
    slant_m = float(np.linalg.norm((place_m - face_m) * [1, 0, 1]))
    lateral_m = float(place_m[1])
    arrival_s = slant_m / USUAL_SOUND_SPEED_M_S
    intensity = 100 * math.exp(-0.5 * (away_deg / SIGMA) ** 2)
    return Reading(
        intensity=intensity,
        lateral_m=lateral_m,
        depth_m=slant_m,
        arrival_s=arrival_s,
        centroid_s=arrival_s,
        spot=SpotEnergy(amplitude=intensity, relative_sigma=0.01, lateral_m=lateral_m, depth_m=slant_m),
        arrivals=(
            Arrival(lateral_m=lateral_m, depth_m=slant_m, arrival_s=arrival_s, intensity=intensity, coherence=1.0),
        ),
        local_maxima=LocalMaxima(
            first_lateral_m=lateral_m,
            first_depth_m=slant_m,
            lateral_step_m=1e-3,
            depth_step_m=1e-3,
            columns=1,
            noise_peaks=1.0,
            intensities=np.array([intensity], dtype="<f4").tobytes(),
        ),
    )


def point_m(angle_deg: float, radius_m: float) -> np.ndarray:
    angle = math.radians(angle_deg)
    return np.array([radius_m * math.sin(angle), 4e-3, radius_m * math.cos(angle)])


@given(
    st.floats(-25.0, 25.0),
    st.floats(45e-3, 70e-3),
    st.lists(st.tuples(*[st.floats(-2.5, 2.5)] * 3), min_size=9, max_size=9),
)
def test_samples_of_a_displaced_marker_are_those_of_one_at_rest_at_other_angles(
    marker_deg: float, radius_m: float, displacements_mm: list[tuple[float, float, float]]
) -> None:
    rest_m = point_m(marker_deg, radius_m)
    probes_deg = [marker_deg + step for step in (-6.0, 0.0, 6.0, -3.0, 3.0, 1.0, -1.0, 8.0, -8.0)]
    samples = [
        Sample(
            angle_deg=probe_deg,
            reading=reading_of(rest_m + 1e-3 * np.array(by_mm), probe_deg=probe_deg),
            displacement=Displacement(mm=by_mm, covariance_mm2=NONE),
        )
        for probe_deg, by_mm in zip(probes_deg, displacements_mm, strict=True)
    ]
    for before, after in zip(samples, undisplaced(samples), strict=True):
        expected = reading_of(rest_m, probe_deg=after.angle_deg)
        # The marker's own angle is known to some degrees only, and the direction of the turn with it.
        size_m = 1e-3 * float(np.linalg.norm(before.displacement.mm if before.displacement else (0, 0, 0)))
        assert after.reading.intensity == before.reading.intensity
        assert after.reading.lateral_m == pytest.approx(expected.lateral_m, abs=1e-9)
        assert after.reading.depth_m == pytest.approx(expected.depth_m, abs=0.08 * size_m + 1e-9)
        assert after.reading.arrival_s == pytest.approx(
            (after.reading.depth_m or 0.0) / USUAL_SOUND_SPEED_M_S, rel=1e-9
        )
        assert after.reading.centroid_s == after.reading.arrival_s
        assert after.reading.spot is not None
        assert after.reading.local_maxima is not None
        (arrival,) = after.reading.arrivals
        for each in (after.reading.spot, arrival):
            assert (each.lateral_m, each.depth_m) == pytest.approx((after.reading.lateral_m, after.reading.depth_m))
        assert after.reading.local_maxima.first_depth_m == pytest.approx(after.reading.depth_m)
        assert after.reading.local_maxima.first_lateral_m == pytest.approx(after.reading.lateral_m)
        away_deg = SIGMA * math.sqrt(-2 * math.log(max(before.reading.intensity, 1e-30) / 100))
        tolerance_deg = 0.08 * math.degrees(size_m / radius_m) + 1e-6
        assert abs(after.angle_deg - marker_deg) == pytest.approx(away_deg, abs=tolerance_deg)
        assert after.displacement == Displacement(mm=(0.0, 0.0, 0.0), covariance_mm2=NONE)


def test_samples_without_any_displacement_are_as_they_were_and_a_dark_frame_stays() -> None:
    samples = [Sample(angle_deg=1.0, reading=Reading(intensity=1.0))]
    assert undisplaced(samples) == samples
    dark = Sample(angle_deg=1.0, reading=Reading(intensity=0.1), dark=True)
    seen = Sample(
        angle_deg=0.0,
        reading=Reading(intensity=1.0),
        displacement=Displacement(mm=(1.0, 0.0, 0.0), covariance_mm2=NONE),
    )
    assert undisplaced([dark, seen])[0] == dark


def test_a_displacement_that_is_not_known_is_that_of_the_others_with_their_scatter() -> None:
    rng = np.random.default_rng(1)
    drawn_mm = rng.multivariate_normal([0.5, 0.0, 0.3], np.diag([0.4, 0.2, 0.1]), size=400)
    own = 0.01 * np.eye(3)
    covariance_mm2 = ((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01))
    known = [
        Sample(
            angle_deg=0.0,
            reading=Reading(intensity=1.0),
            displacement=Displacement(mm=tuple(each), covariance_mm2=covariance_mm2),
        )
        for each in drawn_mm.tolist()
    ]
    unknown = Sample(angle_deg=0.0, reading=Reading(intensity=1.0))
    last = undisplaced([*known, unknown])[-1]
    assert last.displacement is not None
    np.testing.assert_allclose(last.displacement.covariance_mm2, np.cov(drawn_mm.T, ddof=0) + own, atol=1e-9)
    assert last.angle_deg == pytest.approx(-math.degrees(drawn_mm[:, 0].mean() / 55), rel=0.02)
    # Of two nothing is concluded.
    assert undisplaced([*known[:2], unknown])[-1] == unknown


@given(st.floats(-40.0, 40.0), st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9))
def test_the_error_of_a_displacement_is_that_of_its_part_in_each_direction(
    angle_deg: float, numbers: list[float]
) -> None:
    root = np.array(numbers).reshape(3, 3)
    covariance_mm2 = root @ root.T
    first, second, third = (tuple(row) for row in covariance_mm2.tolist())
    displacement = Displacement(mm=(0.0, 0.0, 0.0), covariance_mm2=(first, second, third))
    found = displacement_sigmas(Sample(angle_deg=angle_deg, reading=Reading(intensity=1.0), displacement=displacement))
    away = point_m(angle_deg, 1.0) * [1, 0, 1]
    along = np.cross([0.0, 1.0, 0.0], away)
    for sigma_m, direction in ((found.turn_m, along), (found.lateral_m, [0, 1, 0]), (found.depth_m, away)):
        expected_mm = math.sqrt(max(np.array(direction) @ covariance_mm2 @ np.array(direction), 0.0))
        assert 1e3 * sigma_m == pytest.approx(expected_mm, abs=1e-6)


def test_the_position_of_a_marker_is_that_at_rest_and_as_well_known_as_the_cameras_leave_it() -> None:
    rest_m = point_m(10.0, 60e-3)
    covariance_mm2 = ((0.0025, 0.0, 0.0), (0.0, 0.0025, 0.0), (0.0, 0.0, 0.09))
    displacements_mm = ((0.0, 0.0, 0.0), (1.0, 1.5, -0.5), (-1.2, 0.4, 1.0), (0.6, -2.0, 1.5))
    samples = [
        Sample(
            angle_deg=10.0 + step,
            reading=replace(reading_of(rest_m + 1e-3 * np.array(by_mm), probe_deg=10.0 + step), coherence=1.0),
            displacement=Displacement(mm=by_mm, covariance_mm2=covariance_mm2),
        )
        for step, by_mm in zip((-1.0, 1.0, -0.5, 0.5), displacements_mm, strict=True)
    ]
    facts = RigFacts(
        kind="simulated",
        description="a point",
        fingerprint="0",
        search=Interval(low_deg=-35.0, high_deg=35.0),
        face_radius_m=FACE_M,
        sound_speed_m_s=USUAL_SOUND_SPEED_M_S,
    )
    found = Found(
        mean_deg=10.0, sigma_deg=0.1, interval95_deg=Interval(low_deg=9.8, high_deg=10.2), interval_kind="posterior"
    )
    position = marker_position(found, samples, facts)
    assert position is not None
    assert 1e3 * np.array(position.position_m) == pytest.approx(1e3 * rest_m, abs=0.05)
    _, lateral_mm, depth_mm = (1e3 * each for each in position.sigma_m)
    assert lateral_mm == pytest.approx(0.05, abs=0.01)
    assert depth_mm == pytest.approx(0.3, abs=0.02)
