"""What the markers so far say of the next spot: it holds the truth as often as it says."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from benchmarks.registration.forged_markers import LIMITS, REACH, STEREO, ForgedScene
from markerseek.core import AnglePrior, Interval
from markerseek.registration import poses
from markerseek.registration.choice import choose
from markerseek.registration.poses import Poses

SCENES = 60


def angle_deg(scene: ForgedScene, spot_m: np.ndarray) -> float:
    x, _, z = scene.heard(spot_m)
    return math.degrees(math.atan2(x, z))


def drawn(scene: ForgedScene, count: int) -> tuple[Poses, np.ndarray]:
    """Poses of so many markers, and one spot more."""
    *spots, one_more = scene.wide(count + 1) if count > 1 else [scene.place(), scene.place()]
    markers = scene.markers(spots)
    found = Poses.of(markers, choose(markers), REACH, rng=np.random.default_rng(0))
    assert found is not None
    return found, one_more


def held(count: int, holds: Callable[[AnglePrior, float], bool]) -> list[bool]:
    """Whether what so many markers predict of the next one holds its angle, of each scene that they predict."""
    found = []
    for seed in range(SCENES):
        scene = ForgedScene(seed)
        possible, spot = drawn(scene, count)
        seen = scene.seen("next", spot)
        prediction = possible.predict(seen.camera_m, seen.camera_covariance_m2, limits=LIMITS)
        if prediction is not None:
            found.append(holds(prediction.prior, angle_deg(scene, spot)))
    return found


@pytest.mark.parametrize("count", [3, 4])
def test_a_registration_predicts_the_angle_of_the_next_marker(count: int) -> None:
    within = held(count, lambda prior, angle: abs(angle - prior.mean_deg) <= 3 * prior.sigma_deg)
    # Said for most of them, and right in at least 95 %.
    assert len(within) >= 0.8 * SCENES
    assert np.mean(within) >= 0.95


@pytest.mark.parametrize("count", [1, 2])
def test_before_a_registration_the_window_holds_the_next_marker(count: int) -> None:
    within = held(count, lambda prior, angle: angle in prior.interval(LIMITS))
    assert len(within) >= 0.1 * SCENES
    assert np.mean(within) >= 0.98


def test_the_place_that_three_markers_propose_is_in_reach(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(poses, "_GRID", (10, 8))
    inside = []
    for seed in range(20):
        scene = ForgedScene(seed)
        found, _ = drawn(scene, 3)
        place = found.best_place(STEREO, REACH, target_trus_m=None, probe_deg=0.0)
        if place is not None:
            x, y, z = scene.heard(scene.true.apply(np.array(place.camera_m)))
            inside.append(
                REACH.angles.low_deg <= math.degrees(math.atan2(x, z)) <= REACH.angles.high_deg
                and abs(y) <= REACH.lateral_m
            )
    assert len(inside) >= 15
    assert np.mean(inside) >= 0.9


@pytest.mark.parametrize("count", [3, 4])
def test_corners_are_asked_for_apart_from_other_spots(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    monkeypatch.setattr(poses, "_GRID", (16, 12))
    outwards = []
    for seed in range(10):
        scene = ForgedScene(seed)
        spots = [scene.place(8e-3, 6e-3) for _ in range(2)] + [scene.at(24e-3, 16e-3), scene.at(-24e-3, 16e-3)]
        spots[1] = spots[0] + [0, 12e-3, 0]
        markers = scene.markers(spots[:count])
        found = Poses.of(markers, choose(markers), REACH, rng=np.random.default_rng(0))
        assert found is not None
        place = found.best_place(STEREO, REACH, target_trus_m=None, probe_deg=0.0)
        assert place is not None
        there_m = scene.true.apply(np.array(place.camera_m))
        assert min(np.linalg.norm(there_m - spot) for spot in spots[:count]) > 13e-3
        outwards.append([abs(there_m[0]), abs(there_m[1])])
    # The probe reaches 29 mm and 22 mm of tissue; the cameras' tilt and what they see take some of that.
    assert np.median(outwards, axis=0) == pytest.approx([26e-3, 18e-3], abs=6e-3)


@pytest.mark.parametrize(
    "limits", [LIMITS, Interval(low_deg=-120.0, high_deg=120.0), Interval(low_deg=2.0, high_deg=3)]
)
def test_markers_that_do_not_fit_predict_nothing_that_a_search_refuses(limits: Interval) -> None:
    some = 0
    for seed in range(SCENES):
        scene = ForgedScene(seed)
        *spots, one_more = scene.wide(3 + seed % 3)
        # Each marker is another source, somewhere else.
        markers = [
            scene.seen(str(number), spot, [scene.other(spot, 1.0)]) for number, spot in enumerate(spots, start=1)
        ]
        possible = Poses.of(markers, choose(markers), REACH, rng=np.random.default_rng(0))
        if possible is not None:
            seen = scene.seen("next", one_more)
            prediction = possible.predict(seen.camera_m, seen.camera_covariance_m2, limits=limits)
            some += prediction is not None
            # A search takes it, or it is None.
            assert prediction is None or prediction.prior.interval(limits)
    assert some or limits.width_deg < 10
