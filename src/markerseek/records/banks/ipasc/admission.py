"""Checks an acquisition before it is written, so that every written bank can be read again."""

from __future__ import annotations

import math
from collections.abc import Container
from pathlib import Path

from markerseek.core import ChannelFrame, RecordError, Sample
from markerseek.records.banks.bank import MOST_DEG
from markerseek.records.banks.ipasc.layout import Layout


def require_keepable(path: Path, sample: Sample, *, layout: Layout | None, angles_deg: Container[float]) -> None:
    """Refuse an acquisition that a bank cannot hold.

    Parameters
    ----------
    path
        The bank, for the message.
    sample
        The acquisition.
    layout
        Layout of the file; None before the first acquisition.
    angles_deg
        Angles written so far, in degrees.

    Raises
    ------
    RecordError
        If it differs in shape or rate from those before, or has an angle or intensity that no bank can hold.
    """
    if layout is not None:
        _require_same(path, sample, layout)
    if sample.dark:
        return
    if not abs(sample.angle_deg) <= MOST_DEG:
        raise RecordError(
            f"{path}: the angle is {sample.angle_deg:g} deg, it must be finite and within one turn, -{MOST_DEG:g} to "
            f"{MOST_DEG:g} deg; leave that acquisition out"
        )
    if sample.angle_deg in angles_deg:
        raise RecordError(f"{path}: the angle {sample.angle_deg:g} deg appears twice; keep one of them")
    intensity = sample.reading.intensity
    # NaN beside a frame is allowed, because the intensity can be computed from it later.
    if not (0 <= intensity < math.inf or (math.isnan(intensity) and isinstance(sample.frame, ChannelFrame))):
        raise RecordError(
            f"{path}: the intensity at {sample.angle_deg:g} deg is {intensity:g}, it must be finite and not negative, "
            "or NaN beside a frame; leave that acquisition out"
        )


def _require_same(path: Path, sample: Sample, layout: Layout) -> None:
    frame = sample.frame if isinstance(sample.frame, ChannelFrame) else None
    shape = (0, 0) if frame is None else frame.samples.shape
    if shape != layout.shape:
        raise RecordError(
            f"{path}: a frame of {shape} follows frames of {layout.shape} (channels, samples); "
            "keep one probe and one record length in a bank"
        )
    if frame is not None and frame.sampling_hz != layout.sampling_hz:
        raise RecordError(
            f"{path}: a frame sampled at {frame.sampling_hz:g} Hz follows one at {layout.sampling_hz:g} Hz; "
            "keep one rate in a bank"
        )
