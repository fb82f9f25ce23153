"""The tissue that a search is given, from what cameras saw of a saw-toothed breath, with a clock of their own."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import FollowedTissue
from markerseek.registration.camera_tissue import CameraRotation, CameraTissue
from markerseek.registration.poses import Poses
from markerseek.sim import VirtualClock
from markerseek.vision import ClockOffset, Moment, Sighting, TissueMoves

LATE_S = 0.3
TURN = Rotation.from_euler("xyz", (170.0, 20.0, 40.0), degrees=True).as_matrix()
SWING_MM = np.array([0.5, 2.0, -1.0])
REST_MM = np.array([3.0, -1.0, 2.0])
"""Where the tissue rests, compared with the pair before the search."""

BREATH = TissueMoves(
    from_s=-10.0,
    until_s=0.0,
    rest_mm=(9.0, 9.0, 9.0),
    swing_mm=cast("Any", tuple(SWING_MM.tolist())),
    covariance_mm2=((1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0), (0.0, 0.0, 1e-3)),
    period_s=4.0,
    period_sigma_s=0.01,
    pause_at_s=-8.0,
    pause_s=1.6,
)


def share(at_s: float) -> float:
    """How far a breath is drawn in: none for 1.6 s of 4, and then up and down evenly."""
    phase_s = at_s % 4.0
    return 0.0 if phase_s <= 1.6 else 1 - abs(phase_s - 2.8) / 1.2


def tissue(*, until_s: float, rotation: CameraRotation | None) -> CameraTissue:
    """The tissue at a time of the rig's clock, seen ten times a second."""
    clock = VirtualClock()
    clock.wait(until_s)
    moments = [
        Moment(
            at_s=float(at_s) + LATE_S,
            tissue=Sighting(
                value_m=1e-3 * (REST_MM + share(float(at_s)) * SWING_MM), covariance_m2=1e-10 * np.diag([1, 1, 9])
            ),
        )
        for at_s in np.arange(0.0, until_s - LATE_S, 0.1)
    ]
    watch = cast("Any", SimpleNamespace(moments=tuple(moments)))
    offset = ClockOffset(offset_s=LATE_S, sigma_s=0.005)
    return CameraTissue(watch=watch, clock=clock, offset=offset, breath=BREATH, rotation=rotation)


def test_a_displacement_is_that_from_the_rest_in_the_frame_of_the_probe() -> None:
    seen = tissue(until_s=9.0, rotation=CameraRotation(matrix=TURN, sigma_rad=0.05))
    assert isinstance(seen, FollowedTissue)
    for at_s in (0.5, 2.25, 2.8, 6.33):
        found = seen.displacement(at_s)
        assert found is not None
        np.testing.assert_allclose(found.mm, TURN @ SWING_MM * share(at_s), atol=0.09)
        # A turn does not change the length: along the displacement there is its own error alone.
        way = TURN @ SWING_MM / np.linalg.norm(SWING_MM)
        covariance = np.array(found.covariance_mm2)
        assert way @ covariance @ way < 1e-3
        expected = 0.05**2 * (share(at_s) * np.linalg.norm(SWING_MM)) ** 2
        assert np.trace(covariance) == pytest.approx(2 * expected, abs=2e-3, rel=0.15)


def test_a_displacement_without_a_rotation_has_its_size_only() -> None:
    found = tissue(until_s=9.0, rotation=None).displacement(2.8)
    assert found is not None
    assert found.mm == (0.0, 0.0, 0.0)
    variances = np.linalg.eigvalsh(np.array(found.covariance_mm2))
    np.testing.assert_allclose(variances, SWING_MM @ SWING_MM, rtol=0.1)


def test_what_was_not_seen_is_not_known() -> None:
    seen = tissue(until_s=9.0, rotation=None)
    assert seen.displacement(8.9) is None
    assert seen.displacement(-0.5) is None
    assert seen.displacement(9.0 - seen.known_after_s) is not None
    # No pause was seen yet.
    assert not tissue(until_s=0.35, rotation=None).rest_is_known


def test_it_rests_in_the_pause_alone() -> None:
    assert tissue(until_s=8.2, rotation=None).rests(1.0)
    assert not tissue(until_s=8.2, rotation=None).rests(1.5)
    assert not tissue(until_s=10.5, rotation=None).rests(0.1)


def test_it_is_in_step_with_the_last_pause_that_was_seen() -> None:
    """The breath was seen to pause at other times than this: it is 0.9 s off by now."""
    off = structs.replace(BREATH, pause_at_s=-7.1)
    for until_s, at_rest in ((8.3, True), (9.2, False), (10.5, False), (12.5, True)):
        seen = replace(tissue(until_s=until_s, rotation=None), breath=off)
        assert seen.rests(0.3) is at_rest
    found = replace(tissue(until_s=9.0, rotation=None), breath=off).displacement(4.5)
    assert found is not None
    # At rest, as the breath that was seen tells.
    assert np.trace(found.covariance_mm2) < 0.01


def test_nothing_waits_where_displacements_are_taken_out() -> None:
    precise = tissue(until_s=9.0, rotation=CameraRotation(matrix=TURN, sigma_rad=0.01))
    assert precise.breath_s is None
    assert precise.pause_s == 0.0
    coarse = tissue(until_s=9.0, rotation=CameraRotation(matrix=TURN, sigma_rad=0.2))
    assert (coarse.breath_s, coarse.pause_s) == (4.0, 1.6)
    free = replace(tissue(until_s=9.0, rotation=None), waits=False)
    assert free.breath_s is None
    assert free.displacement(2.8) is not None


def test_the_rotation_is_the_mean_of_the_poses_and_none_if_they_disagree() -> None:
    rng = np.random.default_rng(2)

    def poses(sigma_rad: float) -> Poses:
        turns = Rotation.from_rotvec(sigma_rad * rng.standard_normal((2000, 3)))
        return cast("Any", SimpleNamespace(rotations=(Rotation.from_matrix(TURN) * turns).as_matrix()))

    found = CameraRotation.of(poses(0.1))
    assert found is not None
    np.testing.assert_allclose(found.matrix, TURN, atol=0.02)
    assert found.sigma_rad == pytest.approx(0.1, rel=0.05)
    assert CameraRotation.of(poses(1.0)) is None
    assert CameraRotation.of(None) is None
