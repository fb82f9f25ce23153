"""What moved, told apart by how it moves: the endoscope, the tissue, or the laser spot on it.

- The *endoscope* has moved if the whole scene has, rigidly, and does not come back within the longest breath.
- The *tissue* moves if the scene, or the part of it around the spot, goes to and fro.
- The *spot* has slid if it lies elsewhere than the tissue that it was on.

A scene that has only just moved may be either of the first two: nothing is said before the longest breath is over.
During the first breath of a series, a move by less than a third of that breath is taken for a part of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc

from markerseek.core import Float64, Matrix, Vector, as_matrix, as_vector
from markerseek.geometry import RigidTransform, StereoMotion, motion_about
from markerseek.vision.scene_move import MOVED_DEG, MOVED_MM, SceneMove
from markerseek.vision.tissue_motion import (
    DisplacementSeries,
    TissueMoves,
    tissue_motion,
)

SLID_MM = 0.3
"""Least distance by which a spot is said to have slid."""

MIN_PAIRS = 5
"""Fewest pairs of a window."""

MIN_SPOTS = 3
"""Fewest sightings of a spot before and after it has slid."""

RETURN_S = 6.0
"""Longest breath: tissue that has not come back by then will not."""

_STAYS = 0.8
"""Share of the sightings of the longest breath after it has slid that show a spot elsewhere."""

_MEDIAN = math.pi / 2
"""Variance of a median over that of a mean, of normal values."""

_COMMON = 0.2
"""Part of the variance of a sighting that a mean does not lessen: the light of other tissue, and highlights."""

_BESIDE_MM = 0.07
"""Standard deviation, along each axis, by which a spot that has not slid seems to lie beside its tissue."""

_ENDS = (0.05, 0.5, 0.95)
"""Quantiles of a window that must all have moved: the two ends of a breath, and the middle."""

_SURPRISE = 1e-4
"""Probability of what is called a move, if nothing moved."""


class EndoscopeMoved(SceneMove, frozen=True, kw_only=True, tag="endoscope-moved"):
    """The endoscope has moved: the whole scene lies elsewhere in the camera's frame, and stays there."""

    from_s: float
    until_s: float
    """``from_s`` and ``until_s``: last time at the former place, and first time at the new one."""


