"""Speckle of tissue in B-mode at any angle of the probe.

The scatterers are a complex Gaussian field, drawn for each half degree, and filtered by the pulse in depth and by the
beam along the array. The sum over the angles is weighted by the two-way response of the element, so the speckle changes
with the angle as the beam does.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from markerseek.acoustics import Probe, two_way_elevation
from markerseek.core import Complex128, Float64

SLICE_DEG = 0.5
"""Step of the angles at which the field is drawn, in degrees: a quarter of the beam's width."""

REACH_DEG = 8.0
"""Angle off the plane beyond which scatterers are left out, in degrees: there the beam is at −50 dB."""

PULSE_M, BEAM_M = 0.12e-3, 0.25e-3
"""Standard deviations of pulse (depth) and beam (lateral): FWHM 0.28 and 0.6 mm, as of 6.5 MHz at f-number 2."""

_RESPONSE_STEP_M, _NEAREST_M = 5e-3, 2e-3


class Speckle:
    """Speckle of mean square 1; at an angle it is always the same, whatever the way of the probe.

    ``probe``: height, lens and face radius of its elements. ``radius_m``: distance of each row from the axis of
    rotation.
    """

    def __init__(
        self, probe: Probe, radius_m: Float64[np.ndarray, " rows"], *, columns: int, pixel_m: float, seed: int
    ) -> None:
        self._probe = probe
        self._shape = (len(radius_m), columns)
        self._pixel_m = pixel_m
        # Slices are drawn by their number from the seed: the field does not depend on the way of the probe.
        self._seed = seed
        self._slice = lru_cache(maxsize=64)(self._drawn_slice)
        first_m = max(float(radius_m[0]), probe.face_radius_m + _NEAREST_M)
        count = max(2, math.ceil((radius_m[-1] - first_m) / _RESPONSE_STEP_M))
        # Distances from the axis at which the response is computed; at the face, that of 2 mm before it.
        self._nodes_m = np.linspace(first_m, float(radius_m[-1]), count)
        self._place = np.interp(radius_m, self._nodes_m, np.arange(count))

    def field(self, angle_deg: float) -> Complex128[np.ndarray, "rows columns"]:
        """Speckle with the probe at an angle in degrees."""
        numbers = range(
            math.ceil((angle_deg - REACH_DEG) / SLICE_DEG), math.floor((angle_deg + REACH_DEG) / SLICE_DEG) + 1
        )
        off_deg = angle_deg - SLICE_DEG * np.array(numbers)
        weights = np.array([elevation_response(self._probe, radius_m, off_deg) for radius_m in self._nodes_m])
        # Between nodes in depth the weights are mixed linearly.
        low = np.minimum(self._place.astype(int), len(weights) - 2)
        share = (self._place - low)[:, None]
        by_row = (1 - share) * weights[low] + share * weights[low + 1]
        by_row /= np.sqrt(np.sum(by_row**2, axis=1, keepdims=True))
        field = np.zeros(self._shape, np.complex128)
        for column, number in enumerate(numbers):
            field += by_row[:, column, None] * self._slice(number)
        return field

    def _drawn_slice(self, number: int) -> Complex128[np.ndarray, "rows columns"]:
        rng = np.random.Generator(np.random.PCG64([self._seed, number % 2**32]))
        return filtered_noise(rng, self._shape, pixel_m=self._pixel_m)


def elevation_response(
    probe: Probe, radius_m: float, off_deg: Float64[np.ndarray, " angles"]
) -> Float64[np.ndarray, " angles"]:
    """`two_way_elevation`, tabulated by tenths of a degree: the exact response takes a millisecond an angle."""
    return np.asarray(np.interp(np.abs(off_deg), _TABLE_DEG, _tabulated(probe, radius_m), right=0.0))


_TABLE_DEG = np.arange(0, REACH_DEG + 4.05, 0.1)


@lru_cache(maxsize=256)
def _tabulated(probe: Probe, radius_m: float) -> Float64[np.ndarray, " angles"]:
    return two_way_elevation(probe, radius_m=radius_m, off_plane_deg=_TABLE_DEG)


def filtered_noise(
    rng: np.random.Generator, shape: tuple[int, int], *, pixel_m: float
) -> Complex128[np.ndarray, "rows columns"]:
    """Complex Gaussian noise of mean square 1 under pulse and beam."""
    # Imported here: a search of channel data does not need it.
    from scipy.ndimage import gaussian_filter

    parts = rng.standard_normal((*shape, 2))
    white = np.asarray(parts[..., 0] + 1j * parts[..., 1]) / math.sqrt(2)
    sigma = (PULSE_M / pixel_m, BEAM_M / pixel_m)
    filtered = gaussian_filter(white, sigma, mode="wrap")
    # A discrete Gaussian of standard deviation s keeps 1/(2 s sqrt(pi)) of the power of white noise.
    kept = np.prod([_power_kept(each) for each in sigma])
    return np.asarray(filtered / math.sqrt(float(kept)))


@lru_cache(maxsize=16)
def _power_kept(sigma: float) -> float:
    from scipy.ndimage import gaussian_filter1d

    impulse = np.zeros(129)
    impulse[64] = 1.0
    return float(np.sum(gaussian_filter1d(impulse, sigma) ** 2))
