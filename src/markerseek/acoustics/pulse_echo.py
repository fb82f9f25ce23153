"""Elevation response of pulse-echo: the element's one-way response, once for transmission and once for reception."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy.fft
from msgspec import structs

from markerseek.acoustics.forward import AcousticModel
from markerseek.acoustics.medium import Medium
from markerseek.acoustics.receiver import Probe
from markerseek.acoustics.source import Absorber, GaussianAbsorber, RectanglePulse
from markerseek.core import Complex128, Float64, LinearArray

_SOURCE = GaussianAbsorber(radius_m=0.02e-3)
_LASER = RectanglePulse(duration_s=10e-9)
"""A source whose pulse is far shorter than the element's band allows, so that its spectrum can be divided out."""

_SAMPLING_HZ = 40e6
_SAMPLES = 4096

_MIN_GAIN = 1e-2
"""Receive gain below which a frequency is left out: twice passed, it is at −80 dB."""


def two_way_elevation(
    probe: Probe, *, radius_m: float, off_plane_deg: Float64[np.ndarray, " angles"]
) -> Float64[np.ndarray, " angles"]:
    """Return the peak of the echo of a point over its angle to the image plane, relative to that in the plane.

    The spectrum of one element's signal of a point source is B·S·H: its band, the source's pulse, and the mean over the
    element's height with the lens. An echo has B²·H², which is the square of the signal over that of the source's
    pulse. Behind the face's plane, where the probe's body hides a point, the echo is 0.

    ``probe``: height, lens and face radius of the element. ``radius_m``: distance of the point from the axis of
    rotation. ``off_plane_deg``: angles between the image plane and the point.
    """
    angles = np.abs(off_plane_deg)
    peaks = np.array([_echo_peak(probe, radius_m, float(angle)) for angle in angles])
    return peaks / _echo_peak(probe, radius_m, 0.0)


@lru_cache(maxsize=4096)
def _echo_peak(probe: Probe, radius_m: float, off_plane_deg: float) -> float:
    # Two elements are the fewest of an array; the point lies in front of the first, and only its signal is used.
    array = LinearArray(elements=2, pitch_m=probe.array.pitch_m)
    model = AcousticModel(
        probe=structs.replace(probe, array=array),
        medium=Medium(attenuation_db_cm_mhz=0.0),
        laser=_LASER,
        sampling_hz=_SAMPLING_HZ,
        samples=_SAMPLES,
    )
    point = Absorber(radius_m=radius_m, angle_deg=0.0, lateral_m=float(array.lateral_m[0]), source=_SOURCE)
    signal = model.channel_data([point], angle_deg=off_plane_deg)[0].astype(np.float64)
    frequency_hz = scipy.fft.rfftfreq(_SAMPLES, 1 / _SAMPLING_HZ)
    sent: Complex128[np.ndarray, " frequencies"] = _SOURCE.spectrum(
        frequency_hz, sound_speed_m_s=model.medium.sound_speed_m_s
    ) * _LASER.spectrum(frequency_hz)
    used = model.band.gain(frequency_hz) >= _MIN_GAIN
    echo = np.zeros(8 * _SAMPLES, np.complex128)
    # Only positive frequencies: the inverse transform is the analytic signal, whose magnitude is the envelope. Twice
    # the travel time may wrap around the end of the record, which moves the pulse and leaves its height.
    echo[: frequency_hz.size][used] = (scipy.fft.rfft(signal)[used] / sent[used]) ** 2
    return float(np.abs(scipy.fft.ifft(echo)).max())
