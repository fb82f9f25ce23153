"""Pose and checksums of one measurement of a bank.

Poses are in the coordinates of IPASC, those of the array at the first measurement: x1 along it from its centre (y
of the TRUS home frame), x3 out of it, and x2 = x3 × x1. The probe turns about an axis parallel to x1, which lies the
face's radius behind the face. Each measurement has two CRC-32: one of its numbers, checked when the bank is opened,
and one that continues it over the ADC counts, checked when the frame is read.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np

from markerseek.core import Float64, Int16


def probe_pose(angle_deg: float, *, first_deg: float, face_radius_m: float) -> Float64[np.ndarray, " 6"]:
    """Position of the array's centre in metres, then its rotation in radians about x1, x2 and x3.

    Parameters
    ----------
    angle_deg, first_deg
        Angle of the measurement and of the first one, in degrees.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres.
    """
    turned = math.radians(angle_deg - first_deg)
    # 1 - cos in a form that keeps small angles exact.
    sinking_m = 2 * face_radius_m * math.sin(turned / 2) ** 2
    return np.array([0.0, -face_radius_m * math.sin(turned), -sinking_m, turned, 0.0, 0.0])


def row_sum(*, angle_deg: float, intensity: float, pulses: int, started_s: float) -> int:
    """CRC-32 of angle, intensity, start (little-endian doubles) and pulses (int64) of one measurement."""
    # NaN has many bit patterns, and HDF5 or NumPy may change one into another.
    floats = (math.nan if math.isnan(each) else each for each in (angle_deg, intensity, started_s))
    return zlib.crc32(struct.pack("<3dq", *floats, pulses))


def frame_sum(samples: Int16[np.ndarray, "channels samples"], *, after: int = 0) -> int:
    """CRC-32 of little-endian ADC counts, channel by channel, continued from the row's; from 0 for a dark frame."""
    return zlib.crc32(np.ascontiguousarray(samples, dtype="<i2").data, after)
