"""Whether the probe sees the spot where the registration says: depth, place along the array and, by turning, the angle.

The depth of one frame is the slant range r from the array's face, of r² = R² + ρ² − 2 R ρ cos t for a source at the
distance ρ from the axis whose plane is turned by t from the probe's, with the face at R.                          (1)

A frame says little of the angle. Three frames, at the angle that is expected and to both sides of it, give it: the
logarithm of the intensity is a parabola near its maximum, whose vertex is at

    θ₀ + d/2 · (l₋ − l₊) / (l₋ − 2 l₀ + l₊).                                                                     (2)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np
from scipy.special import chdtri

from markerseek.core import Float64, Reading, Sample, SpotToSource, place_sigmas_m
from markerseek.following.aim import Aim
from markerseek.search import noise_factor

AGREES = 0.9973
"""Probability with which a place agrees with a right prediction: that of three standard deviations along one axis."""

CONFIRMED_M = 2e-3
"""Largest distance from the prediction that confirms it: twice the error at which a registration session ends."""

ASIDE_DEG = 3.0
"""Angle to both sides at which the intensity is compared."""

ENERGY_SIGMA = 0.05
"""Relative standard deviation of the intensity from one frame to the next, beside the noise: the laser's energy, and
the depth of a hand-held fibre."""

FALSE_ALARM = 1e-3
"""Probability that noise alone is taken for a source."""


class Comparison(msgspec.Struct, frozen=True, kw_only=True):
    """What one frame says of the prediction."""

    seen: bool
    """Whether it shows a source at all."""
    lateral_off_m: float = 0.0
    depth_off_m: float = 0.0
    """``lateral_off_m``, ``depth_off_m``: place in the image less what is expected."""
    lateral_sigma_m: float = 1.0
    depth_sigma_m: float = 1.0
    """``lateral_sigma_m``, ``depth_sigma_m``: standard deviations of these differences."""
    agrees: bool = False
    """Whether there is a source, and its place is one of the likeliest by the prediction, in both directions together.
    """

    @property
    def said(self) -> str:
        """The comparison in a sentence."""
        if not self.seen:
            return "no source here: the spot is not on tissue that the probe sees, or the registration is wrong"
        return (
            f"the source is {1e3 * self.lateral_off_m:+.1f} ± {1e3 * self.lateral_sigma_m:.1f} mm along the array and "
            f"{1e3 * self.depth_off_m:+.1f} ± {1e3 * self.depth_sigma_m:.1f} mm in depth from the prediction"
        )


def compare(sample: Sample, aim: Aim, *, face_radius_m: float, spot: SpotToSource) -> Comparison:
    """Compare a frame with the prediction for it.

    ``aim``: of the source of the spot. ``face_radius_m``: distance of the array's face from the axis. ``spot``: how far
    spots and their sources are apart.
    """
    reading = sample.reading
    if not shows_source(reading) or reading.lateral_m is None or reading.depth_m is None:
        return Comparison(seen=False)
    turn = math.radians(aim.angle_deg - sample.angle_deg)
    slant_m = math.sqrt(face_radius_m**2 + aim.radius_m**2 - 2 * face_radius_m * aim.radius_m * math.cos(turn))
    lateral_m = reading.lateral_m if reading.spot is None else reading.spot.lateral_m
    depth_m = reading.depth_m if reading.spot is None else reading.spot.depth_m
    off_m = np.array([lateral_m - float(aim.trus_m[1]), depth_m - slant_m])
    covariance_m2 = _expected_m2(aim, place_sigmas_m(reading.coherence), spot)
    lateral_sigma_m, depth_sigma_m = np.sqrt(np.diag(covariance_m2))
    return Comparison(
        seen=True,
        lateral_off_m=float(off_m[0]),
        depth_off_m=float(off_m[1]),
        lateral_sigma_m=float(lateral_sigma_m),
        depth_sigma_m=float(depth_sigma_m),
        agrees=_agrees(off_m, covariance_m2),
    )


def _expected_m2(aim: Aim, read_m: Sequence[float], spot: SpotToSource) -> Float64[np.ndarray, "axes axes"]:
    """Return the covariance of the differences along the array, away from the axis, and about it, or of the first two.

    ``read_m``: standard deviation of the reading along each of them.
    """
    x, _, z = aim.trus_m / aim.radius_m
    axes = np.array([[0.0, 1.0, 0.0], [x, 0.0, z], [z, 0.0, -x]])[: len(read_m)]
    own_m2 = np.square(read_m) + spot.offset_sigma_m**2
    return np.asarray(axes @ aim.covariance_m2 @ axes.T + np.diag(own_m2))


def _agrees(off_m: Float64[np.ndarray, " axes"], covariance_m2: Float64[np.ndarray, "axes axes"]) -> bool:
    """Return whether a difference is one of the likeliest, along all axes together."""
    chi_squared = off_m @ np.linalg.solve(covariance_m2, off_m)
    return bool(chi_squared <= chdtri(len(off_m), 1 - AGREES))


def shows_source(reading: Reading) -> bool:
    """Return whether a frame shows more than noise alone."""
    sigma = reading.noise_sigma
    if not sigma or not reading.cells:
        return reading.intensity > 0
    return reading.intensity > sigma * noise_factor(cells=reading.cells, frames=1, false_found=FALSE_ALARM)


class Confirmed(msgspec.Struct, frozen=True, kw_only=True, tag="confirmed"):
    """The probe sees the spot where the registration says."""

    distance_m: float
    """Distance from the prediction."""

    @property
    def said(self) -> str:
        """The same in a sentence."""
        return f"confirmed, {1e3 * self.distance_m:.1f} mm from the prediction"


class NotConfirmed(msgspec.Struct, frozen=True, kw_only=True, tag="not-confirmed"):
    """It does not."""

    reason: str

    @property
    def said(self) -> str:
        """The same in a sentence."""
        return self.reason


def confirm(
    samples: tuple[Sample, Sample, Sample], aim: Aim, *, face_radius_m: float, spot: SpotToSource
) -> Confirmed | NotConfirmed:
    """Say whether three frames confirm a prediction.

    ``samples``: to the lower side, in the middle and to the upper side of the angle expected, about equally far apart.
    ``aim``, ``face_radius_m``, ``spot``: as of `compare`.
    """
    middle = compare(samples[1], aim, face_radius_m=face_radius_m, spot=spot)
    if not middle.seen:
        return NotConfirmed(reason=middle.said)
    vertex = intensity_vertex(samples)
    if vertex is None:
        return NotConfirmed(
            reason=f"no source here: the intensity does not fall to both sides of {samples[1].angle_deg:.1f} deg, the "
            "spot is not on tissue that the probe sees, or the registration is wrong"
        )
    angle_deg, sigma_deg = vertex
    if not 2 * math.radians(sigma_deg) * aim.radius_m <= CONFIRMED_M:
        return NotConfirmed(
            reason=f"the angle of the source is known to ± {sigma_deg:.1f} deg only, so that nothing is confirmed: use "
            "more pulses, or light tissue that absorbs more"
        )
    off_deg = angle_deg - aim.angle_deg
    along_m = math.radians(off_deg) * aim.radius_m
    off_m = np.array([middle.lateral_off_m, middle.depth_off_m, along_m])
    read_m = (*place_sigmas_m(samples[1].reading.coherence), math.radians(sigma_deg) * aim.radius_m)
    distance_m = float(np.linalg.norm(off_m))
    if not (_agrees(off_m, _expected_m2(aim, read_m, spot)) and distance_m <= CONFIRMED_M):
        return NotConfirmed(
            reason=f"the source is {1e3 * distance_m:.1f} mm from the prediction: {off_deg:+.1f} ± "
            f"{math.hypot(aim.sigma_deg, sigma_deg):.1f} deg about the axis; {middle.said}; the registration is wrong, "
            "or the tissue has moved: register again"
        )
    return Confirmed(distance_m=distance_m)


def intensity_vertex(samples: tuple[Sample, Sample, Sample]) -> tuple[float, float] | None:
    """Return the angle of the largest intensity by (2), and its standard deviation.

    None if there is no maximum among the three.

    A source farther off than the frames to both sides is none here.
    """
    angles_deg = np.array([sample.angle_deg for sample in samples])
    intensities = np.array([sample.reading.intensity for sample in samples])
    if not (np.isfinite(intensities).all() and (intensities > 0).all()):
        return None
    logs = np.log(intensities)
    noises = np.array([(sample.reading.noise_sigma or 0.0) for sample in samples]) / intensities
    sigmas = np.hypot(noises, ENERGY_SIGMA)
    middle_deg = angles_deg[1]
    if not angles_deg[0] < middle_deg < angles_deg[2]:
        return None

    def vertex_deg(values: Float64[np.ndarray, " 3"]) -> float:
        bend, slope, _ = np.polyfit(angles_deg - middle_deg, values, 2)
        return -slope / (2 * bend) if bend < 0 else math.nan

    at_deg = vertex_deg(logs)
    if not abs(at_deg) <= ASIDE_DEG:
        return None
    steps = 1e-3 * np.diag(sigmas)
    sigma_deg = 1e3 * math.hypot(*(vertex_deg(logs + step) - at_deg for step in steps))
    return (float(middle_deg + at_deg), sigma_deg) if math.isfinite(sigma_deg) else None
