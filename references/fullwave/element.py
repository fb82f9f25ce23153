# ruff: noqa: INP001 -- programs in a folder, no package
"""Points of an element in the grid's frame, and what it hears from the pressures around them.

The frame: the probe's axis of rotation at the origin, x across the array (elevation) and z in depth, so that the
absorber stands at (0, ρ) and it is the element that turns. All angles are then heard in one run.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
import scipy.sparse

REACH = 10  # grid points taken on either side by the interpolation, along every axis
KAISER = 9.0


def face_points(
    *, angle_deg: float, face_radius_m: float, elevation_m: np.ndarray, lateral_m: np.ndarray
) -> np.ndarray:
    """Points (x, z) or, where several lateral places are asked for, (x, y, z) of the face; elevation runs slowest."""
    turned = math.radians(angle_deg)
    x = face_radius_m * math.sin(turned) + elevation_m * math.cos(turned)
    z = face_radius_m * math.cos(turned) - elevation_m * math.sin(turned)
    if lateral_m.size == 0:
        return np.stack([x, z], axis=1)
    count = lateral_m.size
    return np.stack([np.repeat(x, count), np.tile(lateral_m, elevation_m.size), np.repeat(z, count)], axis=1)


def middles(extent_m: float, count: int) -> np.ndarray:
    """Middles of ``count`` equal parts of an extent about 0."""
    return ((np.arange(count) + 0.5) / count - 0.5) * extent_m


def interpolation(
    points_m: np.ndarray, *, origin_m: np.ndarray, step_m: float, shape: tuple[int, ...]
) -> scipy.sparse.csr_array:
    """Matrix (points, grid points) of band-limited interpolation: a sinc under a Kaiser window, axis by axis."""
    place = (points_m - origin_m) / step_m
    low = np.floor(place).astype(np.int64) - REACH + 1
    taps = np.arange(2 * REACH)
    away = place[:, :, np.newaxis] - (low[:, :, np.newaxis] + taps)
    window = np.i0(KAISER * np.sqrt(np.clip(1 - (away / REACH) ** 2, 0, 1))) / np.i0(KAISER)
    weights = np.sinc(away) * window
    if (low < 0).any() or (low + 2 * REACH > np.array(shape)).any():
        message = "a point of the element lies too near the edge of the grid; enlarge the grid"
        raise ValueError(message)
    columns, values = [], []
    for tap in itertools.product(range(2 * REACH), repeat=len(shape)):
        column = np.zeros(len(points_m), dtype=np.int64)
        value = np.ones(len(points_m))
        for axis, t in enumerate(tap):
            column = column * shape[axis] + low[:, axis] + t
            value = value * weights[:, axis, t]
        columns.append(column)
        values.append(value)
    rows = np.tile(np.arange(len(points_m)), len(columns))
    entries = (np.concatenate(values), (rows, np.concatenate(columns)))
    return scipy.sparse.csr_array(entries, shape=(len(points_m), math.prod(shape)))


def focused_mean(
    pressure: np.ndarray, *, elevation_m: np.ndarray, focus_m: float | None, sample_s: float, sound_speed_m_s: float
) -> np.ndarray:
    """Mean over an element of its points' pressures, each earlier by the lens delay sqrt(F² + η²) − F.

    Parameters
    ----------
    pressure
        Pressure by elevation and sample.
    elevation_m
        Elevation η of each row.
    focus_m
        Focus F of the lens; None without a lens.
    sample_s, sound_speed_m_s
        Time between samples and speed of sound.
    """
    samples = pressure.shape[1]
    if focus_m is None:
        return pressure.mean(axis=0)
    padded = 2 * samples
    frequency_hz = np.fft.rfftfreq(padded, sample_s)
    earlier_s = (np.hypot(focus_m, elevation_m) - focus_m) / sound_speed_m_s
    turn = np.exp(2j * np.pi * frequency_hz * earlier_s[:, np.newaxis])
    spectrum = (np.fft.rfft(pressure, padded, axis=1) * turn).mean(axis=0)
    return np.fft.irfft(spectrum, padded)[:samples]
