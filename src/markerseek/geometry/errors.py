"""Expected errors of a point registration to first order: FRE, and TRE at any target.

For points with equal, isotropic errors this is the result of Fitzpatrick, West and Maurer (IEEE Trans. Med. Imaging 17,
1998). Covariances that differ in direction and from point to point, and weights, follow from the same linear equations
(Danilchenko and Fitzpatrick, IEEE Trans. Med. Imaging 30, 2011): a stereo camera measures depth several times worse
than the other two directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincinv

from markerseek.core import Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationErrors:
    """Expected errors of a registration."""

    covariance: Float64[np.ndarray, "unknowns unknowns"]
    """Covariance of the small rotation about the middle of the points (rad), of the translation (m), and of the errors
    that all points share, in their standard deviations, where these were estimated; shape (6 + errors, 6 + errors)."""
    middle_m: Float64[np.ndarray, " 3"]
    """That middle, in the frame of the target points."""
    fre_m: float
    """Expected fiducial registration error (FRE), root mean square."""

    def tre_covariance_m2(self, target_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 3"]:
        """Covariance of the position of a target, given in the frame of the target points, in m²."""
        effect = effect_of_motion(target_m[None, :] - self.middle_m)[0]
        return np.asarray(effect @ self.covariance[:6, :6] @ effect.T)

    def tre_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Expected target registration error (TRE), root mean square in metres, at a target."""
        return float(np.sqrt(np.trace(self.tre_covariance_m2(target_m))))

    def tre95_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Length in metres that 95 % of the errors at a target do not exceed.

        The square of a Gaussian vector's length is a sum of chi squares; its quantile is that of the gamma distribution
        with the same mean and variance (Satterthwaite), exact for equal variances and for one direction only.
        """
        spread = self.tre_covariance_m2(target_m)
        mean, half_variance = np.trace(spread), np.sum(spread**2)
        if mean == 0:
            return 0.0
        return float(np.sqrt(half_variance / mean * 2 * gammaincinv(mean**2 / half_variance / 2, 0.95)))


def registration_errors(
    points_m: Float64[np.ndarray, "points 3"],
    covariances_m2: Float64[np.ndarray, "points 3 3"],
    weights: Float64[np.ndarray, "points 3 3"],
    *,
    shared_m: Float64[np.ndarray, "points 3 errors"] | None = None,
    shared_estimated: bool = True,
) -> RegistrationErrors:
    """Expected errors of a registration to points.

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
    return RegistrationErrors(covariance=covariance, middle_m=middle_m, fre_m=float(np.sqrt(max(mean_square, 0.0))))


def effect_of_motion(offsets_m: Float64[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 3 6"]:
    """Displacement ω × d + τ of points by a small rotation ω about the origin and a translation τ, as matrices."""
    effect = np.zeros((len(offsets_m), 3, 6))
    x, y, z = offsets_m.T
    # ω × d, column by column of ω.
    effect[:, 1, 0], effect[:, 2, 0] = -z, y
    effect[:, 0, 1], effect[:, 2, 1] = z, -x
    effect[:, 0, 2], effect[:, 1, 2] = -y, x
    effect[:, :, 3:] = np.eye(3)
    return effect
