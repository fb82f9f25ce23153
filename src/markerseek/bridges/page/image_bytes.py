"""The image of a frame as few bytes for the browser."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import PaImage, Sample, ScanGeometry, UInt8
from markerseek.ros import messages

RANGE_DB = 40
"""From the brightest level to black, in dB."""

BRIGHT_SIGMAS = 100.0
"""Brightest level over σ where the frame has nothing stronger: noise alone must look like noise."""

MAX_ROWS = 200
"""Rows of a photoacoustic image that is sent: a screen shows no more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Layer:
    """Pixels as they are sent, and where they are."""

    pixels: str
    """Levels from 0 to 255, row after row, base64."""
    rows: int
    """Number of rows."""
    columns: int
    """Number of columns."""
    lateral_mm: tuple[float, float]
    """Outer edges across, in millimetres."""
    depth_mm: tuple[float, float]
    """Outer edges in depth, in millimetres."""


# eq=False: two images are compared often, and never equal unless they are the same.
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """The image of an acquisition as it is sent."""

    angle_deg: float
    """Angle of the probe, in degrees."""
    intensity: float
    """Intensity of the reading."""
    image: Layer
    """The photoacoustic image: level 0 is `range_db` below the brightest, or less."""
    peak_mm: tuple[float, float] | None
    """Lateral position and depth of the largest envelope; None if the reading has none."""


def picture_of(sample: Sample, image: PaImage) -> Picture:
    """The image of an acquisition as it is sent."""
    reading = sample.reading
    brightest = max(float(image.envelope.max()), BRIGHT_SIGMAS * (reading.noise_sigma or 0.0))
    together, geometry = _rows_together(image), image.geometry
    pooled = replace(
        geometry,
        first_depth_m=geometry.position_m(row=(together - 1) / 2, column=0)[1],
        depth_step_m=together * geometry.depth_step_m,
    )
    placed = reading.lateral_m is not None and reading.depth_m is not None
    return Picture(
        angle_deg=sample.angle_deg,
        intensity=reading.intensity,
        image=_layer(pooled_levels(image, brightest=brightest), pooled),
        peak_mm=(1e3 * (reading.lateral_m or 0.0), 1e3 * (reading.depth_m or 0.0)) if placed else None,
    )


def _layer(levels: UInt8[np.ndarray, "rows columns"], geometry: ScanGeometry) -> Layer:
    rows, columns = levels.shape
    left, right, bottom, top = geometry.edges_mm(rows, columns)
    pixels = base64.b64encode(levels.tobytes()).decode("ascii")
    return Layer(pixels=pixels, rows=rows, columns=columns, lateral_mm=(left, right), depth_mm=(top, bottom))


def pooled_levels(image: PaImage, *, brightest: float) -> UInt8[np.ndarray, "rows columns"]:
    """Levels of an image; several rows become one that holds their largest value, so that peaks are kept.

    ``brightest``: envelope of level 255, in the image's unit.
    """
    starts = np.arange(0, image.envelope.shape[0], _rows_together(image))
    return messages.grey(np.maximum.reduceat(image.envelope, starts, axis=0), brightest=brightest, range_db=RANGE_DB)


def _rows_together(image: PaImage) -> int:
    """How many rows of an image become one."""
    return int(-(-image.envelope.shape[0] // MAX_ROWS))
