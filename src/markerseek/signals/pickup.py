"""What is in the channels beside sound: the converter's limit, and what the laser's pulse leaves at the trigger.

The pick-up comes before any sound can. Electrical or optical, it is as high as the pulse is strong, in all channels at
once.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import AcquisitionError, Bool, ChannelFrame, ConfigError, Int32

_REPEATED = 3
"""Samples of a record at its largest number that show a limit: three agree by chance in a few counts' height only."""


def clipped(
    magnitude: Int32[np.ndarray, "channels samples"], *, full_scale: int, recorded: bool
) -> Bool[np.ndarray, " channels"]:
    """Return which of some records, given as magnitudes, have touched full scale.

    ``recorded``: they may be of another converter than that of ``full_scale``. Numbers beyond it show that; they are
    its limit where the largest of them repeats.
    """
    largest = magnitude.max(axis=1, initial=0)
    touching: Bool[np.ndarray, " channels"] = largest >= full_scale
    if recorded:
        # The most negative number of a converter is one larger.
        repeated = (magnitude == largest[:, None]).sum(axis=1) >= _REPEATED
        touching &= (largest <= full_scale + 1) | repeated
    return touching


REST_SAMPLES = 256
"""Last samples of a frame, which give the zero and the noise of each channel: the deepest have the least signal."""


def pickup_amplitude(
    frame: ChannelFrame, *, window_us: tuple[float, float], full_scale: int, recorded: bool = False
) -> float:
    """Return the root mean square of a window over all channels in counts, less the zero of each and its noise.

    ``window_us``: first and last moment after the trigger, in microseconds. ``full_scale``: counts at which the
    converter clips. ``recorded``: as of `clipped`. Raises `AcquisitionError` if the pick-up is clipped, `ConfigError`
    if the window is not in the frame.
    """
    first, last = (round(1e-6 * end_us * frame.sampling_hz) for end_us in window_us)
    samples = frame.samples.shape[1]
    if not 0 <= first <= last < samples - REST_SAMPLES:
        raise ConfigError(
            f"laser: pickup_us is {list(window_us)} us, samples {first} to {last}; it must lie between the trigger and "
            f"the last {REST_SAMPLES} of the frame's {samples} samples"
        )
    window = frame.samples[:, first : last + 1].astype(np.float64)
    magnitude = np.abs(window).astype(np.int32)
    if clipped(magnitude, full_scale=full_scale, recorded=recorded).any():
        raise AcquisitionError(
            f"laser: the pick-up reaches {magnitude.max()} counts and the converter clips at {full_scale}, so that it "
            "does not show the energy; choose a window (pickup_us) in which it does not, or a lower gain"
        )
    rest = frame.samples[:, -REST_SAMPLES:].astype(np.float64)
    zero = rest.mean(axis=1, keepdims=True)
    # E[x²] = a² + sigma² in the window, and sigma² in the rest.
    power = float(np.square(window - zero).mean()) - float(np.square(rest - zero).mean())
    return math.sqrt(max(power, 0.0))
