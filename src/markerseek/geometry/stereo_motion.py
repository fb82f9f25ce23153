"""Rigid motion of a scene between two moments, from the pixels of its points in two cameras, with its covariance.

A point is a direction of the left camera and an inverse depth 1/z, whose error is Gaussian also where the base of the
cameras is short (Civera, Davison and Montiel, IEEE Trans. Robot. 24, 2008). The motion is that of maximum likelihood
for the four pixel coordinates that both cameras see of each point now; the error of its depth is marginalised.

Random samples of three points find the motion that the majority shares (least median of squares: Rousseeuw, J. Am.
Stat. Assoc. 79, 1984). The covariance is that of a jackknife over parts of the image, because the errors of
neighbouring points are alike: light, surface and deformation change over millimetres. What a wrong calibration does to
a motion is added; it does nothing to a scene at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri, fdtri

from markerseek.core import Float64, Int64
from markerseek.geometry.cameras import StereoCameras
from markerseek.geometry.registration import effect_of_motion
from markerseek.geometry.transform import RigidTransform

BEFORE = "DaVinciBefore"
NOW = "DaVinci"
"""Names of the left camera's frame at the first moment and at the second."""

MIN_PARTS = 10
"""Fewest parts of the image with points of the majority: a jackknife of six unknowns needs more than six."""

_SAMPLES = 64
"""Random samples: with half of all points wrong, one of them is right with a probability of 99.98 %."""

_STEPS = 12
"""Most Gauss-Newton steps; three or four are usual."""

_SMALL = 1e-8
"""A step with which the fit ends, in rad and m."""

