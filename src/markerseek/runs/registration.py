"""Registration of the da Vinci system to the probe from markers and camera points, judged and reported."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from markerseek._version import __version__
from markerseek.core import ConfigError, Float64
from markerseek.geometry import LeaveOneOut, Registration, leave_one_out, mirror_image_fre, register_points

MOST_FRE_M = 5e-3
"""Largest fiducial registration error in metres with which a registration is accepted."""

MIRROR_SHARE, MIRROR_FRE_M = 0.5, 1e-3
"""A mirror image is reported if its FRE is below this share of the registration's, and the latter above this length and
above twice what the sigmas let expect. Nearly flat points fit a mirror image about equally well, by chance even better.
"""

TARGET_DEPTH_M = 20e-3
"""Usual target: this far under the middle of the points, towards the axis of the probe, in metres."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointPair:
    """One point measured in both frames.

    Attributes
    ----------
    name
        Its name for messages.
    trus_m, camera_m
        The point in the frame of the probe and in that of the camera, in metres.
    trus_covariance_m2, camera_covariance_m2
        Covariances in these frames, in m²; None where they are not known.
    """

    name: str
    trus_m: Float64[np.ndarray, " 3"]
    camera_m: Float64[np.ndarray, " 3"]
    trus_covariance_m2: Float64[np.ndarray, "3 3"] | None = None
    camera_covariance_m2: Float64[np.ndarray, "3 3"] | None = None


Triple = tuple[float, float, float]


class PointReport(msgspec.Struct, frozen=True, kw_only=True):
    """One point of a registration.

    ``transformed_m`` is the camera point in the TRUS frame, ``residual_m`` its distance from ``trus_m``, and
    ``left_out_m`` the same where the transform comes from the other points only; None where they determine none.
    """

    name: str
    trus_m: Triple
    camera_m: Triple
    transformed_m: Triple
    residual_m: float
    left_out_m: float | None


class RegistrationReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a registration as one JSON object.

    ``davinci_to_trus`` maps points of the frame ``frames.davinci`` to the frame ``frames.trus``, in metres; None where
    the registration is not accepted, and ``reason`` says why. ``fre_m`` is the root mean square residual,
    ``expected_fre_m`` what the sigmas let expect, ``misfit`` chi squared by its degrees of freedom. ``tre_m`` is the
    expected root mean square error at ``target_trus_m``. ``weights`` says whether the sigmas were used.
    """

    registered: bool
    reason: str | None
    davinci_to_trus: list[list[float]] | None
    frames: dict[str, str]
    fre_m: float
    expected_fre_m: float
    tre_m: float
    target_trus_m: Triple
    misfit: float
    mirror_image_fre_m: float
    weights: Literal["sigmas of both", "equal"]
    worst: str
    points: list[PointReport]
    version: str = __version__


FRAMES = {
    "davinci": "the left camera of the stereo endoscope: x to the right in the image, y down, z along the view",
    "trus": "the probe at 0 deg: y along its axis of rotation, z out of the array, x completes the right hand",
}
"""The two frames, in words."""


def register_pairs(pairs: Sequence[PointPair], *, target_trus_m: Triple | None = None) -> RegistrationReport:
    """Register point pairs, and judge the result.

    Sigmas are used where all points have them in both frames: with those of one frame only, the other would count as
    exact.

    Parameters
    ----------
    pairs
        The points; at least three that are not on a line.
    target_trus_m
        Where the error is wanted, in the TRUS frame in metres; None: `TARGET_DEPTH_M` under the middle of the points.

    Raises
    ------
    ConfigError
        If the points determine no transform.
    """
    if target_trus_m is not None and not np.isfinite(target_trus_m).all():
        raise ConfigError(f"the target is {target_trus_m} m, its coordinates must be finite")
    camera_m = np.array([pair.camera_m for pair in pairs], dtype=float).reshape(-1, 3)
    trus_m = np.array([pair.trus_m for pair in pairs], dtype=float).reshape(-1, 3)
    from_camera = [pair.camera_covariance_m2 for pair in pairs if pair.camera_covariance_m2 is not None]
    from_trus = [pair.trus_covariance_m2 for pair in pairs if pair.trus_covariance_m2 is not None]
    weighed = len(from_camera) == len(from_trus) == len(pairs) > 0
    camera_covariances = np.array(from_camera) if weighed else None
    trus_covariances = np.array(from_trus) if weighed else None
    found = register_points(
        camera_m, trus_m, source_covariances_m2=camera_covariances, target_covariances_m2=trus_covariances
    )
    left_out = leave_one_out(
        camera_m, trus_m, source_covariances_m2=camera_covariances, target_covariances_m2=trus_covariances
    )
    worst = pairs[_worst(found, left_out)].name
    mirror_fre_m = mirror_image_fre(camera_m, trus_m)
    reason = _refusal(found, mirror_fre_m, worst, weighed=weighed)
    target = _under(trus_m) if target_trus_m is None else target_trus_m
    return RegistrationReport(
        registered=reason is None,
        reason=reason,
        davinci_to_trus=found.transform.matrix.tolist() if reason is None else None,
        frames=FRAMES,
        fre_m=found.fre_m,
        expected_fre_m=found.errors.fre_m,
        tre_m=found.tre_m(np.array(target)),
        target_trus_m=target,
        misfit=found.misfit,
        mirror_image_fre_m=mirror_fre_m,
        weights="sigmas of both" if weighed else "equal",
        worst=worst,
        points=[
            PointReport(
                name=pair.name,
                trus_m=_triple(pair.trus_m),
                camera_m=_triple(pair.camera_m),
                transformed_m=_triple(pair.trus_m + residual_m),
                residual_m=float(np.linalg.norm(residual_m)),
                left_out_m=None if out is None else out.error_m,
            )
            for pair, residual_m, out in zip(pairs, found.residuals_m, left_out, strict=True)
        ],
    )


def _worst(found: Registration, left_out: Sequence[LeaveOneOut | None]) -> int:
    """Point without which the others fit best; the largest residual where no point can be left out."""
    fits = [(out.fre_m, number) for number, out in enumerate(left_out) if out is not None]
    # With four points each rest of three fits well, so that the residual says more.
    if len(fits) < 5:
        return int(np.argmax(found.distances_m))
    return min(fits)[1]


def _refusal(found: Registration, mirror_fre_m: float, worst: str, *, weighed: bool) -> str | None:
    """Why a registration is not accepted; None if it is."""
    fre_m = found.fre_m
    # Without sigmas the residuals themselves are what is expected.
    expected_m = max(MIRROR_FRE_M, 2 * found.errors.fre_m if weighed else 0.0)
    if fre_m > expected_m and mirror_fre_m < MIRROR_SHARE * fre_m:
        return (
            f"a mirror image fits better: FRE {1e3 * mirror_fre_m:.2f} mm and {1e3 * fre_m:.2f} mm without; one of the "
            f"frames is left-handed, or points are swapped (the worst is point {worst}); check the sign of each axis"
        )
    if not fre_m <= MOST_FRE_M:
        return (
            f"FRE is {1e3 * fre_m:.2f} mm, at most {1e3 * MOST_FRE_M:g} mm is accepted; point {worst} fits worst: "
            "check that its marker and its camera point are the same spot, or leave it out"
        )
    return None


def _under(trus_m: Float64[np.ndarray, "points 3"]) -> Triple:
    """Usual target: under the middle of the points, towards the axis."""
    x, y, z = trus_m.mean(axis=0).tolist()
    radius_m = float(np.hypot(x, z))
    share = max(radius_m - TARGET_DEPTH_M, 0.0) / radius_m if radius_m > 0 else 0.0
    return share * x, y, share * z


def _triple(point_m: Float64[np.ndarray, " 3"]) -> Triple:
    x, y, z = point_m.tolist()
    return x, y, z
