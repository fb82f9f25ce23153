"""Requirements on a calibration scan: enough angles, a source above the noise, its peak inside, no clipped waves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.core import Sample, SearchError

MIN_ANGLES = 8
"""Fewest angles that receive the source well."""

BESIDE = 2
"""Fewest of these angles on each side of the strongest."""

RECEIVED_RATIO = 8.0
"""Intensity over the noise from which a source is received well."""

_CURE = "scan one small source from 12 deg below it to 12 deg above, in steps of at most 1 deg"


def require_peak(samples: Sequence[Sample], *, saturated_limit: float) -> None:
    """Refuse a scan whose intensities alone show that it cannot be used for calibration.

    ``samples``: one for each angle, in the order of the angles. ``saturated_limit``: largest share of saturated
    channels at the strongest angle; clipping changes the shape of the wave.
    """
    if len(samples) < MIN_ANGLES:
        raise SearchError(
            f"{len(samples)} angles are too few to calibrate with, at least {MIN_ANGLES} must receive the source; "
            f"{_CURE}"
        )
    intensity = np.array([sample.reading.intensity for sample in samples])
    # Exactly equal: noise alone makes any two real intensities differ.
    if np.ptp(intensity) == 0:
        raise SearchError(
            f"the intensity is {intensity[0]:.4g} at every one of {len(samples)} angles, so that nothing turned or "
            f"nothing was recorded; {_CURE}"
        )
    best = int(np.argmax(intensity))
    strongest = samples[best]
    noise = strongest.reading.noise_sigma
    if noise is not None and not intensity[best] > RECEIVED_RATIO * noise:
        raise SearchError(
            f"no source at any angle: the strongest, at {strongest.angle_deg:g} deg, is {intensity[best] / noise:.2g} "
            f"times the noise, more than {RECEIVED_RATIO:g} are needed; check laser and gain, or average more pulses"
        )
    if not BESIDE <= best < len(samples) - BESIDE:
        raise SearchError(
            f"the source is strongest at {strongest.angle_deg:g} deg, at an end of the scan from "
            f"{samples[0].angle_deg:g} to {samples[-1].angle_deg:g} deg; scan further to that side, 12 deg beyond it"
        )
    # Only the strongest: it is the first to clip, and its wave is the template of the fit.
    clipped = strongest.reading.saturated_fraction
    if clipped is not None and not clipped <= saturated_limit:
        raise SearchError(
            f"{clipped:.0%} of the channels are saturated at {strongest.angle_deg:g} deg, at most "
            f"{saturated_limit:.0%} may be, for the shape of the wave is fitted; reduce the gain or the laser's energy "
            "and scan again"
        )
