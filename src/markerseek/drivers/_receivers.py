"""The frame of one acquisition, as the receivers of channel data make it."""

from __future__ import annotations

import numpy as np

from markerseek.core import ChannelFrame, Clock, FrameHeader, Int16, Permit


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
        commanded_deg=permit.commanded_deg,
        started_s=started_s,
        ended_s=clock.now_s(),
        energy=energy,
    )
    return ChannelFrame(header=header, samples=samples, sampling_hz=sampling_hz)
