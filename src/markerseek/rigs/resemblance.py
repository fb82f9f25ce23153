"""Whether an angle is heard as it was before, so that a search can go on from what it knew."""

from __future__ import annotations

from markerseek.core import Reading, Sample
from markerseek.scan import moved_source

SHARE = 0.1
"""Most that an intensity may change, as a share of the larger: about what a laser's energy drifts."""

SIGMAS = 6.0
"""And so many standard deviations of the noise beside."""


def commanded_deg(sample: Sample) -> float:
    """Angle in degrees to which the stage was sent for a sample; the one reached can lie a hair outside the range."""
    return sample.angle_deg if sample.frame is None else sample.frame.header.commanded_deg


def change_of(before: Reading, now: Reading) -> str | None:
    """What has changed between two readings at one angle, in words; None if chance alone can explain it.

    Parameters
    ----------
    before, now
        The readings.
    """
    noise = max(before.noise_sigma or 0.0, now.noise_sigma or 0.0)
    allowed = SHARE * max(before.intensity, now.intensity) + SIGMAS * noise
    if not abs(now.intensity - before.intensity) <= allowed:
        return (
            f"the intensity is {now.intensity:.4g} and was {before.intensity:.4g}, {allowed:.3g} would be the most by "
            "chance"
        )
    return moved_source(before, now)
