"""Position of the marker in the TRUS frame, from a search's answer and its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from markerseek.core.estimate import Found, Unsure
from markerseek.core.plan import RigFacts
from markerseek.core.reading import Sample
from markerseek.core.shapes import CHECKED, Float64

if TYPE_CHECKING or CHECKED:
    import numpy as np

STRONG_SHARE = 0.5
"""Least intensity over the strongest one's, from which a frame counts for the position."""

SAME_SOURCE_M = 3e-3
"""Largest distance, along the array and in depth, of its peak from the strongest one's: the widest stained spot."""

LATERAL_M, DEPTH_M = 0.5e-3, 0.5e-3
"""Standard deviations of lateral position and depth over the share of the channels' energy that is out of phase, in
metres. A stained spot is uneven, all frames show its brightest part, and so their scatter says little; but its grains
are out of phase, as a point is not. Fitted to simulated searches on four materials (docs/explanation/registration.md).
"""

UNKNOWN_COHERENCE = 0.6
"""Coherence that is assumed where a frame gives none: that of a wide stained spot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerPosition:
    """Where the marker is.

    Attributes
    ----------
    position_m
        (x, y, z) in the TRUS frame, in metres: y along the axis of rotation, z out of the array at 0°.
    sigma_m
        Standard deviations along the turn (that of the angle), along the axis (lateral) and away from the axis
        (depth), in metres. Errors that all markers share, as that of the sound speed, are not in them.
    """

    position_m: tuple[float, float, float]
    sigma_m: tuple[float, float, float]

    @property
    def axes(self) -> Float64[np.ndarray, "3 3"]:
        """Unit vectors along the turn, along the axis and away from it, row by row."""
        # Imported here: NumPy takes a tenth of a second to import, and ``markerseek --help`` needs none of it.
        import numpy as np

        angle = math.atan2(self.position_m[0], self.position_m[2])
        return np.array([[math.cos(angle), 0, -math.sin(angle)], [0, 1, 0], [math.sin(angle), 0, math.cos(angle)]])

    @property
    def covariance_m2(self) -> Float64[np.ndarray, "3 3"]:
        """Covariance of the position in the TRUS frame, in m²."""
        import numpy as np

        axes = self.axes
        return np.asarray(axes.T @ np.diag(np.square(self.sigma_m)) @ axes)


def marker_position(found: Found | Unsure, samples: Sequence[Sample], facts: RigFacts) -> MarkerPosition | None:
    """Position of the marker; None where the frames give no position, or the face radius is not known.

    Lateral position and depth are means over the strong frames, weighted by the square of their intensity, of the
    centroid of the energy: which grain of a stained spot, or which edge of a long laser pulse, is the peak is chance.

    ``samples``: all samples with light, the confirmation among them. ``facts``: face radius and sound speed of the rig.
    """
    face_m = facts.face_radius_m
    positions = [at for sample in samples if (at := _position_of(sample, facts.sound_speed_m_s)) is not None]
    if face_m is None or not positions:
        return None
    strongest = max(positions, key=lambda at: at.intensity)
    strong = [at for at in positions if _same_source(at, strongest)]
    weights = [at.intensity**2 for at in strong]
    radii_m = [_radius_m(at.depth_m, face_m, math.radians(at.angle_deg - found.mean_deg)) for at in strong]
    incoherent = 1 - _mean([at.coherence for at in strong], weights)
    lateral_m, radius_m = _mean([at.lateral_m for at in strong], weights), _mean(radii_m, weights)
    angle = math.radians(found.mean_deg)
    return MarkerPosition(
        position_m=(radius_m * math.sin(angle), lateral_m, radius_m * math.cos(angle)),
        sigma_m=(radius_m * math.radians(found.sigma_deg), LATERAL_M * incoherent, DEPTH_M * incoherent),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _SourcePosition:
    """Where a frame shows its strongest source."""

    angle_deg: float
    intensity: float
    lateral_m: float
    depth_m: float
    coherence: float


def _position_of(sample: Sample, sound_speed_m_s: float | None) -> _SourcePosition | None:
    """Position of a sample's source: its energy's centroid, else the peak; its depth by the centroid in time."""
    reading = sample.reading
    if reading.lateral_m is None or reading.depth_m is None:
        return None
    # Never quite 1, so that no marker is taken for exact.
    coherence = min(UNKNOWN_COHERENCE if reading.coherence is None else reading.coherence, 0.99)
    if reading.spot is not None:
        return _SourcePosition(
            angle_deg=sample.angle_deg,
            intensity=reading.intensity,
            lateral_m=reading.spot.lateral_m,
            depth_m=reading.spot.depth_m,
            coherence=coherence,
        )
    later_s = 0.0
    if reading.centroid_s is not None and reading.arrival_s is not None:
        # Both count from the trigger, so that its offset cancels.
        later_s = reading.centroid_s - reading.arrival_s
    depth_m = reading.depth_m + (sound_speed_m_s or 0.0) * later_s
    return _SourcePosition(
        angle_deg=sample.angle_deg,
        intensity=reading.intensity,
        lateral_m=reading.lateral_m,
        depth_m=depth_m,
        coherence=coherence,
    )


def _same_source(position: _SourcePosition, strongest: _SourcePosition) -> bool:
    """Whether a position is strong, and near the strongest."""
    return (
        position.intensity >= STRONG_SHARE * strongest.intensity
        and abs(position.lateral_m - strongest.lateral_m) <= SAME_SOURCE_M
        and abs(position.depth_m - strongest.depth_m) <= SAME_SOURCE_M
    )


def _radius_m(slant_m: float, face_m: float, off_plane: float) -> float:
    """Distance from the axis: ρ of r² = R² + ρ² − 2 R ρ cos t, with the slant range r and the angle t off the plane."""
    across_m = face_m * math.sin(off_plane)
    return face_m * math.cos(off_plane) + math.sqrt(max(slant_m**2 - across_m**2, 0.0))


def _mean(values: Sequence[float], weights: Sequence[float]) -> float:
    return sum(weight * value for weight, value in zip(weights, values, strict=True)) / sum(weights)
