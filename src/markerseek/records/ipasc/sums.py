"""CRC-32 of each measurement of a bank, so that a damaged one is noticed and not searched.

There are two of each: one of the numbers, which is checked whenever the bank is opened, and one that goes on over the
ADC counts, which is checked whenever that frame is read.
"""

from __future__ import annotations

import math
import struct
import zlib

import numpy as np

from markerseek.core.shapes import Int16


def row_sum(*, angle_deg: float, intensity: float, pulses: int, started_s: float) -> int:
    """CRC-32 of the numbers of one measurement, little-endian: three of 64 bits, pulses a whole one; any NaN is one."""
    floats = (math.nan if math.isnan(each) else each for each in (angle_deg, intensity, started_s))
    return zlib.crc32(struct.pack("<3dq", *floats, pulses))


def frame_sum(samples: Int16[np.ndarray, "channels samples"], *, after: int = 0) -> int:
    """CRC-32 of ADC counts, channel by channel, little-endian, going on after that of the row; after 0 in the dark."""
    return zlib.crc32(np.ascontiguousarray(samples, dtype="<i2").data, after)
