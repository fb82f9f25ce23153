"""What the cameras see move during a search, as it is handed on and drawn while the search goes on."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from markerseek.bridges.page.session_display import session_motion
from markerseek.core import as_vector
from markerseek.registration import MOTION_FILE, WatchedMotion, read_motion, show_motion
from markerseek.registration.watched_motion import on_cameras_clock
from markerseek.vision import ClockOffset, Moment, Sighting, TissueMoves

SPOT_M = np.array([0.0, 0.0, 0.1])
PERIOD_S = 4.0
SWING_MM = 2.0
BREATH = TissueMoves(
    from_s=0.0,
    until_s=20.0,
    rest_mm=(0.0, -0.5, 0.0),
    swing_mm=(0.0, SWING_MM, 0.0),
    covariance_mm2=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-3)),
    period_s=PERIOD_S,
    period_sigma_s=0.01,
    pause_at_s=1.0,
    pause_s=1.5,
)


def sighting(y_mm: float, *, at_m: np.ndarray | None = None) -> Sighting:
    moved_m = np.array([0.0, 1e-3 * y_mm, 0.0])
    return Sighting(value_m=moved_m if at_m is None else at_m + moved_m, covariance_m2=1e-10 * np.eye(3))


def y_mm(at_s: float) -> float:
    """Displacement of tissue that breathes."""
    return -0.5 + SWING_MM * np.sin(np.pi * at_s / PERIOD_S) ** 2


MOMENTS = tuple(
    Moment(at_s=at_s, tissue=sighting(y_mm(at_s)))
    if number % 5
    else Moment(at_s=at_s, spot=sighting(y_mm(at_s) + 0.3, at_m=SPOT_M))
    for number, at_s in enumerate(np.arange(0.0, 100.0, 0.25))
)


def test_the_last_minute_is_handed_on_in_millimetres(tmp_path: Path) -> None:
    motion = WatchedMotion.of("3", (*MOMENTS, Moment(at_s=99.9)), spot_m=SPOT_M, breath=BREATH)
    assert min(motion.tissue_s) == pytest.approx(40.0, abs=0.3)
    assert [moved[1] for moved in motion.tissue_mm] == pytest.approx([y_mm(at_s) for at_s in motion.tissue_s])
    assert [moved[1] for moved in motion.spot_mm] == pytest.approx([y_mm(at_s) + 0.3 for at_s in motion.spot_s])
    assert motion.unknown_s == [99.9]
    show_motion(tmp_path, motion)
    assert read_motion(tmp_path) == motion
    (tmp_path / MOTION_FILE).write_text("{}")
    assert read_motion(tmp_path) is None
    assert read_motion(tmp_path / "none") is None


def test_every_pause_between_the_first_time_and_the_last_is_named() -> None:
    motion = WatchedMotion.of("3", MOMENTS[:80], spot_m=SPOT_M, breath=BREATH)
    assert motion.pauses == [(1.0 + 4 * n, 2.5 + 4 * n) for n in range(5)]
    assert structs.replace(motion, breath=None).pauses == []


def test_the_breath_is_told_on_the_clock_of_the_cameras() -> None:
    offset = ClockOffset(offset_s=0.25, sigma_s=0.01)
    there = on_cameras_clock(BREATH, offset)
    assert there is not None
    assert there.pause_at_s == 1.25
    assert on_cameras_clock(BREATH, None) is None
    assert on_cameras_clock(structs.replace(BREATH, pause_at_s=None), offset) is None


def test_it_is_drawn_along_the_breath_from_its_rest_with_the_pauses() -> None:
    said, picture = session_motion(WatchedMotion.of("3", MOMENTS[:80], spot_m=SPOT_M, breath=BREATH))
    assert (
        said
        == "marker 3: the tissue is seen to move by ± 1.00 mm along (0.0, 1.0, 0.0) of the left camera, every 4.0 s"
    )
    assert picture.count('class="ms-pause"') == 5
    assert picture.count("<circle") == 16
    # The tissue rests at 0 and goes to 2 mm: as many pixels up as the axis has between these.
    (line,) = re.findall(r'polyline points="([^"]*)"', picture)
    heights = [float(point.partition(",")[2]) for point in line.split()]
    ticks = dict(re.findall(r'y="([\d.]+)" text-anchor="end" font-size="12" fill="currentColor">([\d.]+)<', picture))
    zero, two = (next(float(y) - 4 for y, text in ticks.items() if float(text) == value) for value in (0, 2))
    assert max(heights) == pytest.approx(zero, abs=1.5)
    assert min(heights) == pytest.approx(two, abs=1.5)


def test_without_a_breath_the_largest_displacements_give_the_direction_and_what_is_not_seen_is_said() -> None:
    blind = (*MOMENTS[:20], *(Moment(at_s=5.0 + number) for number in range(3)))
    said, _ = session_motion(WatchedMotion.of("1", blind, spot_m=SPOT_M, breath=None))
    assert said == "marker 1: the tissue is seen to move by ± 1.00 mm; 3 of 19 image pairs do not show it"
    said, picture = session_motion(WatchedMotion.of("1", (Moment(at_s=1.0),), spot_m=SPOT_M, breath=None))
    assert said == "marker 1: none of 1 image pair shows how the tissue moves"
    assert "<svg" in picture


def test_tissue_that_rests_is_called_so_and_is_drawn_across_the_view_whose_depth_is_known_least() -> None:
    rng = np.random.default_rng(5)
    off_mm = rng.normal(size=(60, 3)) * (0.02, 0.02, 0.3)
    times_s = [0.1 * number for number in range(60)]
    motion = WatchedMotion(
        name="2",
        tissue_s=times_s,
        tissue_mm=[as_vector(each) for each in off_mm],
        spot_s=times_s[:1],
        spot_mm=[(0.0, 0.0, 9.0)],
        unknown_s=[],
    )
    said, picture = session_motion(motion)
    half_mm = re.fullmatch(r"marker 2: the tissue is at rest, within ± (0\.\d\d) mm", said)
    assert half_mm is not None
    assert float(half_mm[1]) < 0.1
    # 9 mm of depth would be far above the axis.
    ticks = [
        float(text) for text in re.findall(r'text-anchor="end" font-size="12" fill="currentColor">([\d.]+)<', picture)
    ]
    assert max(ticks) < 2
