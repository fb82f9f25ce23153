"""Readings of cut frames are distributed as those of whole frames, with every unknown of the physics table drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from markerseek.core import Reading
from markerseek.sim import LaserSettings, NoiseSettings, SimulatedSettings
from markerseek.studies import PolicySettings, Study, cells, run_row
from markerseek.studies.window import FLOOR_SCATTER, noise_free, window_of
from markerseek.studies.worlds import draw_trial, study_rig

pytestmark = pytest.mark.usefixtures("unchecked_shapes")

COUNT = 24

STUDY = Study(
    name="agreement",
    policies=(PolicySettings(method="ternary", acquisitions=4, as_published=True),),
    level="readings",
    drawn="everything",
    seed=7,
    rig=SimulatedSettings(noise=NoiseSettings(peak_snr_db=30.0), laser=LaserSettings(energy_jitter=0.0)),
)


def readings(study: Study, trial: int, off_deg: float | None) -> list[Reading]:
    """Of the same marker whatever the noise, which is part of what markers are drawn from."""
    drawn = draw_trial(STUDY, cells(STUDY)[0], trial)
    rig = study_rig(study, cells(study)[0], drawn)
    angle_deg = drawn.marker_deg + (off_deg or 0.0) * (-1 if drawn.marker_deg > 0 else 1)
    measure = rig.scanner.measure_dark if off_deg is None else lambda: rig.scanner.measure(angle_deg)
    return [measure().reading for _ in range(COUNT)]


def apart(one: list[float], other: list[float], *, tolerance: float) -> float:
    """Difference of the means over what chance (three standard errors) and the tolerance allow."""
    chance = 3 * float(np.hypot(np.std(one), np.std(other))) / np.sqrt(COUNT)
    return float(abs(np.mean(one) - np.mean(other)) / (chance + tolerance))


@pytest.mark.parametrize("off_deg", [0.0, 2.0, 3.5])
@pytest.mark.parametrize("trial", range(3))
def test_readings_near_the_marker_are_those_of_frames(trial: int, off_deg: float) -> None:
    """Intensity over the floor within 2 %, place within 0.05 mm, moments within 10 ns, beside chance."""
    cut = readings(STUDY, trial, off_deg)
    whole = readings(replace(STUDY, level="frames"), trial, off_deg)
    floor_cut, floor_whole = (np.median([reading.noise_sigma for reading in each]) for each in (cut, whole))
    heights = [
        [reading.intensity / floor for reading in each] for each, floor in ((cut, floor_cut), (whole, floor_whole))
    ]
    assert np.mean(heights[1]) > 7, "this is about a marker that is detected"
    assert apart(*heights, tolerance=0.02 * float(np.mean(heights[1]))) < 1
    for name, tolerance in (("lateral_m", 0.05e-3), ("depth_m", 0.03e-3), ("arrival_s", 10e-9), ("coherence", 0.03)):
        assert apart(*([getattr(r, name) for r in each] for each in (cut, whole)), tolerance=tolerance) < 1, name
    assert {reading.cells for reading in cut} == {reading.cells for reading in whole}
    assert np.std([r.noise_sigma for r in cut]) / floor_cut == pytest.approx(FLOOR_SCATTER, rel=0.6)


@pytest.mark.parametrize("off_deg", [None, 30.0])
def test_readings_of_noise_are_those_of_frames(off_deg: float | None) -> None:
    """Dark, and far off a marker at 20 dB: height within 0.15 noise deviations, anywhere in the image."""
    quiet = replace(STUDY, rig=replace(STUDY.rig, noise=NoiseSettings(peak_snr_db=20.0)))
    cut, whole = readings(quiet, 4, off_deg), readings(replace(quiet, level="frames"), 4, off_deg)
    heights = [[reading.intensity / reading.noise_sigma for reading in each] for each in (cut, whole)]  # type: ignore[operator]
    assert apart(*heights, tolerance=0.15) < 1
    for each in (cut, whole):
        assert np.std([reading.lateral_m for reading in each]) > 8e-3
        assert np.std([reading.arrival_s for reading in each]) > 6e-6
    # what a marker's coherence is held against
    assert apart(*([r.coherence for r in each] for each in (cut, whole)), tolerance=0.05) < 1  # type: ignore[misc]
    assert max(max(r.coherence for r in each) for each in (cut, whole)) < 0.6  # type: ignore[type-var, operator]


@pytest.mark.parametrize("off_deg", [0.0, 3.0, 12.0])
def test_arrivals_and_local_maxima_are_those_of_frames(off_deg: float) -> None:
    """As many arrivals, the first as high; the marker's block as high; the rest of the image as noisy."""
    cut = readings(STUDY, 2, off_deg)
    whole = readings(replace(STUDY, level="frames"), 2, off_deg)
    found = [[float(len(reading.arrivals)) for reading in each] for each in (cut, whole)]
    assert apart(*found, tolerance=0.2) < 1
    on = readings(replace(STUDY, level="frames"), 2, 0.0)[0]
    assert on.lateral_m is not None
    assert on.depth_m is not None
    near, noise, quantiles = [], [], []
    for each in (cut, whole):
        floor = float(np.median([reading.noise_sigma for reading in each]))  # type: ignore[type-var, arg-type]
        assert all(reading.local_maxima is not None for reading in each)
        maxima = [reading.local_maxima for reading in each if reading.local_maxima is not None]
        at = [m.near(lateral_m=on.lateral_m, low_depth_m=on.depth_m, high_depth_m=on.depth_m + 6e-3) for m in maxima]
        near.append([found[0] / floor for found in at if found is not None])
        heights = np.array([np.frombuffer(m.intensities, "<f4")[: m.columns * (m.rows - 1)] for m in maxima]) / floor
        noise.append([float(np.median(row)) for row in heights])
        quantiles.append(np.quantile(heights[:, : 3 * maxima[0].columns], (0.5, 0.9, 0.99)))
    assert {(m.rows, m.columns, m.first_depth_m) for m in maxima} == {
        (m.rows, m.columns, m.first_depth_m) for m in (reading.local_maxima for reading in cut) if m is not None
    }
    assert apart(*near, tolerance=0.03 * float(np.mean(near[1]))) < 1
    assert apart(*noise, tolerance=0.06) < 1
    assert quantiles[0] == pytest.approx(quantiles[1], abs=0.15)


