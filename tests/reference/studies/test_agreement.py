"""The two levels of a study agree: intensities drawn from curves, and intensities read from simulated channel data."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.rigs import draw_scene
from markerseek.sim import LaserSettings, MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies import (
    Axis,
    CurveSettings,
    Row,
    Share,
    Study,
    cells,
    intensity_curve,
    run_trial,
    study_policy,
    summarise,
)

pytestmark = [pytest.mark.long, pytest.mark.usefixtures("unchecked_shapes")]

FRAMES = 30

STEADY = SimulatedSettings(
    marker=MarkerSettings(angle_deg=0.0, lateral_m=4.1e-3),
    laser=LaserSettings(energy_jitter=0.0),
    # the noise of 20 dB would touch full scale beside a marker of the default height
    receiver=ReceiverSettings(peak_counts=150.0),
)


def intensities(rig: rigs.Rig, off_plane_deg: float | None, *, count: int) -> np.ndarray:
    measure = rig.scanner.measure_dark if off_plane_deg is None else lambda: rig.scanner.measure(off_plane_deg)
    return np.array([measure().reading.intensity for _ in range(count)])


@pytest.mark.parametrize("peak_snr_db", [20.0, 40.0])
@pytest.mark.parametrize("off_plane_deg", [0.0, 1.0, 4.0, 20.0, None])
def test_intensities_are_distributed_alike(peak_snr_db: float, off_plane_deg: float | None) -> None:
    """Means within 0.6 noise standard deviations and 0.7 % beside their Monte Carlo error; scatter within a third.

    Without a marker's sound, within 0.1. What is left is the reader, which refines a peak by parabolas.
    """
    settings = structs.replace(STEADY, noise=NoiseSettings(peak_snr_db=peak_snr_db))
    sigma = draw_scene(settings, np.random.default_rng(1)).peak / 10 ** (peak_snr_db / 20)
    curve, images_cells = intensity_curve(CurveSettings(), settings, seed=1)
    drawn = intensities(
        rigs.of_intensities(seed=2, curve=curve, marker_deg=0.0, cells=images_cells, settings=settings),
        off_plane_deg,
        count=1500,
    )
    read = intensities(rigs.simulated(seed=1, settings=settings), off_plane_deg, count=FRAMES) / sigma
    chance = 3 * float(np.hypot(read.std() / np.sqrt(FRAMES), drawn.std() / np.sqrt(1500)))
    detected = off_plane_deg is not None and drawn.mean() > 6
    tolerance = 0.6 + 0.007 * float(drawn.mean()) if detected else 0.1
    assert abs(read.mean() - drawn.mean()) < chance + tolerance
    # three standard errors of a standard deviation from this many frames, and a third
    assert abs(np.log(read.std() / drawn.std())) < 3 / np.sqrt(2 * FRAMES) + np.log(4 / 3)


def test_a_curve_is_that_of_the_images_without_noise() -> None:
    """At angles between those at which it was computed, on either side of the marker, away from the array's middle."""
    settings = structs.replace(
        STEADY, noise=NoiseSettings(peak_snr_db=55.0), receiver=ReceiverSettings(peak_counts=1500.0)
    )
    curve, _ = intensity_curve(CurveSettings(), settings, seed=1)
    assert curve is not None
    peak = draw_scene(settings, np.random.default_rng(1)).peak
    rig = rigs.simulated(seed=1, settings=settings)
    for off_plane_deg in (0.33, -1.13, 2.9, -5.2, 9.75, -14.5):
        read = intensities(rig, off_plane_deg, count=6).mean() / peak
        assert max(curve.peaks(off_plane_deg)) == pytest.approx(read, rel=0.03, abs=0.004)


def test_searches_are_as_wrong_from_curves_as_from_frames() -> None:
    """Mean errors from frames, and their share beyond 4.33°, lie within the intervals of the same markers."""
    study = Study(
        name="levels",
        trials=14,
        stay=True,
        policies=tuple(
            study_policy(method=method, acquisitions=number, as_published=True, early_end=False)
            for method, number in (("weighted-average", 15), ("ternary", 12))
        ),
        # The former height: at the receiver's own gain these 14 trials happen to err less than 60 of them do.
        rig=SimulatedSettings(start_deg=-35.0, receiver=ReceiverSettings(peak_counts=600.0)),
        vary=(Axis(key="rig.marker.source_radius_m", values=(0.4e-3,)),),
    )
    by_level = {}
    for level, trials in (("curves", 300), ("frames", study.trials)):
        here = structs.replace(study, level=level, trials=trials)  # type: ignore[arg-type]
        rows = [run_trial(here, cells(here)[0], trial, policy) for trial in range(trials) for policy in (0, 1)]
        by_level[level] = (summarise(here, rows), rows)
    truths = [[row.truth_deg for row in rows[: 2 * study.trials]] for _, rows in by_level.values()]
    assert truths[0] == truths[1]
    for policy, (drawn, read) in enumerate(zip(*(summary.policies for summary, _ in by_level.values()), strict=True)):
        assert drawn.error_deg.mean is not None
        assert read.error_deg.interval95 is not None
        low, high = read.error_deg.interval95
        assert low <= drawn.error_deg.mean <= high
        far_drawn, far_read = (_far([row for row in rows if row.policy == policy]) for _, rows in by_level.values())
        assert far_read.interval95 is not None
        assert far_drawn.share is not None
        assert far_read.interval95[0] <= far_drawn.share <= far_read.interval95[1]


def _far(rows: list[Row]) -> Share:
    """Searches that found with an error beyond the angle within which a tool tip is seen."""
    found = [row for row in rows if row.answer == "found"]
    return Share.of(sum(row.error_deg is None or row.error_deg > 4.33 for row in found), len(found))
