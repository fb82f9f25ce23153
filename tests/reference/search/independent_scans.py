"""Scans by a forward model that shares nothing with the package's: point sources in closed form, in NumPy alone.

Each source is a point that sends a Gaussian-modulated pulse; an element receives it after r/c, weakened by 1/r and by
a weight of the angle between probe and source, a squared Lorentzian or a squared sinc. Tables of two peaks are here
too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

ELEMENTS = 64
PITCH_M = 0.3e-3
SAMPLING_HZ = 40e6
SAMPLES = 700
SPEED_M_S = 1540.0
FACE_RADIUS_M = 10e-3
ANGLES_DEG = np.arange(-35.0, 36.0)
FULL_SCALE = 2047

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Scan:
    """A scan of one marker with clutter."""

    marker_deg: float
    clutter_deg: tuple[float, ...]
    """Angles of the clutter, the loudest first."""
    frames: npt.NDArray[np.int16]
    """Channel data, (angle, element, sample)."""

    def write(self, path: Path) -> None:
        """Write it as arrays of NumPy, for ``markerseek bank import``."""
        np.savez(
            path,
            angle_deg=ANGLES_DEG,
            frames=self.frames,
            sampling_hz=SAMPLING_HZ,
            pitch_m=PITCH_M,
            sound_speed_m_s=SPEED_M_S,
        )


def scan_of(seed: int, *, clutter: int | None = None) -> Scan:
    """One marker, and as many sources of clutter (None: 4 to 12) that are 15 to 30 dB weaker, anywhere."""
    rng = np.random.default_rng([45, seed])
    marker_deg = rng.uniform(-28.0, 28.0)
    count = int(rng.integers(4, 13)) if clutter is None else clutter
    clutter_db = np.sort(rng.uniform(15.0, 30.0, count))
    angle_deg = np.array([marker_deg, *rng.uniform(-40.0, 40.0, count)])
    height = np.array([1.0, *10 ** (-clutter_db / 20)])
    lateral_m = rng.uniform(-7e-3, 7e-3, count + 1)
    depth_m = np.array([rng.uniform(10e-3, 20e-3), *rng.uniform(7e-3, 23e-3, count)])
    width_deg = rng.uniform(4.0, 10.0, count + 1)
    lorentzian = rng.random(count + 1) < 0.5
    centre_hz = rng.uniform(6e6, 7.5e6)
    cycles = rng.uniform(1.0, 2.0)
    noise = rng.uniform(0.7, 3.0)
    peak = rng.uniform(800.0, 1900.0)

    element_m = (np.arange(ELEMENTS) - (ELEMENTS - 1) / 2) * PITCH_M
    # Twice as long as is kept, so that no pulse ends beyond it.
    sound = np.zeros((ANGLES_DEG.size, ELEMENTS, 2 * SAMPLES))
    for k in range(count + 1):
        away = np.radians(ANGLES_DEG - angle_deg[k])
        from_axis_m = FACE_RADIUS_M + depth_m[k]
        in_plane_m2 = FACE_RADIUS_M**2 + from_axis_m**2 - 2 * FACE_RADIUS_M * from_axis_m * np.cos(away)
        range_m = np.sqrt(in_plane_m2[:, None] + (element_m - lateral_m[k]) ** 2)
        weight = height[k] * elevation(np.degrees(away), fwhm_deg=width_deg[k], lorentzian=bool(lorentzian[k]))
        # The pulse is over some 7 standard deviations from its middle.
        at = np.rint(range_m / SPEED_M_S * SAMPLING_HZ).astype(np.int64)[:, :, None] + np.arange(-40, 41)
        late_s = at / SAMPLING_HZ - (range_m / SPEED_M_S)[:, :, None]
        pulse = np.cos(2 * np.pi * centre_hz * late_s) * np.exp(-0.5 * (late_s * centre_hz / (cycles / 2.355)) ** 2)
        pulse *= (weight[:, None] * depth_m[k] / range_m)[:, :, None]
        held = np.take_along_axis(sound, at, axis=2)
        np.put_along_axis(sound, at, held + pulse, axis=2)
    # The marker alone fills the converter to its peak; energy of the laser and electronic noise are of each frame.
    sound = sound[:, :, :SAMPLES] * peak * rng.normal(1.0, 0.01, ANGLES_DEG.size)[:, None, None]
    sound += noise * rng.normal(size=sound.shape)
    counts = np.clip(np.rint(sound), -FULL_SCALE - 1, FULL_SCALE).astype(np.int16)
    return Scan(marker_deg=float(marker_deg), clutter_deg=tuple(float(each) for each in angle_deg[1:]), frames=counts)


def elevation(away_deg: Floats, *, fwhm_deg: float, lorentzian: bool) -> Floats:
    """Weight of a source at angles from the probe's plane, 1 at its top."""
    x = 2 * away_deg / fwhm_deg
    if lorentzian:
        return np.asarray((1 + (np.sqrt(2) - 1) * x**2) ** -2.0)
    # sinc² of 0.443 is a half.
    return np.asarray(np.sinc(0.4429 * x) ** 2)


@dataclass(frozen=True, kw_only=True)
class TwoPeaks:
    """A table of intensities with two peaks."""

    stronger_deg: float
    weaker_deg: float
    intensities: Floats

    def write(self, path: Path) -> None:
        """Write it as a table for ``markerseek replay``."""
        rows = np.column_stack([TWO_PEAKS_ANGLES_DEG, self.intensities])
        np.savetxt(path, rows, delimiter=",", header="angle_deg,intensity", comments="", fmt="%.6f")


TWO_PEAKS_ANGLES_DEG = np.linspace(-35.0, 35.0, 141)


def two_peaks_of(seed: int, *, apart_deg: float | None = None, relative: float | None = None) -> TwoPeaks:
    """Two Gaussian peaks of σ 2°, 6 to 12° apart, the weaker 0.8 to 1 times as high, with noise of 0.8 %."""
    rng = np.random.default_rng([46, seed])
    apart_deg = rng.uniform(6.0, 12.0) if apart_deg is None else apart_deg
    relative = rng.uniform(0.8, 1.0) if relative is None else relative
    middle_deg = rng.uniform(-22.0, 22.0)
    side = rng.choice([-1.0, 1.0])
    stronger_deg = middle_deg - side * apart_deg / 2
    weaker_deg = middle_deg + side * apart_deg / 2
    height = np.exp(-0.5 * ((TWO_PEAKS_ANGLES_DEG - stronger_deg) / 2) ** 2)
    height += relative * np.exp(-0.5 * ((TWO_PEAKS_ANGLES_DEG - weaker_deg) / 2) ** 2)
    intensities = np.abs(height + 0.008 * rng.normal(size=height.size))
    return TwoPeaks(stronger_deg=float(stronger_deg), weaker_deg=float(weaker_deg), intensities=100 * intensities)
