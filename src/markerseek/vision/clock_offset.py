"""The offset between the clock of a camera and that of a rig, from the flashes that the camera saw.

A pair that came at time t of the camera is lit if a flash was fired while its image was exposed. Each offset is judged
by all pairs, lit and dark, with a share of pairs that are judged wrongly; the exposure is a nuisance. The offset
includes the time that an image takes to arrive. Both clocks are taken to run equally fast.
"""

from __future__ import annotations

import math

import msgspec
import numpy as np

from markerseek.core import Bool, Float64, require_range

EXPOSURES_S = (0.002, 0.005, 0.01, 0.02, 0.033, 0.05)
"""Exposures that are possible, equally probable."""

WRONG_SHARE = 0.02
"""Share of the pairs in which the light was missed, or seen where there was none."""

STEP_S = 1e-3
"""Step of the offsets that are judged."""

MAX_SIGMA_S = 0.05
"""Largest standard deviation of an offset that is known: a breath moves little in that time."""

MIN_ALIKE = 0.7
"""Least share of the pairs that are lit or should be, in which both agree: with less, the light is another one."""

MIN_CHANGES = 2
"""Fewest changes between lit and dark pairs."""


class ClockOffset(msgspec.Struct, frozen=True, kw_only=True):
    """The clock of the camera is ahead of that of the rig."""

    offset_s: float
    """Time at which a pair came, less the time of the rig at the end of its exposure."""
    sigma_s: float
    """Standard deviation of the offset."""

    def rig_s(self, camera_s: float) -> float:
        """Return the time of the rig at a time of the camera."""
        return camera_s - self.offset_s


def clock_offset(
    pairs_at_s: Float64[np.ndarray, " pairs"],
    lit: Bool[np.ndarray, " pairs"],
    flashes_at_s: Float64[np.ndarray, " flashes"],
    *,
    within_s: float = 2.0,
) -> ClockOffset | None:
    """Return the offset of the camera's clock; None if the flashes do not determine it.

    Parameters
    ----------
    pairs_at_s
        Times of image pairs on the camera's clock, rising.
    lit
        Which of them show the laser's light.
    flashes_at_s
        Times of flashes on the rig's clock, rising: all that were fired between the first pair and the last one.
    within_s
        Largest offset that is possible, either way.
    """
    require_range("within_s", within_s, low=10 * STEP_S, high=60, unit="s")
    if len(flashes_at_s) == 0 or int(np.count_nonzero(np.diff(lit.astype(np.int8)))) < MIN_CHANGES:
        return None
    steps = round(within_s / STEP_S)
    offsets_s = STEP_S * np.arange(-steps, steps + 1)
    logs = np.array(
        [
            [_log_likelihood(lit, _flashed(pairs_at_s - offset_s, flashes_at_s, exposure_s)) for offset_s in offsets_s]
            for exposure_s in EXPOSURES_S
        ]
    )
    exposure, best = np.unravel_index(int(np.argmax(logs)), logs.shape)
    flashed = _flashed(pairs_at_s - offsets_s[best], flashes_at_s, EXPOSURES_S[exposure])
    if np.mean(lit[lit | flashed] & flashed[lit | flashed]) < MIN_ALIKE:
        return None
    weight = np.exp(logs - logs.max()).sum(axis=0)
    weight /= weight.sum()
    offset_s = float(weight @ offsets_s)
    # Within a step all offsets are equally probable.
    sigma_s = math.sqrt(float(weight @ (offsets_s - offset_s) ** 2) + STEP_S**2 / 12)
    if sigma_s > MAX_SIGMA_S or within_s - abs(offset_s) < 3 * sigma_s:
        return None
    return ClockOffset(offset_s=offset_s, sigma_s=sigma_s)


def _flashed(
    rig_s: Float64[np.ndarray, " pairs"], flashes_at_s: Float64[np.ndarray, " flashes"], exposure_s: float
) -> Bool[np.ndarray, " pairs"]:
    """Return during which exposures, which end at these times of the rig, a flash was fired."""
    until = np.searchsorted(flashes_at_s, rig_s, side="right")
    return np.asarray(until > np.searchsorted(flashes_at_s, rig_s - exposure_s))


def _log_likelihood(lit: Bool[np.ndarray, " pairs"], flashed: Bool[np.ndarray, " pairs"]) -> float:
    """Return the logarithm of the probability of what the pairs show."""
    wrong = int(np.count_nonzero(lit != flashed))
    return wrong * math.log(WRONG_SHARE) + (len(lit) - wrong) * math.log(1 - WRONG_SHARE)
