"""Position of the marker in the TRUS frame, from a search's answer and its frames."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
from msgspec.structs import replace

from markerseek.core.estimate import Ambiguous, Estimate, Found, Unsure
from markerseek.core.plan import RigFacts
from markerseek.core.reading import Sample
from markerseek.core.shapes import CHECKED, Float64
from markerseek.core.undisplaced import DisplacementSigmas, displacement_sigmas, undisplaced

if TYPE_CHECKING or CHECKED:
    import numpy as np

_STRONG_SHARE = 0.5
"""Least intensity over the strongest one's, from which a frame counts for the position."""

SAME_SOURCE_M = 3e-3
"""Largest distance, along the array and in depth, of its peak from the strongest one's: the widest stained spot."""

_LATERAL_SIGMA_M = 0.5e-3
_DEPTH_SIGMA_M = 0.5e-3
"""Standard deviations of lateral position and depth over the share of the channels' energy that is out of phase, in
metres. A stained spot is uneven, all frames show its brightest part, and so their scatter says little; but its grains
are out of phase, as a point is not. Fitted to simulated searches on four materials (docs/validation/registration.md).
"""

_UNKNOWN_COHERENCE = 0.6
"""Coherence that is assumed where a frame gives none: that of a wide stained spot."""


class MarkerPosition(msgspec.Struct, frozen=True, kw_only=True):
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


class MarkerCandidate(msgspec.Struct, frozen=True, kw_only=True):
    """A source that may be the marker.

    Attributes
    ----------
    angle_deg
        Its angle in degrees.
    probability
        Probability that it is the marker, by its search alone: another measurement, such as that of a camera, may say
        more.
    position
        Where it is.
    """

    angle_deg: float
    probability: float
    position: MarkerPosition


_STRONGER_DB = 3.0
"""Standard deviation in dB of a difference in strength that does not show which source is the marker."""

_USUAL_OTHER = 0.01
_LEAST_OTHER = 1e-6
"""Probability that an answer is another source, where its method does not compute it, and at least."""

_SAME_DEG = 0.5
"""Angles nearer to one another are one candidate."""


def marker_candidates(estimate: Estimate, samples: Sequence[Sample], facts: RigFacts) -> tuple[MarkerCandidate, ...]:
    """Return the sources of an answer that may be the marker, the likeliest first.

    None where their places are not known.

    The strongest source has the place that `marker_position` gives, the others that of their own frames. How probable
    another source is follows from its strength, where the answer does not state it.

    Parameters
    ----------
    estimate
        The answer of a search.
    samples
        All its samples with light, the confirmation among them.
    facts
        Face radius and sound speed of the rig.
    """
    if not isinstance(estimate, Found | Unsure | Ambiguous) or estimate.sigma_deg is None:
        return ()
    first = marker_position(estimate, samples, facts)
    if first is None:
        return ()
    found = [(estimate.mean_deg, 1.0, first)]
    for other in estimate.others:
        if other.lateral_m is not None and other.depth_m is not None:
            place = (other.lateral_m, (facts.face_radius_m or 0.0) + other.depth_m)
            weight = min(1.0, math.exp(other.relative_db / _STRONGER_DB))
            found.append((other.angle_deg, weight, _placed(other.angle_deg, other.sigma_deg, *place)))
    if isinstance(estimate, Ambiguous):
        # The same source where its angle is one of several.
        x, lateral_m, z = first.position_m
        for mode_deg in estimate.modes_deg:
            if all(abs(mode_deg - angle_deg) > _SAME_DEG for angle_deg, _, _ in found):
                found.append((mode_deg, 1.0, _placed(mode_deg, estimate.sigma_deg, lateral_m, math.hypot(x, z))))
    rest = estimate.other_probability
    if isinstance(estimate, Found) or (isinstance(estimate, Unsure) and estimate.doubt == "width"):
        rest = _USUAL_OTHER if rest is None else max(rest, _LEAST_OTHER)
    others = sum(weight for _, weight, _ in found[1:])
    if rest is None:
        shares = [weight / (1 + others) for _, weight, _ in found]
    else:
        shares = [1 - rest, *(rest * weight / others for _, weight, _ in found[1:])]
    candidates = [
        MarkerCandidate(angle_deg=angle_deg, probability=share, position=position)
        for (angle_deg, _, position), share in zip(found, shares, strict=True)
    ]
    return tuple(sorted(candidates, key=lambda each: -each.probability))


def place_sigmas_m(coherence: float | None) -> tuple[float, float]:
    """Return the standard deviations of a source's lateral position and depth in an image of this coherence.

    ``coherence``: None where a frame gives none.
    """
    # Never quite 1, so that no marker is taken for exact.
    incoherent = 1 - min(_UNKNOWN_COHERENCE if coherence is None else coherence, 0.99)
    return _LATERAL_SIGMA_M * incoherent, _DEPTH_SIGMA_M * incoherent