_OUTER = 0.001
"""Probability with which a point of the majority lies beyond its limit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationErrors:
    """Standard deviations of a stereo calibration's errors."""

    focal_share: float = 0.005
    """Of the focal lengths of both cameras, over these."""
    base_share: float = 0.005
    """Of the base, over its length."""
    vergence_px: float = 0.2
    """Of the angle between the cameras, as a displacement of the right image across."""

    def displaced(self, cameras: StereoCameras) -> tuple[StereoCameras, ...]:
        """Return the cameras with each error in turn, one standard deviation large."""
        share = 1 + self.focal_share
        left, right = (
            msgspec.structs.replace(camera, focal_px=(camera.focal_px[0] * share, camera.focal_px[1] * share))
            for camera in (cameras.left, cameras.right)
        )
        between = cameras.left_to_right
        longer = replace(between, translation_m=between.translation_m * (1 + self.base_share))
        turn = Rotation.from_euler("y", self.vergence_px / cameras.right.focal_px[0]).as_matrix()
        turned = replace(between, rotation=turn @ between.rotation, translation_m=turn @ between.translation_m)
        return (
            replace(cameras, left=left, right=right),
            replace(cameras, left_to_right=longer),
            replace(cameras, left_to_right=turned),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RangedPoints:
    """Points by their directions and inverse depths in the left camera's frame."""

    directions: Float64[np.ndarray, "points 3"]
    """Directions (x/z, y/z, 1)."""
    nearness_per_m: Float64[np.ndarray, " points"]
    """Inverse depths 1/z."""
    sigma_per_m: Float64[np.ndarray, " points"]
    """Their standard deviations."""
    beside_px: Float64[np.ndarray, "points 2"]
    """By how far the right camera saw them beside their lines of sight: errors of the calibration, which stay."""

    @property
    def positions_m(self) -> Float64[np.ndarray, "points 3"]:
        """The points in the left camera's frame."""
        return np.asarray(self.directions / self.nearness_per_m[:, None])

    def __getitem__(self, which: np.ndarray) -> RangedPoints:
        """Return some of the points."""
        return RangedPoints(
            directions=self.directions[which],
            nearness_per_m=self.nearness_per_m[which],
            sigma_per_m=self.sigma_per_m[which],
            beside_px=self.beside_px[which],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StereoPixels:
    """Pixels of points in both images, row by row."""

    left_px: Float64[np.ndarray, "points 2"]
    right_px: Float64[np.ndarray, "points 2"]
    left_px2: Float64[np.ndarray, "points 2 2"]
    """Covariances in the left image."""
    right_px2: Float64[np.ndarray, "points 2 2"]
    """Covariances in the right image."""

    def __getitem__(self, which: np.ndarray) -> StereoPixels:
        """Return some of the points."""
        return StereoPixels(
            left_px=self.left_px[which],
            right_px=self.right_px[which],
            left_px2=self.left_px2[which],
            right_px2=self.right_px2[which],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StereoMotion:
    """A rigid motion of points, and its errors."""

    transform: RigidTransform
    """Maps where a point was in the camera's frame to where it is now."""
    middle_m: Float64[np.ndarray, " 3"]
    """Middle of the points that share the motion, where it is now."""
    covariance: Float64[np.ndarray, "6 6"]
    """Covariance of the small rotation about that middle (rad) and of its displacement (m): chi squared of six degrees
    of freedom has the usual quantile at 95 %."""
    shared: np.ndarray
    """Which points share the motion; bool, one a point."""
    misfit: float
    """Median squared residual over that of the covariances of the pixels; 1 where these are right."""
    unevenness: float
    """Mean square by which regions of the image lie beside the motion, over that of single points: some 1 to 3 for a
    rigid scene, more for one that deforms."""

    def displacement_m(self, points_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3"]:
        """Return the displacement of points given where they were."""
        return np.asarray(self.transform.apply(points_m) - points_m)

    def covariances_m2(self, points_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3 3"]:
        """Return the covariances of where points are now, given where they were."""
        effect = effect_of_motion(self.transform.apply(points_m) - self.middle_m)
        return np.asarray(effect @ self.covariance @ np.swapaxes(effect, 1, 2))


def range_points(
    left_px: Float64[np.ndarray, "points 2"],
    right_px: Float64[np.ndarray, "points 2"],
    right_px2: Float64[np.ndarray, "points 2 2"],
    cameras: StereoCameras,
) -> RangedPoints:
    """Return the points seen at pixels of both images.

    The left pixels are exact: they say which point is meant. A point that is infinitely far, or behind the cameras, has
    an inverse depth of 0 or less.
    """
    directions = np.concatenate([cameras.left.undistort(left_px), np.ones((len(left_px), 1))], axis=1)
    turned = directions @ cameras.left_to_right.rotation.T
    base_m = cameras.left_to_right.translation_m
    weight = np.linalg.inv(right_px2)
    nearness = np.full(len(left_px), _START_PER_M)
    for _ in range(_STEPS):
        # A pixel depends on the direction alone, so that the point may be scaled: d + ρ b instead of d/ρ + b.
        pixels, slope = cameras.right.seen(turned + nearness[:, None] * base_m)
        along = slope @ base_m
        normal = np.einsum("ni,nij,nj->n", along, weight, along)
        step = np.einsum("ni,nij,nj->n", along, weight, right_px - pixels) / normal
        nearness = nearness + step
        if not (np.abs(step) > 1e-9).any():
            break
    return RangedPoints(
        directions=directions,
        nearness_per_m=nearness,
        sigma_per_m=1 / np.sqrt(normal),
        beside_px=right_px - cameras.right.seen(turned + nearness[:, None] * base_m)[0],
    )


_START_PER_M = 10.0
"""Inverse depth with which the iteration begins: 100 mm."""


def seen_after(
    points: RangedPoints, transform: RigidTransform, cameras: StereoCameras
) -> tuple[Float64[np.ndarray, "points 2"], Float64[np.ndarray, "points 2"]]:
    """Return the pixels of points in the left and the right image after a motion.

    Those of points behind a camera are not finite.
    """
    left, _, right, _ = _projected(points, transform, cameras)
    return left, right


def rigid_motion(
    points: RangedPoints,
    now: StereoPixels,
    cameras: StereoCameras,
    *,
    start: RigidTransform,
    parts: Int64[np.ndarray, " points"],
    regions: Int64[np.ndarray, " points"],
    calibration: CalibrationErrors | None = None,
    rng: np.random.Generator,
) -> StereoMotion | None:
    """Return the motion that the majority of points shares; None if no majority determines one.

    Parameters
    ----------
    points
        Where the points were.
    now
        Where both cameras see them now.
    cameras
        Their calibration.
    start
        A motion near the one that is looked for, `BEFORE` to `NOW`: pixels change linearly from there on.
    parts
        Number of the part of the image in which each point was: errors of different parts are independent.
    regions
        Number of the region in which each point was: larger parts, of a dozen points or more, that would move each in
        its own way if the scene deformed.
    calibration
        How well the cameras are calibrated; None: exactly.
    rng
        Draws the samples.
    """
    if len(points.directions) < 2 * _SAMPLE:
        return None
    middle_m = start.apply(points.positions_m).mean(axis=0)
    pull = _Linear.at(points, now, start, cameras, middle_m)
    first = _least_median(pull, rng)
    if first is None:
        return None
    step, variance = first
    transform = _moved(start, step, middle_m)
    shared = np.zeros(len(parts), dtype=bool)
    for _ in range(_STEPS):
        pull = _Linear.at(points, now, transform, cameras, middle_m)
        squares = pull.squares(np.zeros((1, 6)))[0]
        variance = max(1.0, float(np.median(squares)) / _MEDIAN)
        shared = squares <= variance * _LIMIT
        normal = pull.normals[shared].sum(axis=0)
        if shared.sum() < 2 * _SAMPLE or not np.linalg.cond(normal * _UNITS) < _MAX_CONDITION:
            return None
        step = np.linalg.solve(normal, pull.pulls[shared].sum(axis=0))
        transform = _moved(transform, step, middle_m)
        if np.abs(step).max() < _SMALL:
            break
    pull = _Linear.at(points, now, transform, cameras, middle_m)
    covariance = _jackknife(pull, shared, parts)
    if covariance is None:
        return None
    covariance = covariance + _effect(pull[shared], _smooth_errors(now[shared], cameras))
    if calibration is not None:
        displaced_px = _calibration_errors(points[shared], transform, cameras, calibration)
        covariance = covariance + _effect(pull[shared], displaced_px)
    # The rotation stays, the displacement is that of the middle of the points that share the motion.
    positions_m = transform.apply(points.positions_m[shared])
    effect = np.eye(6)
    effect[3:] = effect_of_motion((positions_m.mean(axis=0) - middle_m)[None])[0]
    return StereoMotion(
        transform=transform,
        middle_m=positions_m.mean(axis=0),
        covariance=effect @ covariance @ effect.T,
        shared=shared,
        misfit=variance,
        unevenness=_unevenness(pull[shared], regions[shared]),
    )


def shift_between(
    points: RangedPoints,
    now: StereoPixels,
    cameras: StereoCameras,
    *,
    motion: RigidTransform,
) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]] | None:
    """Return by how far a few neighbouring points lie beside a motion (m), with its covariance; None if most disagree.

    The points are taken to be displaced alike, so that three unknowns are left. The covariance is that of a jackknife
    over the points.
    """
    if len(points.directions) < _FEWEST_BESIDE:
        return None
    pull = _Linear.at(points, now, motion, cameras, motion.apply(points.positions_m).mean(axis=0))
    normals = pull.normals[:, 3:, 3:]
    pulls = pull.pulls[:, 3:]
    # Each point's own shift is a start; the one with the least median is near the shift that most have in common.
    own = np.linalg.solve(normals, pulls[..., None])[..., 0]
    squares = pull.squares(np.concatenate([np.zeros_like(own), own], axis=1))
    best = int(np.argmin(np.median(squares, axis=1)))
    variance = max(1.0, float(np.median(squares[best])) / _MEDIAN)
    shared = squares[best] <= variance * _LIMIT
    if shared.sum() < max(_FEWEST_BESIDE, 0.6 * len(own)):
        return None
    normal = normals[shared].sum(axis=0)
    shift_m = np.linalg.solve(normal, pulls[shared].sum(axis=0))
    left = pulls[shared] - normals[shared] @ shift_m
    count = int(shared.sum())
    apart = np.linalg.solve(normal - normals[shared], left[..., None])[..., 0]
    covariance = _student(3, count) * (count - 1) / count * apart.T @ apart
    # A few points that agree by chance would be known too well: not better than their pixels let expect.
    covariance = covariance + np.linalg.inv(normal)
    if np.linalg.eigvalsh(covariance)[-1] > _VAGUE_M**2:
        return None
    return shift_m, covariance


_SAMPLE = 3
"""Points of a sample: three determine a motion."""

_FEWEST_BESIDE = 5
"""Fewest neighbouring points whose shift is judged."""

_VAGUE_M = 0.5e-3
"""Standard deviation, in the worst direction, from which on a shift of neighbours is not known."""

_MEDIAN = float(chdtri(4, 0.5))
"""Median of chi squared with four degrees of freedom, those of a point's pixels."""

_LIMIT = float(chdtri(4, _OUTER))
"""What a point of the majority stays below."""

_UNITS = np.outer([1, 1, 1, 0.03, 0.03, 0.03], [1, 1, 1, 0.03, 0.03, 0.03])
"""Makes a rotation, and a displacement over a scene of 30 mm, numbers of one size."""

_MAX_CONDITION = 1e7
"""Largest condition of the normal equations; points on a line have far more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Linear:
    """Residuals of the four pixel coordinates of each point, as linear functions of a small motion."""

    residual: Float64[np.ndarray, "points 4"]
    effect: Float64[np.ndarray, "points 4 6"]
    weight: Float64[np.ndarray, "points 4 4"]

    @classmethod
    def at(
        cls,
        points: RangedPoints,
        now: StereoPixels,
        transform: RigidTransform,
        cameras: StereoCameras,
        middle_m: Float64[np.ndarray, " 3"],
    ) -> _Linear:
        left, by_left, right, by_right = _projected(points, transform, cameras)
        residual = np.concatenate([now.left_px - left, now.right_px - right], axis=1)
        by_point = np.concatenate([by_left, by_right @ cameras.left_to_right.rotation], axis=1)
        # d + ρ t: by the inverse depth it changes by t, by the motion by ρ (ω × (p − middle) + τ).
        by_nearness = np.concatenate([by_left @ transform.translation_m, by_right @ _right_of(cameras, transform)], 1)
        positions_m = transform.apply(points.positions_m)
        effect = points.nearness_per_m[:, None, None] * (by_point @ effect_of_motion(positions_m - middle_m))
        noise = np.zeros((len(residual), 4, 4))
        noise[:, :2, :2] = now.left_px2
        noise[:, 2:, 2:] = now.right_px2
        noise += points.sigma_per_m[:, None, None] ** 2 * by_nearness[:, :, None] * by_nearness[:, None, :]
        return cls(residual=residual, effect=effect, weight=np.linalg.inv(noise))

    def __getitem__(self, which: np.ndarray) -> _Linear:
        return _Linear(residual=self.residual[which], effect=self.effect[which], weight=self.weight[which])

    @property
    def normals(self) -> Float64[np.ndarray, "points 6 6"]:
        """Contribution of each point to the normal equations."""
        return np.asarray(np.swapaxes(self.effect, 1, 2) @ self.weight @ self.effect)

    @property
    def pulls(self) -> Float64[np.ndarray, "points 6"]:
        """Contribution of each point to their right-hand side."""
        return np.asarray(np.einsum("nij,nik,nk->nj", self.effect, self.weight, self.residual))

    def squares(self, steps: Float64[np.ndarray, "steps 6"]) -> Float64[np.ndarray, "steps points"]:
        """Return the squared residuals of all points after small motions, over their variances."""
        left = self.residual - np.einsum("nij,sj->sni", self.effect, steps)
        return np.asarray(np.einsum("sni,nij,snj->sn", left, self.weight, left, optimize=True))


def _right_of(cameras: StereoCameras, transform: RigidTransform) -> Float64[np.ndarray, " 3"]:
    """Return what the inverse depth of a point adds to its direction in the right camera's frame."""
    return cameras.left_to_right.apply(transform.translation_m)


def _projected(
    points: RangedPoints, transform: RigidTransform, cameras: StereoCameras
) -> tuple[
    Float64[np.ndarray, "points 2"],
    Float64[np.ndarray, "points 2 3"],
    Float64[np.ndarray, "points 2"],
    Float64[np.ndarray, "points 2 3"],
]:
    """Return the left pixels, their derivatives by the scaled point, right pixels, theirs."""
    near = points.nearness_per_m[:, None]
    turned = points.directions @ transform.rotation.T
    left, by_left = cameras.left.seen(turned + near * transform.translation_m)
    right, by_right = cameras.right.seen(
        turned @ cameras.left_to_right.rotation.T + near * _right_of(cameras, transform)
    )
    return left, by_left, right + points.beside_px, by_right


def _moved(
    transform: RigidTransform, step: Float64[np.ndarray, " 6"], middle_m: Float64[np.ndarray, " 3"]
) -> RigidTransform:
    """Return the transform followed by a rotation about the middle (rad) and a displacement (m)."""
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    return RigidTransform(
        source=transform.source,
        target=transform.target,
        rotation=turn @ transform.rotation,
        translation_m=turn @ (transform.translation_m - middle_m) + middle_m + step[3:],
    )


def _least_median(pull: _Linear, rng: np.random.Generator) -> tuple[Float64[np.ndarray, " 6"], float] | None:
    """Return the small motion by some points with the least median of all squares, and that over what is expected."""
    count = len(pull.residual)
    chosen = np.argsort(rng.random((_SAMPLES, count)), axis=1)[:, :_SAMPLE]
    normals = pull.normals[chosen].sum(axis=1)
    usable = np.linalg.cond(normals * _UNITS) < _MAX_CONDITION
    if not usable.any():
        return None
    steps = np.linalg.solve(normals[usable], pull.pulls[chosen[usable]].sum(axis=1)[..., None])[..., 0]
    medians = np.median(pull.squares(steps), axis=1)
    best = int(np.argmin(medians))
    return steps[best], float(medians[best]) / _MEDIAN


def _unevenness(pull: _Linear, regions: Int64[np.ndarray, " points"]) -> float:
    """Return by how much more regions are displaced than the scatter of their points explains."""
    normals = pull.normals[:, 3:, 3:]
    pulls = pull.pulls[:, 3:]
    between = 0.0
    unknowns = 0
    for region in np.unique(regions):
        inside = regions == region
        if inside.sum() < _SAMPLE:
            continue
        pulled = pulls[inside].sum(axis=0)
        between += float(pulled @ np.linalg.solve(normals[inside].sum(axis=0), pulled))
        unknowns += 3
    single = float(np.mean(pull.squares(np.zeros((1, 6))))) / 4
    return between / max(unknowns, 1) / max(single, 1e-12)


def _jackknife(
    pull: _Linear, shared: np.ndarray, parts: Int64[np.ndarray, " points"]
) -> Float64[np.ndarray, "6 6"] | None:
    """Return the covariance from how the motion changes as the points of each part are left out."""
    numbers, part = np.unique(parts[shared], return_inverse=True)
    count = len(numbers)
    if count < MIN_PARTS:
        return None
    normals = np.zeros((count, 6, 6))
    pulls = np.zeros((count, 6))
    np.add.at(normals, part, pull.normals[shared])
    np.add.at(pulls, part, pull.pulls[shared])
    rest = normals.sum(axis=0) - normals
    if not (np.linalg.cond(rest * _UNITS) < _MAX_CONDITION).all():
        return None
    apart = np.linalg.solve(rest, pulls[..., None])[..., 0]
    return np.asarray(_student(6, count) * (count - 1) / count * apart.T @ apart)


def _effect(pull: _Linear, errors_px: Float64[np.ndarray, "points 4 errors"]) -> Float64[np.ndarray, "6 6"]:
    """Return the covariance of the motion from errors that all points share, given for one standard deviation each."""
    weighted = np.swapaxes(pull.effect, 1, 2) @ pull.weight
    gain = np.linalg.solve(pull.normals.sum(axis=0), (weighted @ errors_px).sum(axis=0))
    return np.asarray(gain @ gain.T)


def _smooth_errors(now: StereoPixels, cameras: StereoCameras) -> Float64[np.ndarray, "points 4 errors"]:
    """Return errors that are alike, or change linearly, over an image: no jackknife sees them."""
    count = len(now.left_px)
    errors_px = np.zeros((count, 4, 12))
    for side, (places, camera) in enumerate(((now.left_px, cameras.left), (now.right_px, cameras.right))):
        across = 2 * places / np.array(camera.size_px) - 1
        linear = np.concatenate([np.ones((count, 1)), across], axis=1)
        for axis in (0, 1):
            row = 2 * side + axis
            errors_px[:, row, 3 * row : 3 * row + 3] = _SMOOTH_PX * linear
    return errors_px


def _calibration_errors(
    points: RangedPoints, transform: RigidTransform, cameras: StereoCameras, calibration: CalibrationErrors
) -> Float64[np.ndarray, "points 4 errors"]:
    """Return by how far other cameras, which saw the points where these did before, would see them elsewhere now."""
    before = seen_after(points, at_rest(), cameras)
    now = np.concatenate(seen_after(points, transform, cameras), axis=1)
    upright = np.tile(np.eye(2), (len(now), 1, 1))
    errors_px = [
        np.concatenate(seen_after(range_points(*before, upright, other), transform, other), axis=1) - now
        for other in calibration.displaced(cameras)
    ]
    return np.stack(errors_px, axis=2)


_SMOOTH_PX = 0.02
"""Standard deviation of what interpolation and compression leave over a whole image."""


def _student(unknowns: int, parts: int) -> float:
    """Return Hotelling's T² over chi squared at 95 %: by that a covariance from a few parts is too small."""
    squares = unknowns * (parts - 1) / (parts - unknowns) * fdtri(unknowns, parts - unknowns, 0.95)
    return float(squares / chdtri(unknowns, 0.05))


def motion_about(
    middle_m: Float64[np.ndarray, " 3"],
    *,
    rotation_deg: Float64[np.ndarray, " 3"],
    displacement_m: Float64[np.ndarray, " 3"],
) -> RigidTransform:
    """Return the motion of a scene whose middle is displaced to ``middle_m``, and that turns about it.

    ``rotation_deg``: axis of the rotation, times its angle.
    """
    rotation = Rotation.from_rotvec(rotation_deg, degrees=True).as_matrix()
    before_m = middle_m - displacement_m
    return RigidTransform(source=BEFORE, target=NOW, rotation=rotation, translation_m=middle_m - rotation @ before_m)


def at_rest() -> RigidTransform:
    """Return the motion of a scene that has not moved."""
    return RigidTransform(source=BEFORE, target=NOW, rotation=np.eye(3), translation_m=np.zeros(3))
