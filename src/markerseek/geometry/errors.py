"""Expected errors of a point registration to first order: FRE, and TRE at any target.

For points with equal, isotropic errors this is the result of Fitzpatrick, West and Maurer (IEEE Trans. Med. Imaging 17,
1998). Covariances that differ in direction and from point to point, and weights, follow from the same linear equations
(Danilchenko and Fitzpatrick, IEEE Trans. Med. Imaging 30, 2011): a stereo camera measures depth several times worse
than the other two directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationErrors:
    """Expected errors of a registration.

    Attributes
    ----------
    covariance
        Covariance of the small rotation about the middle of the points (rad) and of the translation (m), shape (6, 6).
    middle_m
        That middle, in the frame of the target points, in metres.
    fre_m
        Expected fiducial registration error (FRE), root mean square in metres.
    """

    covariance: Float64[np.ndarray, "6 6"]
    middle_m: Float64[np.ndarray, " 3"]
    fre_m: float

    def tre_covariance_m2(self, target_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 3"]:
        """Covariance of the position of a target, given in the frame of the target points, in m²."""
        effect = effect_of_motion(target_m[None, :] - self.middle_m)[0]
        return np.asarray(effect @ self.covariance @ effect.T)

    def tre_m(self, target_m: Float64[np.ndarray, " 3"]) -> float:
        """Expected target registration error (TRE), root mean square in metres, at a target."""
        return float(np.sqrt(np.trace(self.tre_covariance_m2(target_m))))


def registration_errors(
    points_m: Float64[np.ndarray, "points 3"],
    covariances_m2: Float64[np.ndarray, "points 3 3"],
    weights: Float64[np.ndarray, "points 3 3"],
) -> RegistrationErrors:
    """Expected errors of a registration to points.

    Parameters
    ----------
    points_m
        The points in the target frame, in metres.
    covariances_m2
        Covariance of each residual, which is that of both measurements of the point, in the target frame, in m².
    weights
        Weight matrix of each residual in the least squares fit; the inverse covariances for a maximum likelihood fit.
    """
    middle_m = points_m.mean(axis=0)
    # Residuals as a linear function of the rotation and translation: e = J θ + noise.
    effect = effect_of_motion(points_m - middle_m)
    weighted = np.swapaxes(effect, 1, 2) @ weights
    # Least squares: θ = −Σ G noise with G = (Σ Jᵀ W J)⁻¹ Jᵀ W; its covariance is Σ G C Gᵀ.
    gain = np.linalg.inv(np.einsum("nij,njk->ik", weighted, effect)) @ weighted
    covariance = np.einsum("nij,njk,nlk->il", gain, covariances_m2, gain)
    # E|e|² = tr C − 2 tr(J G C) + tr(J cov(θ) Jᵀ), summed over the points.
    mean_square = (
        np.einsum("nii->", covariances_m2)
        - 2 * np.einsum("nij,njk,nki->", effect, gain, covariances_m2)
        + np.einsum("nij,jk,nik->", effect, covariance, effect)
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
