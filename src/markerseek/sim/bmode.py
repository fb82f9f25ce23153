"""Simulated B-mode: an instrument's tip pressed on tissue over a gel pad, seen from below by the probe.

Three layers lie over the probe: pad, tissue, air, with the speckle of `markerseek.sim.speckle`. The tip is an echo of
the size of its face, weighted by the two-way response of the element. Not simulated: shadows, attenuation, multiple
scattering, the doublet of a pulse far off the plane, roughness of the tip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from markerseek.acoustics import Probe
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
from markerseek.sim.speckle import BEAM_M, PULSE_M, Speckle, elevation_response, filtered_noise


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
        """Grey values at the present angle, with noise."""
        settings = self._settings
        field = self._speckle.field(self.angle_deg) * self._layers()[:, None] + self._tip_echo()
        noise = filtered_noise(self._rng, settings.shape, pixel_m=settings.pixel_m)
        field = field + _amplitude(settings.noise_db) * noise
        level_db = 20 * np.log10(np.maximum(np.abs(field), 1e-9)) - settings.white_db
        grey = 255 * (1 + level_db / settings.dynamic_range_db)
        return np.asarray(np.clip(np.rint(grey), 0, 255).astype(np.uint8))

    def _layers(self) -> Float64[np.ndarray, " rows"]:
        """Amplitude of the scatterers in each row: pad, tissue, its surface, air."""
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
        """Echo of the tip's face, blurred by pulse and beam."""
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
