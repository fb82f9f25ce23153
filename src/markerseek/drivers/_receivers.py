"""What the receivers of channel data share: a key of their settings, and the frame of one acquisition."""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import ChannelFrame, Clock, ConfigError, FrameHeader, Int16, Permit


def require_noise_ratio(noise_ratio: float) -> None:
    """Refuse a factor for the noise of a frame that is not finite or not above 1."""
    if not 1 < noise_ratio < math.inf:
        raise ConfigError(f"receiver: noise_ratio is {noise_ratio}, it must be a finite factor above 1")


def acquired_frame(
    samples: Int16[np.ndarray, "channels samples"],
    permit: Permit,
    *,
    sequence: int,
    pulses: int,
    started_s: float,
    clock: Clock,
    sampling_hz: float,
    energy: float | None = None,
) -> ChannelFrame:
    """Channel data as the frame of a permit; the acquisition ends now."""
    header = FrameHeader(
        sequence=sequence,
        token=permit.token,
        pulses=pulses,
        commanded_deg=permit.angle_deg,
        started_s=started_s,
        ended_s=clock.now_s(),
        energy=energy,
    )
    return ChannelFrame(header=header, samples=samples, sampling_hz=sampling_hz)
