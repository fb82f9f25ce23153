"""Check that the waves of a calibration scan hold the delays from which the face radius follows.

Sound from off the image plane takes a longer way, because the array's face lies at a distance from the axis of
rotation. Frames that were aligned, scaled or copied from one angle to another have no such delay, and the fit alone
would still return numbers.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import hilbert

from markerseek.calibration.elevation import MIN_FACE_M, Geometry, SourceWaves
from markerseek.core import Float64, SearchError

MIN_SHARE = 0.5
"""Least delay of the waves' middles over that of the fitted geometry; on simulated scans it is 1.6 to 5.

It is more than 1 because the sound off the plane is also spread over the height of the elements, to later times.
"""

_SIGNIFICANT = 0.05
"""Power over a wave's largest below which a sample counts as noise."""


def require_delays(waves: SourceWaves, geometry: Geometry) -> None:
    """Refuse a fit of waves that do not arrive later off the image plane."""
    predicted_s = _path_delay_s(waves.angle_deg, geometry)
    measured_s = waves.arrival_s + _middle_s(waves)
    # Weighted least squares of the measured times on the predicted delay: the weaker waves scatter more.
    weight = np.abs(waves.wave).max(axis=1)
    slope = float(np.polyfit(predicted_s, measured_s, 1, w=weight)[0])
    if not slope >= MIN_SHARE:
        span_ns = 1e9 * float(np.ptp(predicted_s))
        raise SearchError(
            f"off the image plane the sound arrives {slope * span_ns:.0f} ns later, {span_ns:.0f} ns or more are "
            "expected of a probe that turns about its axis: these frames do not hold the delays from which face radius "
            "and trigger offset follow; calibrate with the channel data as they were recorded at each angle, not "
            "aligned, scaled or copied"
        )
    low_m, _ = geometry.face_radius_m.interval95
    if not low_m > MIN_FACE_M:
        raise SearchError(
            f"the face radius is {1e3 * geometry.face_radius_m.value:.1f} mm or less, which this scan does not "
            "determine; scan one small source from 12 deg below it to 12 deg above, in steps of at most 1 deg"
        )


def _path_delay_s(angle_deg: Float64[np.ndarray, " frames"], geometry: Geometry) -> Float64[np.ndarray, " frames"]:
    """Delay of the way from the source to the face, over that in the image plane, in seconds."""
    radius_m, face_m = geometry.source_radius_m.value, geometry.face_radius_m.value
    turn = np.radians(angle_deg - geometry.source_deg.value)
    path_m = np.hypot(radius_m * np.sin(turn), radius_m * np.cos(turn) - face_m)
    return np.asarray((path_m - (radius_m - face_m)) / geometry.sound_speed_m_s.value)


def _middle_s(waves: SourceWaves) -> Float64[np.ndarray, " frames"]:
    """Middle of the power of each wave within its window, in seconds."""
    power = np.abs(hilbert(waves.wave, axis=1)) ** 2
    power = np.where(power > _SIGNIFICANT * power.max(axis=1, keepdims=True), power, 0.0)
    return np.asarray(power @ waves.time_s / power.sum(axis=1))
