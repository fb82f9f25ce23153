"""Registration of two frames from points measured in both, with its errors.

Horn's closed form gives the transform: B. K. P. Horn, "Closed-form solution of absolute orientation using unit
quaternions", J. Opt. Soc. Am. A 4 (1987). Where covariances are known it is then refined to maximum likelihood, because
the error of a camera in depth is many times that across. Points that cannot determine a transform are refused here;
whether the result is good enough is the caller's decision.

Two measurements of a point may differ by more than their covariances say: a camera sees a spot of light, a probe hears
where the light is absorbed. The size of that offset is a variance that all points have, with a prior; so may a shared
error be larger than it is assumed. Both are summed over: each size and each such error is a linear model of its own,
weighted by its evidence (`_posterior`).

The expected errors, FRE and TRE at any target, are of first order. For points with equal, isotropic errors they are the
result of Fitzpatrick, West and Maurer (IEEE Trans. Med. Imaging 17, 1998). Covariances that differ in direction and
from point to point, and weights, follow from the same linear equations (Danilchenko and Fitzpatrick, IEEE Trans. Med.
Imaging 30, 2011).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtrc, logsumexp, softmax

from markerseek.core import ConfigError, Float64
from markerseek.geometry.error_length import ErrorLength
from markerseek.geometry.transform import RigidTransform

MIN_POINTS = 3
"""Fewest points that determine a rigid transform."""

MAX_POINTS = 1000
"""Most points; nobody marks more by hand."""

MAX_SPREAD_M = 1.0
"""Largest distance of a point from the middle of all, in metres; millimetres that were taken for metres exceed it."""

MIN_WIDTH = 0.1
"""Least width of the points over their length (root mean squares), below which they count as on a line."""

OFFSET_FACTORS = (3.0, 1.7)
"""Factors by which the offset between two measurements of a point may be smaller and larger than stated: its logarithm
has a Gaussian prior on either side, of which two thirds lie within. A point in a phantom has no offset."""

DOUBT = 0.05
"""Probability that one of the shared errors is larger than assumed."""

WIDER = 4.0
"""Standard deviation of a shared error that is larger than assumed, over the assumed one."""

_OFFSETS = np.linspace(-3.0, 3.5, 14)
"""Sizes of the offset that are summed over, in standard deviations of the logarithm."""

_STEPS = 200
"""Most steps of the refinement; some six are usual."""

_SMALL = 1e-8
"""A step with which the refinement ends, in rad and m."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationErrors:
    """Expected errors of a registration: a mixture of Gaussian distributions with one mean."""

    covariances: Float64[np.ndarray, "parts unknowns unknowns"]
    """Covariance, in each part of the mixture, of the small rotation about the middle of the points (rad), of the
    translation (m), and of the errors that all points share, in their standard deviations, where these were estimated;
    6 + errors unknowns."""
    weights: Float64[np.ndarray, " parts"]
    """Probability of each part; the sum is 1."""
    middle_m: Float64[np.ndarray, " 3"]
    """That middle, in the frame of the target points."""
    fre_m: float
    """Expected fiducial registration error (FRE), root mean square."""

    @property
    def covariance(self) -> Float64[np.ndarray, "unknowns unknowns"]:
        """Covariance of the whole mixture."""
        return np.asarray(np.einsum("k,kij->ij", self.weights, self.covariances))

    def tre_covariance_m2(self, target_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 3"]:
        """Return the covariance of the position of a target, given in the frame of the target points, in m²."""
        effect = effect_of_motion(target_m[None, :] - self.middle_m)[0]
        return np.asarray(effect @ self.covariance[:6, :6] @ effect.T)

    def shared_with_target_m(self, target_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 errors"]:
        """Covariance of the position of a target with the errors that all points share, in their units."""
        effect = effect_of_motion(target_m[None, :] - self.middle_m)[0]
        return np.asarray(effect @ self.covariance[:6, 6:])

    def tre_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Return the expected target registration error (TRE), root mean square in metres, at a target."""
        return float(np.sqrt(np.trace(self.tre_covariance_m2(target_m))))

    def tre95_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Return the length in metres that 95 % of the errors at a target do not exceed."""
        effect = effect_of_motion(target_m[None, :] - self.middle_m)[0]
        spreads = effect @ self.covariances[:, :6, :6] @ effect.T
        return ErrorLength.of(self.weights, spreads).quantile_m(0.95)


def registration_errors(
    points_m: Float64[np.ndarray, "points 3"],
    covariances_m2: Float64[np.ndarray, "points 3 3"],
    weights: Float64[np.ndarray, "points 3 3"],
    *,
    shared_m: Float64[np.ndarray, "points 3 errors"] | None = None,
    shared_estimated: bool = True,
) -> RegistrationErrors:
    """Return the expected errors of a registration to points.

    - ``points_m``: the points in the target frame.
    - ``covariances_m2``: covariance of each residual, which is that of both measurements of the point, in the target
      frame.
    - ``weights``: weight matrix of each residual in the least squares fit; the inverse covariances for a maximum
      likelihood fit.
    - ``shared_m``: change of each residual, by one standard deviation of each error that all points share; None: there
      are no such errors.
    - ``shared_estimated``: whether the fit estimated these errors together with the transform; else it took them for 0.
    """
    middle_m = points_m.mean(axis=0)
    shared = np.zeros((len(points_m), 3, 0)) if shared_m is None else shared_m
    # Residuals as a linear function of the unknowns x, which are rotation, translation and shared errors: A x + noise.
    motion = effect_of_motion(points_m - middle_m)
    effect = np.concatenate([motion, shared], axis=2) if shared_estimated else motion
    weighted = np.swapaxes(effect, 1, 2) @ weights
    normal = np.einsum("nij,njk->ik", weighted, effect)
    # The prior of a shared error has the variance 1; where it is estimated, it is an unknown of its own.
    own = np.eye(normal.shape[0])[:, 6:] if shared_estimated else np.zeros((6, shared.shape[2]))
    normal += own @ own.T
    # Least squares: x = Σ G (noise + B s), G = (Σ Aᵀ W A + prior)⁻¹ Aᵀ W; its error is Σ G noise + (Σ G B − own) s.
    gain = np.linalg.inv(normal) @ weighted
    offset = np.einsum("nij,njk->ik", gain, shared) - own
    covariance = np.einsum("nij,njk,nlk->il", gain, covariances_m2, gain) + offset @ offset.T
    # The residuals of the transform alone, e = noise + B s − J x, have, with the rows of G and x for the transform,
    # E|e|² = tr C − 2 tr(J G C) + tr(J Σ G C Gᵀ Jᵀ) + |B − J Σ G B|².
    gain = gain[:, :6]
    moved = np.einsum("nij,njk,nlk->il", gain, covariances_m2, gain)
    left = shared - motion @ np.einsum("nij,njk->ik", gain, shared)
    mean_square = (
        np.einsum("nii->", covariances_m2)
        - 2 * np.einsum("nij,njk,nki->", motion, gain, covariances_m2)
        + np.einsum("nij,jk,nik->", motion, moved, motion)
        + np.sum(left**2)
    ) / len(points_m)
    return RegistrationErrors(
        covariances=covariance[None],
        weights=np.ones(1),
        middle_m=middle_m,
        fre_m=float(np.sqrt(max(mean_square, 0.0))),
    )


def effect_of_motion(offsets_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3 6"]:
    """Return the matrices of the displacement ω × d + τ of points d by a small rotation ω and a translation τ."""
    effect = np.zeros((len(offsets_m), 3, 6))
    x, y, z = offsets_m.T
    # ω × d, column by column of ω.
    effect[:, 1, 0], effect[:, 2, 0] = -z, y
    effect[:, 0, 1], effect[:, 2, 1] = z, -x
    effect[:, 0, 2], effect[:, 1, 2] = -y, x
    effect[:, :, 3:] = np.eye(3)
    return effect


def best_rotation(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    weights: Float64[np.ndarray, " points"],
) -> tuple[Float64[np.ndarray, "3 3"], Float64[np.ndarray, " 3"]]:
    """Return the rotation R and translation t, in metres, that minimise Σ w ‖R p + t − q‖².

    ``source_m``, ``target_m``: the points p and q, at least three that are not on a line (`register_points` checks
    that). ``weights``: weight of each point, positive.
    """
    share = weights / weights.sum()
    from_middle = share @ source_m
    to_middle = share @ target_m
    s = np.einsum("n,ni,nj->ij", share, source_m - from_middle, target_m - to_middle)
    # Horn's eq. for the 4 x 4 matrix N; its eigenvector with the largest eigenvalue is the quaternion (w, x, y, z).
    cross = np.array([s[1, 2] - s[2, 1], s[2, 0] - s[0, 2], s[0, 1] - s[1, 0]])
    n = np.empty((4, 4))
    n[0, 0] = np.trace(s)
    n[0, 1:] = n[1:, 0] = cross
    n[1:, 1:] = s + s.T - np.trace(s) * np.eye(3)
    # eigh sorts the eigenvalues in rising order; SciPy has the scalar last.
    w, x, y, z = np.linalg.eigh(n)[1][:, -1]
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
    return rotation, to_middle - rotation @ from_middle


def mirror_image_fre(source_m: Float64[np.ndarray, "points 3"], target_m: Float64[np.ndarray, "points 3"]) -> float:
    """Return the root mean square residual, in metres, of the best fit with a mirror image of the source points.

    Every improper rotation is a rotation of the points reflected through the origin. For points in a plane, as any
    three are, it is the same as that of the best fit without reflection.
    """
    even = np.ones(len(source_m))
    rotation, translation_m = best_rotation(-source_m, target_m, even)
    residual = -source_m @ rotation.T + translation_m - target_m
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=1))))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DoubtedError:
    """A shared error that may be larger than assumed, along one direction of their space."""

    probability: float
    """Probability that it is."""
    value: float
    sigma: float
    """``value`` and ``sigma``: its estimate then and the standard deviation of that, in the assumed standard
    deviation."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Registration:
    """A rigid transform found from points, and its errors."""

    transform: RigidTransform
    """Maps the source frame to the target frame."""
    residuals_m: Float64[np.ndarray, "points 3"]
    """Transformed source points minus target points."""
    errors: RegistrationErrors
    """Errors that are to be expected: from the given covariances or, without any, from the residuals."""
    shared: Float64[np.ndarray, " errors"]
    """Estimates of the errors that all points share, in their standard deviations: those of the source points, then
    those of the target points. 0 where they were not estimated."""
    misfit: float
    """Sum of the squared residuals over what the covariances and the stated offset let expect, and of the squared
    `shared` errors (chi squared by its degrees of freedom); 1 where no covariances were given."""
    probability: float
    """Probability of residuals as large or larger (chi squared), if the covariances are right and the offset has its
    prior."""
    offset_sigma_m: float | None = None
    """Estimate of the offset between two measurements of a point, as a standard deviation along each direction; None:
    there is none. Then, for a `misfit` above 1, `tre_m` is larger by its root."""
    log_evidence: float | None = None
    """Logarithm of the probability density of the points, for any transform; None where the offset is not
    estimated."""
    doubts: tuple[DoubtedError, ...] = ()
    """What the points say of each direction that may be in doubt."""

    @property
    def distances_m(self) -> Float64[np.ndarray, " points"]:
        """Length of each residual, in metres."""
        return np.asarray(np.linalg.norm(self.residuals_m, axis=1))

    @property
    def fre_m(self) -> float:
        """Fiducial registration error: root mean square of the residuals, in metres."""
        return float(np.sqrt(np.mean(self.distances_m**2)))

    @property
    def scale(self) -> float:
        """Factor of the expected errors.

        Residuals larger than the covariances explain mean that these are too small; then the errors are scaled up as
        the Particle Data Group scales that of a mean, unless the offset accounts for it.
        """
        return 1.0 if self.offset_sigma_m is not None else math.sqrt(max(1.0, self.misfit))

    def tre_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Return the expected target registration error, root mean square in metres, at a point of the target frame."""
        return self.errors.tre_m(target_m) * self.scale

    def tre_covariance_m2(self, target_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 3"]:
        """Return the covariance of a target's position in its frame, in m²; scaled as `tre_m`."""
        return self.errors.tre_covariance_m2(target_m) * self.scale**2

    def tre95_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Return the length in metres that 95 % of the errors at a target stay below; scaled as `tre_m`."""
        return self.errors.tre95_m(target_m) * self.scale


def register_points(
    source_m: Float64[np.ndarray, "points 3"],
    target_m: Float64[np.ndarray, "points 3"],
    *,
    source_covariances_m2: Float64[np.ndarray, "points 3 3"] | None = None,
    target_covariances_m2: Float64[np.ndarray, "points 3 3"] | None = None,
    source_shared_m: Float64[np.ndarray, "points 3 source_errors"] | None = None,
    target_shared_m: Float64[np.ndarray, "points 3 target_errors"] | None = None,
    offset_sigma_m: float | None = None,
    doubtful: Float64[np.ndarray, "directions errors"] | None = None,
    source: str = "DaVinci",
    target: str = "ProbeHome",
    refined: bool = True,
) -> Registration:
    """Return the rigid transform from source to target points that belong together row by row.

    - ``source_covariances_m2``, ``target_covariances_m2``: covariance of each point in its own frame; None: not known.
      Where either is given it weighs the points.
    - ``source_shared_m``, ``target_shared_m``: how far one standard deviation of each error that all points share
      displaces each point, in its own frame. Maximum likelihood estimates these errors too, each with a Gaussian prior;
      all count in the TRE.
    - ``offset_sigma_m``: usual offset between the two measurements of a point, beyond their covariances: standard
      deviation along each direction. It is estimated from the residuals (`OFFSET_FACTORS`) and counts in all errors;
      None: there is none.
    - ``doubtful``: directions, as unit vectors in the space of the shared errors, along which they may be larger than
      assumed (`DOUBT`, `WIDER`); with an offset only.
    - ``refined``: whether to go on from Horn's closed form, which weighs a point equally in all directions, to the
      transform of maximum likelihood.
    """
    for frame, those_m in ((source, source_m), (target, target_m)):
        _require_points(those_m, frame)
    if len(source_m) != len(target_m):
        raise ConfigError(f"{len(source_m)} points in {source} and {len(target_m)} in {target}; each needs its partner")
    known = source_covariances_m2 is not None or target_covariances_m2 is not None
    zeros = np.zeros((len(source_m), 3, 3))
    points = _Points(
        source_m=source_m,
        target_m=target_m,
        from_source=zeros if source_covariances_m2 is None else source_covariances_m2,
        from_target=zeros if target_covariances_m2 is None else target_covariances_m2,
        offset_m2=0.0 if offset_sigma_m is None else offset_sigma_m**2,
        source_shared_m=zeros[:, :, :0] if source_shared_m is None else source_shared_m,
        target_shared_m=zeros[:, :, :0] if target_shared_m is None else target_shared_m,
    )
    if known:
        _require_positive(points.noise(np.eye(3)))
    # Horn's closed form takes one weight a point: the inverse of its mean variance.
    total = np.trace(points.noise(np.eye(3)), axis1=1, axis2=2)
    weights = 3 / total if known else np.ones(len(source_m))
    rotation, translation_m = best_rotation(source_m, target_m, weights)
    refine = known and refined
    fit = _Fit(rotation=rotation, translation_m=translation_m, shared=np.zeros(points.shared(rotation).shape[2]))
    if refine:
        fit = _refine(points, fit)
    if refine and offset_sigma_m is not None:
        return _with_offset(
            points, fit, np.zeros((0, len(fit.shared))) if doubtful is None else doubtful, source, target
        )
    transform = RigidTransform(source=source, target=target, rotation=fit.rotation, translation_m=fit.translation_m)
    residuals_m = transform.apply(source_m) - target_m
    freedom = 3 * len(source_m) - 6
    if known:
        noise = points.noise(fit.rotation)
        weighing = np.linalg.inv(noise) if refine else weights[:, None, None] * np.eye(3)
    else:
        # Equal, isotropic errors of the size that the residuals show.
        noise = np.tile(np.eye(3) * float(np.sum(residuals_m**2)) / freedom, (len(source_m), 1, 1))
        weighing = np.tile(np.eye(3), (len(source_m), 1, 1))
    misfit = points.chi_squared(fit) / freedom if known else 1.0
    return Registration(
        transform=transform,
        residuals_m=residuals_m,
        errors=registration_errors(
            target_m, noise, weighing, shared_m=points.shared(fit.rotation), shared_estimated=refine
        ),
        shared=fit.shared,
        misfit=misfit,
        probability=float(chdtrc(freedom, misfit * freedom)),
    )


def _with_offset(
    points: _Points, fit: _Fit, doubtful: Float64[np.ndarray, "directions errors"], source: str, target: str
) -> Registration:
    """Return the registration with an offset of unknown size, from the fit with the stated one."""
    misfit = points.chi_squared(fit) / points.freedom
    posterior = _posterior(points, fit, doubtful)
    fit = fit.moved(posterior.mean, posterior.middle_m)
    transform = RigidTransform(source=source, target=target, rotation=fit.rotation, translation_m=fit.translation_m)
    noise = points.noise(fit.rotation)
    stated = registration_errors(points.target_m, noise, np.linalg.inv(noise), shared_m=points.shared(fit.rotation))
    kept = posterior.weights > _NEGLIGIBLE * posterior.weights.max()
    return Registration(
        transform=transform,
        residuals_m=transform.apply(points.source_m) - points.target_m,
        errors=RegistrationErrors(
            covariances=posterior.covariances[kept],
            weights=posterior.weights[kept] / posterior.weights[kept].sum(),
            middle_m=posterior.middle_m,
            fre_m=stated.fre_m,
        ),
        shared=fit.shared,
        misfit=misfit,
        probability=posterior.probability,
        offset_sigma_m=posterior.offset_sigma_m,
        log_evidence=posterior.log_evidence,
        doubts=posterior.doubts,
    )


_NEGLIGIBLE = 1e-4
"""Share of the most probable part of a mixture below which another part is left out."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """A transform, and the errors that all points share in their standard deviations."""

    rotation: Float64[np.ndarray, "3 3"]
    translation_m: Float64[np.ndarray, " 3"]
    shared: Float64[np.ndarray, " errors"]

    def moved(self, step: Float64[np.ndarray, " unknowns"], middle_m: Float64[np.ndarray, " 3"]) -> _Fit:
        """Return the fit after a small rotation about a point, a translation, and a change of the shared errors."""
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        return _Fit(
            rotation=turn @ self.rotation,
            translation_m=turn @ (self.translation_m - middle_m) + middle_m + step[3:6],
            shared=self.shared + step[6:],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Points:
    """What was measured: the arguments of `register_points`."""

    source_m: Float64[np.ndarray, "points 3"]
    target_m: Float64[np.ndarray, "points 3"]
    from_source: Float64[np.ndarray, "points 3 3"]
    from_target: Float64[np.ndarray, "points 3 3"]
    offset_m2: float
    """Variance of the stated offset along each direction."""
    source_shared_m: Float64[np.ndarray, "points 3 source_errors"]
    target_shared_m: Float64[np.ndarray, "points 3 target_errors"]

    @property
    def freedom(self) -> int:
        """Degrees of freedom of chi squared; each shared error is an unknown, and its prior an observation."""
        return 3 * len(self.source_m) - 6

    def noise(self, rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "points 3 3"]:
        """Return the covariance of each residual, with the stated offset; that of the source points turns with them."""
        return np.asarray(rotation @ self.from_source @ rotation.T + self.from_target + self.offset_m2 * np.eye(3))

    def shared(self, rotation: Float64[np.ndarray, "3 3"]) -> Float64[np.ndarray, "points 3 errors"]:
        """Return the change of each residual by each error that all points share."""
        return np.concatenate([-rotation @ self.source_shared_m, self.target_shared_m], axis=2)

    def unexplained(self, fit: _Fit) -> Float64[np.ndarray, "points 3"]:
        """Return the transformed source points minus target points, without what the shared errors explain."""
        residuals = self.source_m @ fit.rotation.T + fit.translation_m - self.target_m
        return np.asarray(residuals + self.shared(fit.rotation) @ fit.shared)

    def linear(
        self, fit: _Fit
    ) -> tuple[Float64[np.ndarray, "points 3"], Float64[np.ndarray, "points 3 unknowns"], Float64[np.ndarray, " 3"]]:
        """Return the residuals of a fit, their derivatives by rotation, translation and shared errors, and the middle.

        The derivative is taken at the most likely true points, between the two measurements of each: that of the whole
        likelihood, in which also the noise depends on the rotation. At the measured points it would not converge where
        a camera's depth is poor.
        """
        left_m = self.unexplained(fit)
        pull = np.linalg.solve(self.noise(fit.rotation), left_m[:, :, None])[:, :, 0]
        errors_m = self.target_shared_m @ fit.shared[self.source_shared_m.shape[2] :]
        likely_m = self.target_m - errors_m + np.einsum("nij,nj->ni", self.from_target, pull)
        middle_m = likely_m.mean(axis=0)
        effect = np.concatenate([effect_of_motion(likely_m - middle_m), self.shared(fit.rotation)], axis=2)
        return left_m, effect, middle_m

    def chi_squared(self, fit: _Fit) -> float:
        """Return minus twice the logarithm of the probability of all errors, but for a constant."""
        left = self.unexplained(fit)
        inverse = np.linalg.inv(self.noise(fit.rotation))
        return float(np.einsum("ni,nij,nj->", left, inverse, left) + fit.shared @ fit.shared)


def _refine(points: _Points, fit: _Fit) -> _Fit:
    """Maximise the likelihood by Gauss-Newton steps."""
    misfit = points.chi_squared(fit)
    prior = np.concatenate([np.zeros(6), np.ones(len(fit.shared))])
    for _ in range(_STEPS):
        left_m, effect, middle_m = points.linear(fit)
        weighted = np.swapaxes(effect, 1, 2) @ np.linalg.inv(points.noise(fit.rotation))
        normal = np.einsum("nij,njk->ik", weighted, effect) + np.diag(prior)
        downhill = -np.einsum("nij,nj->i", weighted, left_m)
        downhill[6:] -= fit.shared
        step = np.linalg.solve(normal, downhill)
        # Shorter steps where a whole one overshoots; the last bits of the misfit are rounding.
        while True:
            tried = fit.moved(step, middle_m)
            reached = points.chi_squared(tried)
            if reached <= misfit * (1 + 1e-9) or np.abs(step).max() < _SMALL:
                break
            step = step / 2
        fit = tried
        misfit = reached
        if np.abs(step[:6]).max() < _SMALL:
            break
    # Three points far from a camera can leave a flat valley: every step was downhill, and the end is as good as any.
    return fit


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Posterior:
    """What is known of a step from a fit, over all sizes of the offset and all shared errors in doubt."""

    mean: Float64[np.ndarray, " unknowns"]
    middle_m: Float64[np.ndarray, " 3"]
    """The point about which the step turns."""
    weights: Float64[np.ndarray, " parts"]
    covariances: Float64[np.ndarray, "parts unknowns unknowns"]
    """Second moments of each part about the mean of all."""
    offset_sigma_m: float
    probability: float
    log_evidence: float
    doubts: tuple[DoubtedError, ...]


def _posterior(points: _Points, fit: _Fit, doubtful: Float64[np.ndarray, "directions errors"]) -> _Posterior:
    """Return the posterior about a fit.

    For one size of the offset, with residuals e = r + A x + noise of covariance N, and the shared errors s + x of prior
    covariance D: H = Aᵀ N⁻¹ A + D⁻¹, x = H⁻¹ b, b = −(Aᵀ N⁻¹ r + D⁻¹ s), chi² = rᵀ N⁻¹ r + sᵀ D⁻¹ s − bᵀ x. The
    evidence for any transform is (2π)^(3 − 3n/2) (|N| |D| |H|)^(−1/2) exp(−chi²/2).
    """
    left_m, effect, middle_m = points.linear(fit)
    noise = points.noise(fit.rotation) - points.offset_m2 * np.eye(3)
    smaller, larger = OFFSET_FACTORS
    offsets_m2 = points.offset_m2 * np.where(_OFFSETS < 0, smaller, larger) ** (2 * _OFFSETS)
    noises = noise + offsets_m2[:, None, None, None] * np.eye(3)
    weighted = np.swapaxes(effect, 1, 2) @ np.linalg.inv(noises)
    normals = np.einsum("knij,njl->kil", weighted, effect)
    downhill = -np.einsum("knij,nj->ki", weighted, left_m)
    squares = np.einsum("ni,knij,nj->k", left_m, np.linalg.inv(noises), left_m)
    # First all errors as assumed, then each direction wider: D = 1 + (WIDER² − 1) u uᵀ.
    count = len(fit.shared)
    precisions = np.zeros((1 + len(doubtful), 6 + count, 6 + count))
    precisions[:, 6:, 6:] = np.eye(count)
    precisions[1:, 6:, 6:] -= (1 - WIDER**-2) * doubtful[:, :, None] * doubtful[:, None, :]
    widened = np.where(np.arange(len(precisions)) > 0, 2 * math.log(WIDER), 0.0)
    so_far = np.concatenate([np.zeros(6), fit.shared])
    normal = normals[:, None] + precisions
    downhills = downhill[:, None] - precisions @ so_far
    steps = np.linalg.solve(normal, downhills[..., None])[..., 0]
    chi_squared = squares[:, None] + so_far @ precisions @ so_far - np.einsum("kji,kji->kj", downhills, steps)
    logs = np.linalg.slogdet(noises)[1].sum(axis=1)[:, None] + widened + np.linalg.slogdet(normal)[1]
    log_likelihoods = -(chi_squared + logs + points.freedom * math.log(2 * math.pi)) / 2
    shares = np.full(len(precisions), DOUBT / max(len(doubtful), 1))
    shares[0] = 1 - shares[1:].sum()
    sizes = np.exp(-(_OFFSETS**2) / 2)
    prior = np.outer(sizes / sizes.sum(), shares)
    log_evidence = float(logsumexp(log_likelihoods, b=prior))
    weights = prior * np.exp(log_likelihoods - log_evidence)
    mean = np.einsum("kj,kji->i", weights, steps)
    apart = steps - mean
    covariances = np.linalg.inv(normal) + apart[..., :, None] * apart[..., None, :]
    return _Posterior(
        mean=mean,
        middle_m=middle_m,
        weights=weights.ravel(),
        covariances=covariances.reshape(-1, 6 + count, 6 + count),
        offset_sigma_m=math.sqrt(float(weights.sum(axis=1) @ offsets_m2)),
        probability=float(np.sum(prior * chdtrc(points.freedom, chi_squared))),
        log_evidence=log_evidence,
        doubts=_doubts(
            np.log(prior[:, 1:]) + log_likelihoods[:, 1:] - log_evidence,
            fit.shared + steps[:, 1:, 6:],
            np.linalg.inv(normal)[:, 1:, 6:, 6:],
            doubtful,
        ),
    )


def _doubts(
    log_weights: Float64[np.ndarray, "offsets directions"],
    shared: Float64[np.ndarray, "offsets directions errors"],
    covariances: Float64[np.ndarray, "offsets directions errors errors"],
    doubtful: Float64[np.ndarray, "directions errors"],
) -> tuple[DoubtedError, ...]:
    """Return the probability and estimate of the shared errors along each direction, if it is the wider one."""
    values = np.einsum("kji,ji->kj", shared, doubtful)
    variances = np.einsum("ji,kjil,jl->kj", doubtful, covariances, doubtful)
    found = []
    for log_weight, value, variance in zip(log_weights.T, values.T, variances.T, strict=True):
        share = softmax(log_weight)
        mean = float(share @ value)
        spread = float(share @ (variance + (value - mean) ** 2))
        found.append(DoubtedError(probability=float(np.exp(log_weight).sum()), value=mean, sigma=math.sqrt(spread)))
    return tuple(found)


def _require_points(points_m: Float64[np.ndarray, "points 3"], frame: str) -> None:
    """Refuse points that determine no transform."""
    if not MIN_POINTS <= len(points_m) <= MAX_POINTS:
        raise ConfigError(
            f"{len(points_m)} points in {frame}, it must be {MIN_POINTS} to {MAX_POINTS} that are not on a line"
        )
    if not np.isfinite(points_m).all():
        number = int(np.flatnonzero(~np.isfinite(points_m).all(axis=1))[0]) + 1
        raise ConfigError(f"point {number} in {frame} has a coordinate that is not finite; leave the point out")
    apart = points_m - points_m.mean(axis=0)
    spread_m = float(np.linalg.norm(apart, axis=1).max())
    if not spread_m <= MAX_SPREAD_M:
        raise ConfigError(
            f"the points in {frame} reach {spread_m:.3g} m from their middle, at most {MAX_SPREAD_M:g} m is possible; "
            "give metres, not millimetres"
        )
    length, width = np.linalg.svd(apart, compute_uv=False)[:2]
    if not width > MIN_WIDTH * length:
        raise ConfigError(
            f"the points in {frame} lie on a line: their width is {width / max(length, 1e-300):.2g} of their length, "
            f"more than {MIN_WIDTH:g} is needed; add a point beside the line"
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
