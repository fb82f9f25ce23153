"""Whether an angle is heard as it was before, so that a search can go on from what it knew."""

from __future__ import annotations

from markerseek.core import Reading, Sample

SHARE = 0.1
"""Most that an intensity may change, as a share of the larger: about what a laser's energy drifts."""

SIGMAS = 6.0
"""And so many standard deviations of the noise beside."""

MOVED_M = 1e-3
"""Most that a source may seem to move along the array or in depth, in metres: two to three resolution cells."""

SEEN_SIGMAS = 12.0
"""Intensity over the noise from which a place in the image is that of a source."""


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
    if min(before.intensity, now.intensity) > SEEN_SIGMAS * noise:
        for name in ("lateral_m", "depth_m"):
            then_m, now_m = getattr(before, name), getattr(now, name)
            if then_m is not None and now_m is not None and not abs(now_m - then_m) <= MOVED_M:
                return (
                    f"{name} is {1e3 * now_m:.2f} mm and was {1e3 * then_m:.2f} mm, {1e3 * MOVED_M:g} mm is the limit"
                )
    return None
