"""Where else a marker may be: other peaks of the posterior, and other places along the array."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.core import Interval
from markerseek.core.reading import Sample
from markerseek.search.posterior.belief import Belief
from markerseek.search.posterior.middle import SAME_PLACE_M

MODE_SHARE = 0.05
"""Probability from which a second peak of the posterior is a mode."""

RIVAL_SHARE = 0.3
"""Intensity over the largest from which a source elsewhere along the array is a second marker, not clutter."""

RIVAL_SAMPLES = 2
"""Samples that must have heard it there: one may be a burst."""


def modes_deg(belief: Belief, *, limits: Interval) -> tuple[float, ...]:
    """Return the peaks of the posterior with gaps between them, the likeliest first, in degrees.

    Parameters
    ----------
    belief
        The posterior.
    limits
        Range of the search.
    """
    share = belief.coarse_share
    above = share > 1e-4 * share.max()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], above.astype(np.int64), [0]])))
    modes = []
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        mass = float(share[first:end].sum())
        if mass > MODE_SHARE:
            middle_deg = float(share[first:end] @ belief.coarse_deg[first:end]) / mass
            modes.append((mass, min(max(middle_deg, limits.low_deg), limits.high_deg)))
    return tuple(middle_deg for _, middle_deg in sorted(modes, reverse=True))


def rival_deg(lit: Sequence[Sample], *, level: float, marker_m: float | None) -> float | None:
    """Return the angle at which a second source, elsewhere along the array, was heard loudest; None without one.

    Parameters
    ----------
    lit
        Samples with the laser on.
    level
        Intensity that noise does not reach.
    marker_m
        Lateral position of the marker in metres; None if unknown.
    """
    if marker_m is None:
        return None
    least = max(level, RIVAL_SHARE * max(sample.reading.intensity for sample in lit))
    away = [
        (sample.reading.intensity, sample.angle_deg, sample.reading.lateral_m)
        for sample in lit
        if sample.reading.lateral_m is not None
        and sample.reading.intensity >= least
        and abs(sample.reading.lateral_m - marker_m) > SAME_PLACE_M
    ]
    if not away:
        return None
    _, loudest_deg, there_m = max(away)
    together = sum(abs(lateral_m - there_m) < SAME_PLACE_M for _, _, lateral_m in away)
    return loudest_deg if together >= RIVAL_SAMPLES else None