def _placed(
    angle_deg: float, sigma_deg: float, lateral_m: float, radius_m: float, coherence: float = _UNKNOWN_COHERENCE
) -> MarkerPosition:
    """Return where a source is at this angle and distance from the axis; how well, follows from its coherence."""
    angle = math.radians(angle_deg)
    return MarkerPosition(
        position_m=(radius_m * math.sin(angle), lateral_m, radius_m * math.cos(angle)),
        sigma_m=(radius_m * math.radians(sigma_deg), *place_sigmas_m(coherence)),
    )


def marker_position(estimate: Estimate, samples: Sequence[Sample], facts: RigFacts) -> MarkerPosition | None:
    """Return the position of the marker; None if the frames give no position, or the face radius is not known.

    Lateral position and depth are means over the strong frames, weighted by the square of their intensity, of the
    centroid of the energy: which grain of a stained spot, or which edge of a long laser pulse, is the peak is chance.

    ``estimate``: an answer that names the marker. ``samples``: all samples with light, the confirmation among them.
    ``facts``: face radius and sound speed of the rig.
    """
    if estimate.sigma_deg is None:
        return None
    face_m = facts.face_radius_m
    if face_m is None:
        return None
    rested = undisplaced(samples, face_radius_m=face_m)
    positions = [at for sample in rested if (at := _position_of(sample, facts.sound_speed_m_s)) is not None]
    if not positions:
        return None
    strongest = max(positions, key=lambda at: at.intensity)
    strong = [at for at in positions if _same_source(at, strongest)]
    weights = [at.intensity**2 for at in strong]
    radii_m = [_radius_m(at.depth_m, face_m, math.radians(at.angle_deg - estimate.mean_deg)) for at in strong]
    lateral_m = _mean([at.lateral_m for at in strong], weights)
    radius_m = _mean(radii_m, weights)
    coherence = _mean([at.coherence for at in strong], weights)
    placed = _placed(estimate.mean_deg, estimate.sigma_deg, lateral_m, radius_m, coherence)
    turn_m, lateral_sigma_m, depth_sigma_m = placed.sigma_m
    # What cameras leave open of the tissue's displacement is in the angle already.
    lateral_left_m = _mean([at.left.lateral_m for at in strong], weights)
    depth_left_m = _mean([at.left.depth_m for at in strong], weights)
    sigma_m = (turn_m, math.hypot(lateral_sigma_m, lateral_left_m), math.hypot(depth_sigma_m, depth_left_m))
    return replace(placed, sigma_m=sigma_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class _SourcePosition:
    """Where a frame shows its strongest source."""

    angle_deg: float
    intensity: float
    lateral_m: float
    depth_m: float
    coherence: float
    left: DisplacementSigmas
    """What cameras leave open of the tissue's displacement."""


def _position_of(sample: Sample, sound_speed_m_s: float | None) -> _SourcePosition | None:
    """Return the position of a sample's source: its energy's centroid, else the peak.

    Its depth by the centroid in time.
    """
    reading = sample.reading
    if reading.lateral_m is None or reading.depth_m is None:
        return None
    lateral_m = reading.lateral_m
    depth_m = reading.depth_m
    if reading.spot is not None:
        lateral_m = reading.spot.lateral_m
        depth_m = reading.spot.depth_m
    elif reading.centroid_s is not None and reading.arrival_s is not None:
        # Both count from the trigger, so that its offset cancels.
        depth_m += (sound_speed_m_s or 0.0) * (reading.centroid_s - reading.arrival_s)
    return _SourcePosition(
        angle_deg=sample.angle_deg,
        intensity=reading.intensity,
        lateral_m=lateral_m,
        depth_m=depth_m,
        # Never quite 1, so that no marker is taken for exact.
        coherence=min(_UNKNOWN_COHERENCE if reading.coherence is None else reading.coherence, 0.99),
        left=displacement_sigmas(sample),
    )


def _same_source(position: _SourcePosition, strongest: _SourcePosition) -> bool:
    """Return whether a position is strong, and near the strongest."""
    return (
        position.intensity >= _STRONG_SHARE * strongest.intensity
        and abs(position.lateral_m - strongest.lateral_m) <= SAME_SOURCE_M
        and abs(position.depth_m - strongest.depth_m) <= SAME_SOURCE_M
    )


def _radius_m(slant_m: float, face_m: float, off_plane: float) -> float:
    """Return the radius ρ of r² = R² + ρ² − 2 R ρ cos t, with the slant range r and the angle t off the plane."""
    across_m = face_m * math.sin(off_plane)
    return face_m * math.cos(off_plane) + math.sqrt(max(slant_m**2 - across_m**2, 0.0))


def _mean(values: Sequence[float], weights: Sequence[float]) -> float:
    return sum(weight * value for weight, value in zip(weights, values, strict=True)) / sum(weights)