def test_a_dark_frame_has_no_arrivals_and_the_local_maxima_of_noise() -> None:
    cut = readings(STUDY, 4, None)
    for reading in cut:
        assert reading.arrivals == ()
        assert reading.local_maxima is not None
        assert np.frombuffer(reading.local_maxima.intensities, "<f4").max() == pytest.approx(reading.intensity)


def test_the_noise_free_curve_is_that_of_quiet_frames() -> None:
    cell = cells(STUDY)[0]
    drawn = draw_trial(STUDY, cell, 1)
    assert drawn.unknowns is not None
    window = window_of(drawn.unknowns, cell.world.rig.limits.travel)
    assert noise_free(window, off_deg=0.0) == pytest.approx(1.0, rel=0.01)
    strong = replace(STUDY, level="frames", rig=replace(STUDY.rig, noise=NoiseSettings(peak_snr_db=45.0)))
    top = np.mean([reading.intensity for reading in readings(strong, 1, 0.0)])
    for off_deg in (1.5, 5.0):
        measured = np.mean([reading.intensity for reading in readings(strong, 1, off_deg)]) / top
        assert noise_free(window, off_deg=off_deg) == pytest.approx(measured, rel=0.05, abs=0.01)


def test_searches_are_as_wrong_from_readings_as_from_frames() -> None:
    """Errors of the posterior over the same rigs and markers, by rank: both levels have the same distribution."""
    study = replace(
        STUDY,
        policies=(PolicySettings(method="posterior", acquisitions=7, early_end=False),),
        trials=14,
        rig=SimulatedSettings(noise=NoiseSettings(peak_snr_db=35.0), start_deg=-35.0),
    )
    errors = [
        [run_row(replace(study, level=level), trial).error_deg for trial in range(study.trials)]  # type: ignore[arg-type]
        for level in ("readings", "frames")
    ]
    assert stats.mannwhitneyu(*errors).pvalue > 0.01
    assert max(np.median(each) for each in errors) < 1
