"""Brings IQ data back to radio frequency, which imaging needs: I and Q are the signal mixed down by a carrier.

With z(t) the complex samples, taken at a lower rate, and f the carrier, the signal is Re z(t) exp(2πi f t).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from markerseek.core import Float32, Float64, RecordError
from markerseek.records.banks.table_format import AXES
from markerseek.records.notes import note

CARRIERS = ("demodulation_frequency", "demodulation_hz")
"""Names of the carrier, in hertz."""

_PER_PERIOD = 5.5
"""Fewest samples in a period of the carrier, between which the beamformer interpolates: 40 MHz at 7 MHz."""

_CARRIER_HZ = (0.1e6, 100e6)
"""Range of carriers of ultrasound; 0 says that nothing was mixed down."""


def is_paired(frames: np.ndarray) -> bool:
    """Return whether I and Q are pairs along an axis behind those of frames."""
    return frames.ndim == len(AXES) + 1 and frames.shape[-1] == 2


def paired(frames: np.ndarray) -> np.ndarray:
    """Return the frames as complex numbers where I and Q are pairs along a fourth axis; others as they are."""
    return frames[..., 0] + 1j * frames[..., 1] if is_paired(frames) else frames


def carrier_of(path: Path, arrays: Mapping[str, np.ndarray], frames: np.ndarray, *, ordered: bool) -> float | None:
    """Return the carrier that a file states, in hertz; None if it states none.

    ``ordered``: whether the format says by itself which of its frames are IQ data, and states a carrier also of others.
    """
    name = next((each for each in CARRIERS if each in arrays), None)
    if name is None:
        return None
    values = arrays[name].ravel()
    low, high = _CARRIER_HZ
    carrier_hz = float(values[0]) if values.size == 1 and values.dtype.kind in "iuf" else math.nan
    if not (carrier_hz == 0 or low <= carrier_hz <= high):
        raise RecordError(
            f"{path}: {name} is {values[:4].tolist()}, it must be one number in Hz, {low:g} to {high:g}, or 0 where "
            "nothing was mixed down"
        )
    if frames.dtype.kind == "c":
        return carrier_hz
    if not ordered and carrier_hz:
        raise RecordError(
            f"{path}: it states {name}, {carrier_hz:g} Hz, as of IQ data, and its frames are real numbers; save them "
            "as complex numbers, or as pairs along a last axis of 2; or leave it out, if they are of radio frequency"
        )
    return None


def radio_frequency(
    path: Path, frames: np.ndarray, *, carrier_hz: float, sampling_hz: float | None
) -> tuple[Float32[np.ndarray, "angles channels finer"], float]:
    """Return the signals of IQ data, and their sampling frequency, which is a multiple of that of the data.

    ``frames``: complex numbers, (angles, channels, samples).
    """
    # Half a second, which no search needs.
    from scipy.signal import resample

    if sampling_hz is None:
        raise RecordError(
            f"{path}: its frames are IQ data, and sampling_hz is missing; add the rate of the pairs, in Hz"
        )
    finer = max(1, math.ceil(_PER_PERIOD * carrier_hz / sampling_hz))
    samples = frames.shape[2]
    turns = carrier_hz / (finer * sampling_hz) * np.arange(finer * samples)
    carrier = np.exp(2j * np.pi * (turns % 1))
    signals = np.empty((*frames.shape[:2], finer * samples), np.float32)
    for signal, frame in zip(signals, frames, strict=True):
        signal[:] = (resample(frame, finer * samples, axis=1) * carrier).real
    return signals, finer * sampling_hz


def envelope_peaks(path: Path, frames: np.ndarray) -> Float64[np.ndarray, " angles"]:
    """Return the intensities of IQ data without a known carrier: the mean of the channels' largest magnitudes."""
    note(
        path,
        f"its frames are IQ data, and {CARRIERS[0]} is missing, without which there is no image: the intensity at an "
        "angle is the mean over the channels of the envelope's peak; add the carrier, in Hz",
    )
    return np.asarray(np.abs(frames).max(axis=2).mean(axis=1), dtype=np.float64)
