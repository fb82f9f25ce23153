"""Endoscope, tissue and spot: which of them moved is told by how it moved."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from markerseek.geometry import RigidTransform, StereoMotion, at_rest
from markerseek.vision import EndoscopeMoved, Moment, Sighting, told_apart

MIDDLE_M = np.array([0.0, 0.0, 0.08])
POINT_M = np.array([0.01, -0.005, 0.082])
SIGMA_MM = np.array([0.01, 0.01, 0.04])
SIGMA_DEG = 0.01
RATE_HZ = 10.0


def motion(pose: np.ndarray) -> RigidTransform:
    """A motion by a rotation vector (deg) about the middle and its displacement (mm)."""
    rest = at_rest()
    rotation = Rotation.from_rotvec(pose[:3], degrees=True).as_matrix()
    return RigidTransform(
        source=rest.source,
        target=rest.target,
        rotation=rotation,
        translation_m=MIDDLE_M + 1e-3 * pose[3:] - rotation @ MIDDLE_M,
    )


def moments(
    poses: np.ndarray, *, tissue_mm: np.ndarray | None = None, spot_mm: np.ndarray | None = None, seed: int = 1
) -> list[Moment]:
    """What the cameras see of a scene with these poses, of tissue that moves beside it, and of a spot on the tissue."""
    rng = np.random.default_rng(seed)
    count = len(poses)
    tissue_mm = np.zeros((count, 3)) if tissue_mm is None else tissue_mm
    spot_mm = np.zeros((count, 3)) if spot_mm is None else spot_mm
    sigmas = np.concatenate([np.full(3, SIGMA_DEG), SIGMA_MM])
    covariance = np.diag((sigmas * [*[np.radians(1)] * 3, *[1e-3] * 3]) ** 2)
    point_m2 = 1e-6 * np.diag(SIGMA_MM**2)
    told = []
    for number, pose in enumerate(poses):
        noisy = motion(pose + sigmas * rng.standard_normal(6))
        scene = StereoMotion(
            transform=noisy,
            middle_m=noisy.apply(MIDDLE_M),
            covariance=covariance,
            shared=np.ones(1, dtype=bool),
            misfit=1.0,
            unevenness=1.0,
        )
        true_m = motion(pose).apply(POINT_M) + 1e-3 * tissue_mm[number]
        tissue_m = true_m - POINT_M + 1e-3 * SIGMA_MM * rng.standard_normal(3)
        spot = Sighting(
            value_m=true_m + 1e-3 * (spot_mm[number] + SIGMA_MM * rng.standard_normal(3)), covariance_m2=point_m2
        )
        told.append(
            Moment(
                at_s=number / RATE_HZ,
                scene=scene,
                tissue=Sighting(value_m=tissue_m, covariance_m2=point_m2),
                spot=spot if number % 5 == 0 else None,
            )
        )
    return told


def still(seconds: float) -> np.ndarray:
    return np.zeros((round(seconds * RATE_HZ), 6))


def breath_mm(seconds: float, *, swing_mm: float = 2.0, period_s: float = 4.0) -> np.ndarray:
    turns = np.arange(round(seconds * RATE_HZ)) / RATE_HZ / period_s
    return (swing_mm * np.sin(np.pi * turns) ** 4)[:, None] * [0.6, 0.8, 0.0]


@pytest.mark.parametrize("seed", range(10))
def test_what_stands_still_is_told_to(seed: int) -> None:
    told = told_apart(moments(still(40), seed=seed))
    assert told.endoscope == ()
    assert told.tissue == ()
    assert told.spot == ()
    assert told.known == 1.0


@pytest.mark.parametrize(
    "change", [(0, 0, 0, 0.5, 0, 0), (0, 0, 0, 0, 0, 0.5), (0.3, 0, 0, 0, 0, 0), (2, -3, 5, 10, 5, -8)]
)
@pytest.mark.parametrize("breathes", [False, True])
@pytest.mark.parametrize("before_s", [8.0, 20.0])
def test_a_move_of_the_endoscope_is_told_once(change: tuple[float, ...], breathes: bool, before_s: float) -> None:
    poses = still(40)
    if breathes:
        poses[:, 3:] += breath_mm(40)
    poses[round(before_s * RATE_HZ) :] += change
    told = told_apart(moments(poses))
    assert len(told.endoscope) == 1
    (move,) = told.endoscope
    assert move.from_s == pytest.approx(before_s, abs=0.5)
    assert before_s <= move.until_s <= before_s + (4.5 if breathes else 1.0)
    truth = motion(np.array(change, dtype=float))
    for point_m in (MIDDLE_M, POINT_M, MIDDLE_M + np.array([0.02, 0, 0])):
        there_m, covariance_m2 = move.carried(point_m, np.zeros((3, 3)))
        miss_mm = 1e3 * (there_m - truth.apply(point_m))
        # Breathing along with the whole scene turns with the endoscope: a few per cent of it stay.
        assert np.linalg.norm(miss_mm) < (0.25 if breathes else 0.15)
        if not breathes:
            miss_m = 1e-3 * miss_mm
            assert miss_m @ np.linalg.solve(covariance_m2, miss_m) < 21
    assert told.spot == ()


@pytest.mark.parametrize(("swing_mm", "shift_mm"), [(0.0, (0.5, 0, 0)), (2.0, (10, 5, -8))])
def test_a_move_during_the_first_breath_is_told(swing_mm: float, shift_mm: tuple[float, ...]) -> None:
    poses = still(40)
    poses[:, 3:] += breath_mm(40, swing_mm=swing_mm)
    poses[30:, 3:] += shift_mm
    told = told_apart(moments(poses))
    assert told.endoscope[0].from_s <= 3.0
    # How much of it was breath is not known: the covariance says so.
    move = told.endoscope[0]
    miss_mm = np.array(move.displacement_mm) - shift_mm
    assert miss_mm @ np.linalg.solve(np.array(move.covariance)[3:, 3:], miss_mm) < 30


def test_two_moves_are_told_apart() -> None:
    poses = still(60)
    poses[200:] += [0, 0, 0, 2, 0, 0]
    poses[400:] += [0, 1, 0, 0, 1, 0]
    told = told_apart(moments(poses))
    assert [round(move.until_s) for move in told.endoscope] == [20, 40]
    np.testing.assert_allclose(told.endoscope[0].displacement_mm, [2, 0, 0], atol=0.05)
    np.testing.assert_allclose(told.endoscope[1].rotation_deg, [0, 1, 0], atol=0.05)


def test_the_way_of_the_endoscope_is_no_motion_of_the_tissue() -> None:
    poses = still(40)
    poses += np.clip((np.arange(len(poses))[:, None] - 150) / 15, 0, 1) * [1, 2, 0, 6, 3, -5]
    told = told_apart(moments(poses))
    assert len(told.endoscope) == 1
    assert told.tissue == ()


def test_an_endoscope_that_creeps_has_moved() -> None:
    poses = still(60)
    poses[:, 3] = np.linspace(0, 1.5, len(poses))
    told = told_apart(moments(poses))
    assert told.endoscope
    assert sum(move.displacement_mm[0] for move in told.endoscope) == pytest.approx(1.4, abs=0.35)


@pytest.mark.parametrize("whole", [True, False])
def test_breathing_is_told_to_be_the_tissue(whole: bool) -> None:
    poses = still(30)
    beside_mm = breath_mm(30)
    if whole:
        poses[:, 3:] += beside_mm
        beside_mm = np.zeros_like(beside_mm)
    told = told_apart(moments(poses, tissue_mm=beside_mm))
    assert told.endoscope == ()
    assert told.spot == ()
    (tissue,) = told.tissue
    assert tissue.period_s == pytest.approx(4.0, rel=0.02)
    assert tissue.amplitude_mm == pytest.approx(1.0, rel=0.1)


def test_breathing_that_begins_anew_is_no_move_of_the_endoscope() -> None:
    poses = still(50)
    poses[250:, 3:] += breath_mm(25)
    assert told_apart(moments(poses)).endoscope == ()


@pytest.mark.parametrize("seed", range(6))
def test_breaths_of_uneven_depth_are_no_move_of_the_endoscope(seed: int) -> None:
    rng = np.random.default_rng(seed)
    poses = still(45)
    # Depths from 70 to 100 % of 6 mm, begun anywhere in a breath.
    cycles = [
        breath_mm(period_s, swing_mm=rng.uniform(4.2, 6), period_s=period_s) for period_s in rng.uniform(3.5, 5, 14)
    ]
    poses[:, 3:] = np.concatenate(cycles)[rng.integers(0, 30) :][: len(poses)]
    assert told_apart(moments(poses)).endoscope == ()


def test_a_breath_of_another_depth_is_no_move_of_the_endoscope() -> None:
    poses = still(48)
    poses[:, 3:] = np.concatenate([breath_mm(24, swing_mm=1.5), breath_mm(24, swing_mm=2.5)])
    assert told_apart(moments(poses)).endoscope == ()


def test_nothing_is_said_before_a_breath_is_over() -> None:
    poses = still(23)
    poses[200:] += [0, 0, 0, 2, 0, 0]
    assert told_apart(moments(poses)).endoscope == ()


def test_a_spot_that_slides_on_breathing_tissue_is_told() -> None:
    poses = still(40)
    poses[:, 3:] += breath_mm(40)
    slide_mm = np.zeros((400, 3))
    slide_mm[200:] = [0.5, 0.0, 0.0]
    told = told_apart(moments(poses, spot_mm=slide_mm))
    assert told.endoscope == ()
    (slid,) = told.spot
    np.testing.assert_allclose(slid.displacement_mm, [0.5, 0, 0], atol=0.1)
    assert slid.from_s < 20.0 <= slid.until_s


def test_a_spot_on_tissue_that_moves_along_has_not_slid() -> None:
    poses = still(40)
    beside_mm = breath_mm(40, swing_mm=3.0)
    poses[200:] += [0, 0, 0, 2, 0, 0]
    told = told_apart(moments(poses, tissue_mm=beside_mm))
    assert told.spot == ()
    assert len(told.endoscope) == 1


def test_a_highlight_that_each_breath_carries_by_is_no_spot_that_has_slid() -> None:
    poses = still(40)
    poses[:, 3:] += breath_mm(40)
    beside_mm = np.zeros((400, 3))
    # Seen where the breath is deepest, in each breath twice.
    beside_mm[breath_mm(40)[:, 0] > 0.8 * breath_mm(40)[:, 0].max()] = [4.2, 3.9, 7.0]
    told = told_apart(moments(poses, spot_mm=beside_mm))
    assert len(told.tissue) == 1
    assert told.spot == ()


def test_moments_without_a_scene_count_as_not_looked_at() -> None:
    told = told_apart(
        [moment if number % 4 else Moment(at_s=moment.at_s) for number, moment in enumerate(moments(still(20)))]
    )
    assert told.known == pytest.approx(0.75)
    assert told_apart([]).known == 0.0


def test_a_move_is_carried_with_its_covariance() -> None:
    """Against Monte Carlo: moves drawn from the covariance scatter a point as `carried` says."""
    rng = np.random.default_rng(2)
    root = np.diag([0.1, 0.2, 0.15, 0.05, 0.06, 0.3]) @ (np.eye(6) + 0.2 * rng.standard_normal((6, 6)))
    covariance = root @ root.T
    move = EndoscopeMoved(
        from_s=0,
        until_s=1,
        displacement_mm=(3.0, -2.0, 4.0),
        rotation_deg=(2.0, 4.0, -6.0),
        middle_mm=(3.0, -2.0, 84.0),
        covariance=tuple(tuple(row) for row in covariance.tolist()),
    )
    own_m2 = np.diag([1e-9, 4e-9, 9e-9])
    there_m, said_m2 = move.carried(POINT_M, own_m2)
    middle_m = 1e-3 * np.array(move.middle_mm)
    drawn = []
    for error in (root @ rng.standard_normal((6, 20_000))).T:
        point_m = POINT_M + np.sqrt(np.diag(own_m2)) * rng.standard_normal(3)
        turned = Rotation.from_rotvec(error[:3], degrees=True).apply(move.transform.apply(point_m) - middle_m)
        drawn.append(turned + middle_m + 1e-3 * error[3:])
    np.testing.assert_allclose(np.mean(drawn, axis=0), there_m, atol=1e-5)
    np.testing.assert_allclose(np.cov(np.array(drawn).T), said_m2, rtol=0.08, atol=2e-9)


def test_its_values_are_stored_and_read() -> None:
    import msgspec

    poses = still(30)
    poses[150:] += [0, 0, 0, 2, 0, 0]
    told = told_apart(moments(poses, tissue_mm=breath_mm(30)))
    for value in itertools.chain(told.endoscope, told.tissue):
        assert msgspec.json.decode(msgspec.json.encode(value), type=type(value)) == value
