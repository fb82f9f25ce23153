"""Registration of two frames from points measured in both, with its errors.

Horn's closed form gives the transform. Where covariances are known it is then refined to maximum likelihood, because
the error of a camera in depth is many times that across. Points that cannot determine a transform are refused here;
whether the result is good enough is the caller's decision.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, Float64
from markerseek.geometry.errors import RegistrationErrors, effect_of_motion, registration_errors
from markerseek.geometry.horn import best_rotation
from markerseek.geometry.transform import RigidTransform

LEAST_POINTS = 3
"""Fewest points that determine a rigid transform."""

MOST_POINTS = 1000
"""Most points; nobody marks more by hand."""

MOST_SPREAD_M = 1.0
"""Largest distance of a point from the middle of all, in metres; millimetres that were taken for metres exceed it."""

LEAST_WIDTH = 0.1
"""Least width of the points over their length (root mean squares), below which they count as on a line."""

_STEPS = 200
"""Most steps of the refinement; some six are usual."""

_SMALL = 1e-8
"""A step with which the refinement ends, in rad and m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Registration:
    """A rigid transform found from points, and its errors.

    Attributes
    ----------
    transform
        Maps the source frame to the target frame.
    residuals_m
        Transformed source points minus target points, in metres, shape (points, 3).
    errors
        Errors that are to be expected: from the given covariances or, without any, from the residuals.
    misfit
        Sum of the squared residuals over what the covariances let expect (chi squared by its degrees of freedom); 1
        where no covariances were given. Above 1, `tre_m` is larger by its root.
    """

    transform: RigidTransform
    residuals_m: Float64[np.ndarray, "points 3"]
    errors: RegistrationErrors
    misfit: float

    @property
    def distances_m(self) -> Float64[np.ndarray, " points"]:
        """Length of each residual, in metres."""
        return np.asarray(np.linalg.norm(self.residuals_m, axis=1))

    @property
    def fre_m(self) -> float:
        """Fiducial registration error: root mean square of the residuals, in metres."""
        return float(np.sqrt(np.mean(self.distances_m**2)))

    def tre_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Expected target registration error, root mean square in metres, at a point of the target frame.

        Residuals larger than the covariances explain mean that these are too small; then the error is scaled up as the
        Particle Data Group scales that of a mean.
        """
        return self.errors.tre_m(target_m) * math.sqrt(max(1.0, self.misfit))


def register_points(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    *,
    source_covariances_m2: Float64[np.ndarray, "points 3 3"] | None = None,
    target_covariances_m2: Float64[np.ndarray, "points 3 3"] | None = None,
    source: str = "DaVinci",
    target: str = "Trus",
    refined: bool = True,
) -> Registration:
    """Rigid transform from source to target points that belong together row by row.

    Parameters
    ----------
    source_m, target_m
        The points, in metres.
    source_covariances_m2, target_covariances_m2
        Covariance of each point in its own frame, in m²; None: not known. Where either is given it weighs the points.
    source, target
        Names of the frames.
    refined
        Whether to go on from Horn's closed form, which weighs a point equally in all directions, to the transform of
        maximum likelihood.

    Raises
    ------
    ConfigError
        If there are fewer than three points, a number is not finite or not in metres, the points lie on a line, or a
        covariance is not positive.
    """
    for frame, points in ((source, source_m), (target, target_m)):
        _require_points(points, frame)
    if len(source_m) != len(target_m):
        raise ConfigError(f"{len(source_m)} points in {source} and {len(target_m)} in {target}; each needs its partner")
    known = source_covariances_m2 is not None or target_covariances_m2 is not None
    none = np.zeros((len(source_m), 3, 3))
    from_source = none if source_covariances_m2 is None else source_covariances_m2
    from_target = none if target_covariances_m2 is None else target_covariances_m2

    def noise_at(rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "points 3 3"]:
        return np.asarray(rotation @ from_source @ rotation.T + from_target)

    if known:
        _require_positive(noise_at(np.eye(3)))
    # Horn's closed form takes one weight a point: the inverse of its mean variance.
    total = np.trace(from_source + from_target, axis1=1, axis2=2)
    weights = 3 / total if known else np.ones(len(source_m))
    rotation, translation_m = best_rotation(source_m, target_m, weights)
    if known and refined:
        rotation, translation_m = _refine(source_m, target_m, rotation, translation_m, from_target, noise_at)
    transform = RigidTransform(source=source, target=target, rotation=rotation, translation_m=translation_m)
    residuals_m = transform.apply(source_m) - target_m
    freedom = 3 * len(source_m) - 6
    if known:
        noise = noise_at(rotation)
        inverse = np.linalg.inv(noise)
        misfit = float(np.einsum("ni,nij,nj->", residuals_m, inverse, residuals_m)) / freedom
        weighing = inverse if refined else weights[:, None, None] * np.eye(3)
    else:
        # Equal, isotropic errors of the size that the residuals show.
        noise = np.tile(np.eye(3) * float(np.sum(residuals_m**2)) / freedom, (len(source_m), 1, 1))
        misfit, weighing = 1.0, np.tile(np.eye(3), (len(source_m), 1, 1))
    errors = registration_errors(target_m, noise, weighing)
    return Registration(transform=transform, residuals_m=residuals_m, errors=errors, misfit=misfit)


def _refine(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    rotation: Float64[np.ndarray, "3 3"],
    translation_m: Float64[np.ndarray, " 3"],
    target_noise: Float64[np.ndarray, "points 3 3"],
    noise_at: Callable[[Float64[np.ndarray, "3 3"]], Float64[np.ndarray, "points 3 3"]],
) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
    """Maximum likelihood by Gauss-Newton steps; the noise of the source points turns with them.

    The derivative is taken at the most likely true points, between the two measurements of each: that of the whole
    likelihood, in which also the noise depends on the rotation. At the measured points it would not converge where a
    camera's depth is poor.
    """

    def misfit_of(turned: Float64[np.ndarray, "3 3"], shift_m: Float64[np.ndarray, " 3"]) -> float:
        residual = source_m @ turned.T + shift_m - target_m
        return float(np.einsum("ni,nij,nj->", residual, np.linalg.inv(noise_at(turned)), residual))

    misfit = misfit_of(rotation, translation_m)
    for _ in range(_STEPS):
        inverse = np.linalg.inv(noise_at(rotation))
        pull = np.einsum("nij,nj->ni", inverse, source_m @ rotation.T + translation_m - target_m)
        likely = target_m + np.einsum("nij,nj->ni", target_noise, pull)
        middle = likely.mean(axis=0)
        effect = effect_of_motion(likely - middle)
        normal = np.einsum("nij,nik,nkl->jl", effect, inverse, effect)
        step = -np.linalg.solve(normal, np.einsum("nij,ni->j", effect, pull))
        # Shorter steps where a whole one overshoots; the last bits of the misfit are rounding.
        while True:
            turn = Rotation.from_rotvec(step[:3]).as_matrix()
            turned, shift_m = turn @ rotation, turn @ (translation_m - middle) + middle + step[3:]
            reached = misfit_of(turned, shift_m)
            if reached <= misfit * (1 + 1e-9) or np.abs(step).max() < _SMALL:
                break
            step = step / 2
        rotation, translation_m, misfit = turned, shift_m, reached
        if np.abs(step).max() < _SMALL:
            break
    # Three points far from a camera can leave a flat valley: every step was downhill, and the end is as good as any.
    return rotation, translation_m


def _require_points(points_m: Float64[np.ndarray, "points 3"], frame: str) -> None:
    """Refuse points that determine no transform."""
    if not LEAST_POINTS <= len(points_m) <= MOST_POINTS:
        raise ConfigError(
            f"{len(points_m)} points in {frame}, it must be {LEAST_POINTS} to {MOST_POINTS} that are not on a line"
        )
    if not np.isfinite(points_m).all():
        number = int(np.flatnonzero(~np.isfinite(points_m).all(axis=1))[0]) + 1
        raise ConfigError(f"point {number} in {frame} has a coordinate that is not finite; leave the point out")
    apart = points_m - points_m.mean(axis=0)
    spread_m = float(np.linalg.norm(apart, axis=1).max())
    if not spread_m <= MOST_SPREAD_M:
        raise ConfigError(
            f"the points in {frame} reach {spread_m:.3g} m from their middle, at most {MOST_SPREAD_M:g} m is possible; "
            "give metres, not millimetres"
        )
    length, width = np.linalg.svd(apart, compute_uv=False)[:2]
    if not width > LEAST_WIDTH * length:
        raise ConfigError(
            f"the points in {frame} lie on a line: their width is {width / max(length, 1e-300):.2g} of their length, "
            f"more than {LEAST_WIDTH:g} is needed; add a point beside the line"
        )


def _require_positive(covariances_m2: Float64[np.ndarray, "points 3 3"]) -> None:
    """Refuse covariances that cannot weigh a point."""
    if not np.isfinite(covariances_m2).all():
        raise ConfigError("a sigma is not finite; leave it out, or give a number of metres")
    # Symmetric matrices: the smallest eigenvalue must be positive, above rounding.
    least = np.linalg.eigvalsh(covariances_m2)
    bad = np.flatnonzero(~(least[:, 0] > 1e-12 * least[:, -1]))
    if len(bad):
        raise ConfigError(
            f"point {bad[0] + 1} has a sigma of 0 in some direction in both frames, so that it would outweigh all "
            "others; give a sigma above 0"
        )
