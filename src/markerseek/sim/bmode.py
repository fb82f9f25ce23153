"""Simulated B-mode: an instrument's tip pressed on tissue over a gel pad, seen from below by the probe.

Three layers lie over the probe: pad, tissue, air, with speckle: the scatterers are a complex Gaussian field, drawn for
each half degree, and filtered by the pulse in depth and by the beam along the array. The sum over the angles is
weighted by the two-way response of the element, so the speckle changes with the angle as the beam does. The tip is an
echo of the size of its face, with the same weight. Not simulated: shadows, attenuation, multiple scattering, the
doublet of a pulse far off the plane, roughness of the tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated

import numpy as np

from markerseek.acoustics import Probe, two_way_elevation
from markerseek.core import (
    Complex128,
    ConfigError,
    Float64,
    ScanGeometry,
    UInt8,
    Within,
    require_fields,
    require_range,
)

SLICE_DEG = 0.5
"""Step of the angles at which the field is drawn, in degrees: a quarter of the beam's width."""

_REACH_DEG = 8.0
"""Angle off the plane beyond which scatterers are left out, in degrees: there the beam is at −50 dB."""

PULSE_M = 0.12e-3
BEAM_M = 0.25e-3
"""Standard deviations of pulse (depth) and beam (lateral): FWHM 0.28 and 0.6 mm, as of 6.5 MHz at f-number 2."""

_RESPONSE_STEP_M = 5e-3
_NEAREST_M = 2e-3


