"""What the receivers of channel data share: the check of the permit, and the frame of one acquisition."""

from __future__ import annotations

from typing import TypeVarTuple

import numpy as np

from markerseek.core import AcquisitionError, ChannelFrame, Clock, FrameHeader, Int16, Permit

Noted = TypeVarTuple("Noted")


def armed_for(permit: Permit, armed: tuple[Permit, *Noted] | None, *, driver: str) -> tuple[Permit, *Noted]:
    """What a receiver noted when it was armed; `AcquisitionError` if that was not for this permit."""
    if armed is None or armed[0] != permit:
        raise AcquisitionError(f"{driver}: it was not armed for the permit {permit.token!r}; arm it before firing")
    return armed


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
