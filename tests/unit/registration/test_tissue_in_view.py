"""Displacements of tissue that cameras saw, in the frame of the probe: against turns drawn one by one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.core import FollowedTissue, SpotToSource
from markerseek.registration.poses import Poses
from markerseek.registration.tissue_in_view import TissueInView
from markerseek.sim import VirtualClock
from markerseek.vision import ClockOffset, Moment, Sighting, TissueMoves

COVARIANCE_M2 = 1e-6 * np.diag([0.05**2, 0.05**2, 0.3**2])


def moments(*, every_s: float = 0.15, late_s: float = 0.0, until_s: float = 6.0) -> list[Moment]:
    """A sine of 4 s and 2 mm along x, 1 mm along z of the camera."""
    return [
        Moment(
            at_s=at_s + late_s,
            tissue=Sighting(value_m=place_m(at_s), covariance_m2=COVARIANCE_M2),
        )
        for at_s in np.arange(0.0, until_s, every_s).tolist()
    ]


def place_m(at_s: float) -> np.ndarray:
    return np.array([2e-3, 0.0, 1e-3]) * np.sin(np.pi * at_s / 2)


def poses(rotations: np.ndarray) -> Poses:
    return Poses(
        rotations=rotations,
        translations_m=np.zeros((len(rotations), 3)),
        pairs=(),
        registration=None,
        spot=SpotToSource(),
    )


def test_with_one_pose_it_is_turned_into_the_probes_frame() -> None:
    turn = Rotation.from_euler("xyz", [170, 20, 35], degrees=True).as_matrix()
    offset = ClockOffset(offset_s=0.06, sigma_s=0.0)
    seen = moments(late_s=0.06)
    tissue = TissueInView(lambda: seen, VirtualClock(), poses=poses(turn[None]), offset=offset)
    assert isinstance(tissue, FollowedTissue)
    for at_s in (0.31, 1.0, 2.22, 4.4):
        found = tissue.displacement(at_s)
        assert found is not None
        np.testing.assert_allclose(found.mm, 1e3 * turn @ place_m(at_s), atol=0.02)
        np.testing.assert_allclose(found.covariance_mm2, 1e6 * turn @ COVARIANCE_M2 @ turn.T, atol=1e-9)


@pytest.mark.parametrize("spread_deg", [3.0, 40.0])
def test_over_several_poses_it_has_their_mean_and_their_scatter(spread_deg: float) -> None:
    rng = np.random.default_rng(1)
    turns = Rotation.from_rotvec(np.radians(spread_deg) * rng.standard_normal((500, 3))).as_matrix()
    tissue = TissueInView(moments, VirtualClock(), poses=poses(turns), offset=ClockOffset(offset_s=0.0, sigma_s=0.0))
    found = tissue.displacement(1.05)
    assert found is not None
    true_mm = 1e3 * turns @ place_m(1.05)
    np.testing.assert_allclose(found.mm, true_mm.mean(axis=0), atol=0.01)
    errors = np.array([turn @ (1e6 * COVARIANCE_M2) @ turn.T for turn in turns]).mean(axis=0)
    np.testing.assert_allclose(found.covariance_mm2, np.cov(true_mm.T, ddof=0) + errors, atol=0.02)


def test_before_the_first_marker_its_size_is_its_error_in_any_direction() -> None:
    tissue = TissueInView(moments, VirtualClock(), offset=ClockOffset(offset_s=0.0, sigma_s=0.0))
    found = tissue.displacement(1.05)
    assert found is not None
    assert found.mm == (0.0, 0.0, 0.0)
    size_mm2 = float(1e6 * place_m(1.05) @ place_m(1.05) + 1e6 * np.trace(COVARIANCE_M2))
    np.testing.assert_allclose(found.covariance_mm2, size_mm2 / 3 * np.eye(3), rtol=0.01, atol=1e-9)


def test_a_clock_that_is_not_known_adds_what_the_tissue_moves_meanwhile() -> None:
    turn = np.eye(3)[None]
    known = TissueInView(
        moments, VirtualClock(), poses=poses(turn), offset=ClockOffset(offset_s=0.0, sigma_s=0.0)
    ).displacement(0.05)
    unknown = TissueInView(moments, VirtualClock(), poses=poses(turn)).displacement(0.05)
    assert known is not None
    assert unknown is not None
    speed_mm_s = 1e3 * (place_m(0.15) - place_m(0.0)) / 0.15
    more = np.array(unknown.covariance_mm2) - np.array(known.covariance_mm2)
    np.testing.assert_allclose(more, 0.05**2 * np.outer(speed_mm_s, speed_mm_s), rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("at_s", [-0.1, 6.1, 2.2])
def test_where_pairs_are_missing_it_is_not_known(at_s: float) -> None:
    seen = [each for each in moments() if not 1.9 < each.at_s < 2.5]
    assert TissueInView(lambda: seen, VirtualClock()).displacement(at_s) is None


def test_it_rests_in_the_pause_of_the_breath_that_was_seen() -> None:
    clock = VirtualClock()
    breath = TissueMoves(
        from_s=0.0,
        until_s=20.0,
        rest_mm=(0.0, 0.0, 0.0),
        swing_mm=(2.0, 0.0, 0.0),
        covariance_mm2=((0.01, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.01)),
        period_s=4.0,
        period_sigma_s=0.05,
        pause_at_s=1.0,
        pause_s=1.5,
    )
    tissue = TissueInView(moments, clock, breath=breath)
    assert (tissue.breath_s, tissue.pause_s) == (4.0, 1.5)
    assert tissue.rests(0.1) is False
    clock.wait(5.2)
    assert tissue.rests(1.0) is True
    assert tissue.rests(1.5) is False
    assert TissueInView(moments, clock).rests(0.1) is None
