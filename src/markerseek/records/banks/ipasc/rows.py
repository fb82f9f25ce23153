"""What is written of one measurement of a bank: checks before it is written, pose, and checksums.

Poses are in the coordinates of IPASC, those of the array at the first measurement: x1 along it from its centre (y
of the TRUS home frame), x3 out of it, and x2 = x3 × x1. The probe turns about an axis parallel to x1, which lies the
face's radius behind the face. Each measurement has two CRC-32: one of its numbers, checked when the bank is opened,
and one that continues it over the ADC counts, checked when the frame is read.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Container
from pathlib import Path

import numpy as np

from markerseek.core import ChannelFrame, Float64, Int16, RecordError, Sample
from markerseek.records.banks.bank import MAX_DEG
from markerseek.records.banks.ipasc import fields


def probe_pose(angle_deg: float, *, first_deg: float, face_radius_m: float) -> Float64[np.ndarray, " 6"]:
    """Position of the array's centre in metres, then its rotation in radians about x1, x2 and x3.

    ``face_radius_m``: distance of the array's face from the axis of rotation.
    """
    turned = math.radians(angle_deg - first_deg)
    # 1 - cos in a form that keeps small angles exact.
    sinking_m = 2 * face_radius_m * math.sin(turned / 2) ** 2
    return np.array([0.0, -face_radius_m * math.sin(turned), -sinking_m, turned, 0.0, 0.0])


def row_sum(*, angle_deg: float, intensity: float, pulses: int, started_s: float, energy: float) -> int:
    """CRC-32 of angle, intensity, start (little-endian doubles), pulses (int64), and of an energy that is not NaN."""
    # NaN has many bit patterns, and HDF5 or NumPy may change one into another.
    floats = (math.nan if math.isnan(each) else each for each in (angle_deg, intensity, started_s))
    summed = zlib.crc32(struct.pack("<3dq", *floats, pulses))
    return summed if math.isnan(energy) else zlib.crc32(struct.pack("<d", energy), summed)


def frame_sum(samples: Int16[np.ndarray, "channels samples"], *, after: int = 0) -> int:
    """CRC-32 of little-endian ADC counts, channel by channel, continued from the row's; from 0 for a dark frame."""
    return zlib.crc32(np.ascontiguousarray(samples, dtype="<i2").data, after)


def require_keepable(path: Path, sample: Sample, *, layout: fields.Layout | None, angles_deg: Container[float]) -> None:
    """Refuse an acquisition that a bank cannot hold.

    ``path``: the bank, for the message. ``layout``: None before the first acquisition. ``angles_deg``: angles written
    so far.
    """
    if layout is not None:
        _require_same(path, sample, layout)
    if sample.dark:
        return
    if not abs(sample.angle_deg) <= MAX_DEG:
        raise RecordError(
            f"{path}: the angle is {sample.angle_deg:g} deg, it must be finite and within one turn, -{MAX_DEG:g} to "
            f"{MAX_DEG:g} deg; leave that acquisition out"
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


def _require_same(path: Path, sample: Sample, layout: fields.Layout) -> None:
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