class Speckle:
    """Speckle of mean square 1; at an angle it is always the same, whatever the path of the probe.

    ``probe``: height, lens and face radius of its elements. ``radius_m``: distance of each row from the axis of
    rotation.
    """

    def __init__(
        self, probe: Probe, radius_m: Float64[np.ndarray, " rows"], *, columns: int, pixel_m: float, seed: int
    ) -> None:
        self._probe = probe
        self._shape = (len(radius_m), columns)
        self._pixel_m = pixel_m
        # Slices are drawn by their number from the seed: the field does not depend on the path of the probe.
        self._seed = seed
        self._slice = lru_cache(maxsize=64)(self._drawn_slice)
        first_m = max(float(radius_m[0]), probe.face_radius_m + _NEAREST_M)
        count = max(2, math.ceil((radius_m[-1] - first_m) / _RESPONSE_STEP_M))
        # Distances from the axis at which the response is computed; at the face, that of 2 mm before it.
        self._nodes_m = np.linspace(first_m, float(radius_m[-1]), count)
        self._place = np.interp(radius_m, self._nodes_m, np.arange(count))

    def field(self, angle_deg: float) -> Complex128[np.ndarray, "rows columns"]:
        """Return the speckle with the probe at an angle in degrees."""
        numbers = range(
            math.ceil((angle_deg - _REACH_DEG) / SLICE_DEG), math.floor((angle_deg + _REACH_DEG) / SLICE_DEG) + 1
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


_TABLE_DEG = np.arange(0, _REACH_DEG + 4.05, 0.1)


@lru_cache(maxsize=256)
def _tabulated(probe: Probe, radius_m: float) -> Float64[np.ndarray, " angles"]:
    return two_way_elevation(probe, radius_m=radius_m, off_plane_deg=_TABLE_DEG)


def filtered_noise(
    rng: np.random.Generator, shape: tuple[int, int], *, pixel_m: float
) -> Complex128[np.ndarray, "rows columns"]:
    """Return the complex Gaussian noise of mean square 1 under pulse and beam."""
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


@dataclass(frozen=True, slots=True, kw_only=True)
class BModeSettings:
    """A simulated B-mode image and its scene; the strengths of the paper's echoes are unknown, and parameters here."""

    tip_m: Annotated[float, Within(0.5e-3, 20e-3, "m")] = 5e-3
    """Diameter of the tip."""
    tip_db: Annotated[float, Within(-120, 120, "dB")] = 30.0
    """Echo of the tip in the image plane over the mean of the tissue."""
    pressed_m: Annotated[float, Within(0, 20e-3, "m")] = 2.5e-3
    """How deep the tip's middle lies below the surface of the tissue."""
    tissue_m: Annotated[float, Within(1e-3, 60e-3, "m")] = 15e-3
    """Thickness of the tissue; the pad below it reaches down to the probe."""
    pad_db: Annotated[float, Within(-120, 120, "dB")] = -30.0
    air_db: Annotated[float, Within(-120, 120, "dB")] = -35.0
    surface_db: Annotated[float, Within(-120, 120, "dB")] = 8.0
    """``pad_db``, ``air_db`` and ``surface_db``: echo of the pad, of the region beyond the tissue, and of its surface,
    over the mean of the tissue."""
    noise_db: Annotated[float, Within(-120, 120, "dB")] = -35.0
    """Noise of the receiver in one image over the mean of the tissue."""
    white_db: Annotated[float, Within(-120, 120, "dB")] = 38.0
    """Level that is shown white, over the mean of the tissue."""
    dynamic_range_db: Annotated[float, Within(20, 120, "dB")] = 60.0
    """From black to white."""
    pixel_m: Annotated[float, Within(0.05e-3, 1e-3, "m")] = 0.15e-3
    half_width_m: Annotated[float, Within(2e-3, 60e-3, "m")] = 20e-3
    """Half the width of the image."""
    first_depth_m: Annotated[float, Within(0, 0.2, "m")] = 27e-3
    last_depth_m: float = 62e-3

    def __post_init__(self) -> None:
        require_fields(self, "b_mode")
        require_range("b_mode: last_depth_m", self.last_depth_m, low=self.first_depth_m + 5e-3, high=0.3, unit="m")

    @property
    def geometry(self) -> ScanGeometry:
        """Where the pixels are."""
        return ScanGeometry(
            first_lateral_m=-self.half_width_m,
            lateral_step_m=self.pixel_m,
            first_depth_m=self.first_depth_m,
            depth_step_m=self.pixel_m,
        )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows = math.floor((self.last_depth_m - self.first_depth_m) / self.pixel_m) + 1
        return rows, math.floor(2 * self.half_width_m / self.pixel_m) + 1


class BModeWorld:
    """Tissue with an instrument's tip under a probe in B-mode; there is no light in it.

    ``probe``: height, lens and face radius of its elements. ``tip_deg``, ``tip_radius_m``, ``tip_lateral_m``: place of
    the tip's middle: angle in degrees, distance from the axis and place along the array in metres. The tissue's surface
    is level, at that height plus `BModeSettings.pressed_m`.
    """

    def __init__(
        self,
        *,
        settings: BModeSettings,
        probe: Probe,
        tip_deg: float,
        tip_radius_m: float,
        tip_lateral_m: float,
        present: bool,
        start_deg: float,
        rng: np.random.Generator,
    ) -> None:
        depth_m = tip_radius_m - probe.face_radius_m
        if not settings.first_depth_m < depth_m < settings.last_depth_m:
            raise ConfigError(
                f"b_mode: the tip is {depth_m:.4g} m deep, outside of the image from "
                f"{settings.first_depth_m:g} to {settings.last_depth_m:g} m; change its radius or the depths"
            )
        self.angle_deg = start_deg
        self._settings = settings
        self._probe = probe
        self._tip = (tip_deg, tip_radius_m, tip_lateral_m) if present else None
        self._surface_m = tip_radius_m * math.cos(math.radians(tip_deg)) + settings.pressed_m
        self._rng = rng
        rows = np.arange(settings.shape[0])
        self._radius_m = probe.face_radius_m + settings.first_depth_m + rows * settings.pixel_m
        self._speckle = Speckle(
            probe,
            self._radius_m,
            columns=settings.shape[1],
            pixel_m=settings.pixel_m,
            seed=int(rng.integers(2**63)),
        )

    def pixels(self) -> UInt8[np.ndarray, "rows columns"]:
        """Return the grey values at the present angle, with noise."""
        settings = self._settings
        field = self._speckle.field(self.angle_deg) * self._layers()[:, None] + self._tip_echo()
        noise = filtered_noise(self._rng, settings.shape, pixel_m=settings.pixel_m)
        field = field + _amplitude(settings.noise_db) * noise
        level_db = 20 * np.log10(np.maximum(np.abs(field), 1e-9)) - settings.white_db
        grey = 255 * (1 + level_db / settings.dynamic_range_db)
        return np.asarray(np.clip(np.rint(grey), 0, 255).astype(np.uint8))

    def _layers(self) -> Float64[np.ndarray, " rows"]:
        """Return the amplitude of the scatterers in each row: pad, tissue, its surface, air."""
        settings = self._settings
        # The layers are level; a plane that is turned out of the vertical cuts them farther out.
        height_m = self._radius_m * math.cos(math.radians(self.angle_deg))
        levels_db = np.full(len(height_m), settings.pad_db)
        levels_db[height_m >= self._surface_m - settings.tissue_m] = 0.0
        levels_db[height_m >= self._surface_m] = settings.air_db
        levels_db[np.abs(height_m - self._surface_m) <= 2 * PULSE_M] = settings.surface_db
        amplitudes: Float64[np.ndarray, " rows"] = 10 ** (levels_db / 20)
        return amplitudes

    def _tip_echo(self) -> Complex128[np.ndarray, "rows columns"]:
        """Return the echo of the tip's face, blurred by pulse and beam."""
        settings = self._settings
        rows, columns = settings.shape
        if self._tip is None:
            return np.zeros((rows, columns), np.complex128)
        tip_deg, radius_m, lateral_m = self._tip
        half_m = settings.tip_m / 2
        # Strips of the face across the image plane, weighted by their length.
        across_m = half_m * (np.arange(21) - 10) / 10.5
        strip = np.sqrt(half_m**2 - across_m**2)
        strip_deg = np.degrees(across_m / radius_m)
        in_plane, now = (
            float(strip @ elevation_response(self._probe, radius_m, off_deg - strip_deg))
            for off_deg in (0.0, self.angle_deg - tip_deg)
        )
        turned = math.radians(self.angle_deg - tip_deg)
        face_m = self._probe.face_radius_m
        slant_m = math.sqrt(face_m**2 + radius_m**2 - 2 * face_m * radius_m * math.cos(turned))
        row, column = settings.geometry.pixel(lateral_m=lateral_m, depth_m=slant_m)
        down = (np.arange(rows) - row)[:, None] * settings.pixel_m
        along = (np.arange(columns) - column)[None, :] * settings.pixel_m
        # Half as high as wide: the face is seen from below.
        distance = np.hypot(2 * down, along) / half_m
        edge = BEAM_M / half_m
        shape = 0.5 * (1 - np.tanh((distance - 1) / edge))
        return np.asarray(_amplitude(settings.tip_db) * now / in_plane * shape, dtype=np.complex128)


def _amplitude(level_db: float) -> float:
    return float(10 ** (level_db / 20))
