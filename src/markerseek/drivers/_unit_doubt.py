"""The unit or sign of a stage's readings that explains why they are not what was asked."""

from __future__ import annotations

import math

_SCALES = (
    (1.0, ""),
    (math.pi / 180, "one of read() and go() is in radians"),
    (180 / math.pi, "go() is in radians"),
    (1000 * math.pi / 180, "read() is in mrad"),
    (1000.0, "one of read() and go() is in thousandths of a degree"),
    (1e-3, "one of read() and go() is in thousands of degrees"),
    (60.0, "read() is in arcminutes"),
    (3600.0, "read() is in arcseconds"),
    (1 / 360, "read() is in turns"),
)
"""Ratios of a reading to what was asked, and the unit that explains each."""

_SAME_SCALE = 0.02
"""Share by which a ratio may differ from that of a unit."""


def unit_doubt(asked_deg: float, reading_deg: float) -> str:
    """Return the end of an error: the unit or sign that explains why a stage reads another angle than was asked."""
    ratio = reading_deg / asked_deg if asked_deg else 0.0
    for scale, unit in _SCALES:
        if ratio and abs(abs(ratio) / scale - 1) <= _SAME_SCALE and not (ratio > 0 and scale == 1):
            times = f"{scale:.4g}" if scale >= 1 else f"1/{1 / scale:.4g}"
            whys = [unit, "the signs of read() and go() differ" if ratio < 0 else ""]
            why = " and ".join(filter(None, whys))
            return f"; the reading is {'-' if ratio < 0 else ''}{times} x what was asked: {why}"
    return ""