class SpotSlid(msgspec.Struct, frozen=True, kw_only=True, tag="spot-slid"):
    """The laser spot lies on other tissue than before."""

    from_s: float
    until_s: float
    """``from_s`` and ``until_s``: last time at the former place, and first time at the new one."""
    displacement_mm: Vector
    """Displacement on the tissue, in the left camera's frame."""
    covariance_mm2: Matrix


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sighting:
    """A place or a displacement in the left camera's frame."""

    value_m: Float64[np.ndarray, " 3"]
    covariance_m2: Float64[np.ndarray, "3 3"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moment:
    """What was seen at one time; None for what was not."""

    at_s: float
    scene: StereoMotion | None = None
    """Motion of the scene since the reference."""
    tissue: Sighting | None = None
    """Displacement of the tissue around the spot since the reference."""
    spot: Sighting | None = None
    """Place of the spot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ToldApart:
    """What moved during a series of moments."""

    endoscope: tuple[EndoscopeMoved, ...]
    tissue: tuple[TissueMoves, ...]
    """One for each stretch of time between two moves of the endoscope in which the tissue moved."""
    spot: tuple[SpotSlid, ...]
    known: float
    """Share of the pairs from which the motion of the scene is known: the others count as not looked at. Moments of a
    spot alone are no such pairs."""


def told_apart(moments: Sequence[Moment], *, gate_mm: float = 0.2) -> ToldApart:
    """Tell apart what moved.

    Parameters
    ----------
    moments
        What the cameras saw, in the order of time, of one reference and one place of the spot.
    gate_mm
        How far from its rest the tissue may be in a pause.
    """
    seen = [moment for moment in moments if moment.scene is not None]
    moves = _endoscope(_Poses.of(seen)) if len(seen) >= MIN_PAIRS else ()
    begins_s = [-math.inf, *(move.until_s for move in moves)]
    ends_s = [*(move.from_s for move in moves), math.inf]
    tissue = []
    for begin_s, end_s in zip(begins_s, ends_s, strict=True):
        part = [each for each in moments if begin_s <= each.at_s <= end_s]
        found = tissue_motion(_displacements(part), gate_mm=gate_mm)
        if found is not None:
            tissue.append(found)
    return ToldApart(
        endoscope=tuple(moves),
        tissue=tuple(tissue),
        spot=tuple(_spot(moments)),
        known=len(seen) / max(1, sum(moment.scene is not None or moment.spot is None for moment in moments)),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Poses:
    """Rotations (deg) of a scene and displacements (mm) of its middle since the reference."""

    at_s: Float64[np.ndarray, " times"]
    values: Float64[np.ndarray, "times 6"]
    covariances: Float64[np.ndarray, "times 6 6"]
    middle_m: Float64[np.ndarray, " 3"]
    """That middle, at the reference."""

    @classmethod
    def of(cls, seen: Sequence[Moment]) -> _Poses:
        scenes = [moment.scene for moment in seen if moment.scene is not None]
        middle_m = scenes[0].transform.inverse().apply(scenes[0].middle_m)
        values = np.empty((len(scenes), 6))
        covariances = np.empty((len(scenes), 6, 6))
        for number, scene in enumerate(scenes):
            values[number, :3] = np.degrees(Rotation.from_matrix(scene.transform.rotation).as_rotvec())
            values[number, 3:] = 1e3 * scene.displacement_m(middle_m[None])[0]
            # The displacement of this middle, from that of the middle of the points that the pair showed.
            effect = np.diag([*[np.degrees(1.0)] * 3, *[1e3] * 3])
            x, y, z = scene.transform.apply(middle_m) - scene.middle_m
            effect[3:, :3] = 1e3 * np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
            covariances[number] = effect @ scene.covariance @ effect.T
        return cls(
            at_s=np.array([moment.at_s for moment in seen]), values=values, covariances=covariances, middle_m=middle_m
        )


def _endoscope(poses: _Poses) -> tuple[EndoscopeMoved, ...]:
    """Return the moves of the endoscope: from what the scene was after the last one it has moved and not come back."""
    moves: list[EndoscopeMoved] = []
    at_s = poses.at_s
    begin = 0
    number = 1
    while number < len(at_s) and at_s[-1] - at_s[number] >= RETURN_S:
        if number - begin < MIN_PAIRS:
            number += 1
            continue
        if _shift(poses, begin, number) is None:
            number += 1
            continue
        # The window after the move that holds nothing of the way there has the largest shift.
        last = int(np.searchsorted(at_s, min(at_s[number] + RETURN_S, at_s[-1] - RETURN_S), side="right"))
        shifts = [_shift(poses, begin, each) for each in range(number, max(last, number + 1))]
        sizes = [0.0 if shift is None else float(np.linalg.norm(shift * _UNITS)) for shift in shifts]
        settled = number + next(k for k, size in enumerate(sizes) if size >= _SETTLED * max(sizes))
        # The quantiles leave a share of the window to what was before.
        settled = min(settled + math.ceil(_ENDS[0] * _length(_windows(poses, begin, settled)[1])), last)
        moves.append(_move(poses, begin, number, settled))
        begin = settled
        number = settled + 1
    return tuple(moves)


_UNITS = np.array([1 / MOVED_DEG] * 3 + [1 / MOVED_MM] * 3)
_UNEVEN_BREATH = 0.35
"""By which share of a breath the next one may be less deep."""

_SETTLED = 0.95
"""Share of the largest shift from which on a move is over."""


def _windows(poses: _Poses, begin: int, number: int) -> tuple[slice, slice]:
    """Return the first window since the last move, and that which begins with a pair."""
    at_s = poses.at_s
    first = min(number, int(np.searchsorted(at_s, at_s[begin] + RETURN_S, side="right")))
    end = int(np.searchsorted(at_s, at_s[number] + RETURN_S, side="right"))
    return slice(begin, first), slice(number, end)


def _length(window: slice) -> int:
    return int(window.stop - window.start)


def _shift(poses: _Poses, begin: int, number: int) -> Float64[np.ndarray, " 6"] | None:
    """Return by how much all of the second window lies beside the first; None if that is no move."""
    before, after = _windows(poses, begin, number)
    if min(_length(before), _length(after)) < MIN_PAIRS:
        return None
    now = np.quantile(poses.values[after], _ENDS, axis=0)
    shifts = now - np.quantile(poses.values[before], _ENDS, axis=0)
    same = np.abs(np.sign(shifts).sum(axis=0)) == len(_ENDS)
    least = np.abs(shifts).min(axis=0)
    if poses.at_s[number - 1] - poses.at_s[begin] < RETURN_S:
        # Less than a breath was seen before: the next ones may be less deep, and not come back as far as that.
        least = np.maximum(least - _UNEVEN_BREATH * (now[-1] - now[0]), 0.0)
    shift = np.where(same, np.sign(shifts[0]) * least, 0.0)
    if np.linalg.norm(shift[:3]) < MOVED_DEG and np.linalg.norm(shift[3:]) < MOVED_MM:
        return None
    covariance = np.median(poses.covariances[before], axis=0) + np.median(poses.covariances[after], axis=0)
    # Axes along which nothing is known to have moved say nothing against it.
    moved = np.flatnonzero(same)
    square = shift[moved] @ np.linalg.solve(covariance[np.ix_(moved, moved)], shift[moved])
    return shift if chdtrc(len(moved), float(square)) < _SURPRISE else None


def _move(poses: _Poses, begin: int, number: int, settled: int) -> EndoscopeMoved:
    before, _ = _windows(poses, begin, number)
    _, after = _windows(poses, begin, settled)
    shifts = np.quantile(poses.values[after], _ENDS, axis=0) - np.quantile(poses.values[before], _ENDS, axis=0)
    # The end at which most of the time is spent, that of the pause, is the one that comes back most exactly.
    low, middle, high = np.quantile(poses.values[after], _ENDS, axis=0)
    shift = np.where(middle - low < high - middle, shifts[0], shifts[-1])
    pose = np.median(poses.values[before], axis=0)
    then, now = (_transform(each, poses.middle_m) for each in (pose, pose + shift))
    back = then.inverse()
    rotation = now.rotation @ back.rotation
    middle_m = now.apply(poses.middle_m)
    covariance = np.median(poses.covariances[after], axis=0) + np.diag(shifts.var(axis=0, ddof=1))
    return EndoscopeMoved(
        from_s=float(poses.at_s[number - 1]),
        until_s=float(poses.at_s[settled]),
        displacement_mm=as_vector(1e3 * (middle_m - then.apply(poses.middle_m))),
        rotation_deg=as_vector(np.degrees(Rotation.from_matrix(rotation).as_rotvec())),
        middle_mm=as_vector(1e3 * middle_m),
        covariance=tuple(tuple(float(value) for value in row) for row in covariance),
    )


def _transform(pose: Float64[np.ndarray, " 6"], middle_m: Float64[np.ndarray, " 3"]) -> RigidTransform:
    displacement_m = 1e-3 * pose[3:]
    return motion_about(middle_m + displacement_m, rotation_deg=pose[:3], displacement_m=displacement_m)


def _displacements(moments: Sequence[Moment]) -> DisplacementSeries:
    sightings = [(each.at_s, each.tissue) for each in moments if each.tissue is not None]
    return DisplacementSeries(
        at_s=np.array([at_s for at_s, _ in sightings]),
        displacements_m=np.array([each.value_m for _, each in sightings]).reshape(-1, 3),
        covariances_m2=np.array([each.covariance_m2 for _, each in sightings]).reshape(-1, 3, 3),
    )


def _spot(moments: Sequence[Moment]) -> list[SpotSlid]:
    """Return how the spot slid: its place, less the displacement of the tissue at the same time, has changed."""
    series = _displacements(moments)
    places = [(each.at_s, each.spot) for each in moments if each.spot is not None]
    if len(series.at_s) < MIN_PAIRS or len(places) < 2 * MIN_SPOTS:
        return []
    at_s = np.array([time_s for time_s, _ in places])
    tissue_m = np.stack([np.interp(at_s, series.at_s, axis) for axis in series.displacements_m.T], axis=1)
    beside_mm = 1e3 * (np.array([spot.value_m for _, spot in places]) - tissue_m)
    single = np.median([spot.covariance_m2 for _, spot in places], axis=0) + np.median(series.covariances_m2, axis=0)
    slid: list[SpotSlid] = []
    begin = 0
    number = MIN_SPOTS
    while number + MIN_SPOTS <= len(at_s):
        before = beside_mm[begin:number]
        after = beside_mm[number : max(number + MIN_SPOTS, int(np.searchsorted(at_s, at_s[number] + RETURN_S)))]
        # A highlight that the tissue carries by is seen a few times in each breath: no mean.
        was_mm = np.median(before, axis=0)
        shift = np.median(after, axis=0) - was_mm
        covariance = 1e6 * single * (_MEDIAN / len(before) + _MEDIAN / len(after) + _COMMON) + _BESIDE_MM**2 * np.eye(3)
        away = np.linalg.norm(after - was_mm, axis=1) >= SLID_MM
        is_slid = away[:MIN_SPOTS].all() and np.mean(away) >= _STAYS and np.linalg.norm(shift) >= SLID_MM
        if is_slid and chdtrc(3, float(shift @ np.linalg.solve(covariance, shift))) < _SURPRISE:
            slid.append(
                SpotSlid(
                    from_s=float(at_s[number - 1]),
                    until_s=float(at_s[number]),
                    displacement_mm=as_vector(shift),
                    covariance_mm2=as_matrix(covariance),
                )
            )
            begin = number
            number = number + MIN_SPOTS
            continue
        number += 1
    return slid
