"""Why a marker is not found, or not known well enough, in words for a person."""

from __future__ import annotations

from collections.abc import Sequence

from markerseek.core import Interval
from markerseek.core.reading import Sample
from markerseek.search.floor import Noise
from markerseek.search.guarded import SIGMA_LIMIT_DEG
from markerseek.search.posterior.belief import Belief
from markerseek.search.posterior.reach import unheard


def missed(lit: Sequence[Sample], noise: Noise, limits: Interval) -> str:
    """Return what may have been there unheard; nothing where something was heard, or the noise is unknown."""
    level = noise.floor.level
    if level is None or noise.sigma is None or max(sample.reading.intensity for sample in lit) > level:
        return ""
    return unheard(limits, made=len(lit), level=level, sigma=noise.sigma)


def doubt(belief: Belief, hides_deg: float | None) -> str:
    """Return why a marker that was heard is not found.

    Parameters
    ----------
    belief
        The posterior.
    hides_deg
        Where a much louder marker may be unheard, in degrees; None: nowhere.
    """
    if belief.sigma_deg <= SIGMA_LIMIT_DEG:
        return (
            "what was heard is faint, and may be clutter of a louder marker unheard about "
            f"{hides_deg:.0f} deg; take more acquisitions"
        )
    said = f"the standard deviation, {belief.sigma_deg:.2f} deg, is above {SIGMA_LIMIT_DEG:g} deg"
    if belief.middle_sigma_deg <= SIGMA_LIMIT_DEG:
        return (
            f"{said}: the middle of the curve is known to {belief.middle_sigma_deg:.2f} deg, but its place and "
            "coherence change with the angle, so that it is no point, and its middle may be off"
        )
    return f"{said}; take more acquisitions or average more pulses"
