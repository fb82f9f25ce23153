"""The images of a frame as few bytes for the browser."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import BModeImage, PaImage, Sample, ScanGeometry, UInt8
from markerseek.ros import messages

RANGE_DB, OVER_B_MODE_DB = 40, 20
"""From the brightest level to black, and to transparent over B-mode, in dB: more would hide the B-mode image."""

BRIGHT_SIGMAS = 100.0
"""Brightest level over σ where the frame has nothing stronger: noise alone must look like noise."""

MAX_ROWS = 200
"""Rows of a photoacoustic image that is sent: a screen shows no more."""

MAX_B_MODE = 400
"""Rows and columns of a B-mode image that is sent; all images of a run are kept while it is shown."""


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
    """The images of an acquisition as they are sent."""

    angle_deg: float
    """Angle of the probe, in degrees."""
    intensity: float
    """Intensity of the reading."""
    image: Layer
    """The photoacoustic image: level 0 is `range_db` below the brightest, or less."""
    b_mode: Layer | None
    """B-mode image of the same angle; None if the rig takes none."""
    range_db: float
    """From the brightest level to black, or to transparent over B-mode."""
    peak_mm: tuple[float, float] | None
    """Lateral position and depth of the largest envelope; None if the reading has none."""


def picture_of(sample: Sample, image: PaImage, b_mode: BModeImage | None) -> Picture:
    """The images of an acquisition as they are sent."""
    reading = sample.reading
    brightest = max(float(image.envelope.max()), BRIGHT_SIGMAS * (reading.noise_sigma or 0.0))
    range_db = RANGE_DB if b_mode is None else OVER_B_MODE_DB
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
        image=_layer(pooled_levels(image, brightest=brightest, range_db=range_db), pooled),
        b_mode=None if b_mode is None else _b_mode_layer(b_mode),
        range_db=range_db,
        peak_mm=(1e3 * (reading.lateral_m or 0.0), 1e3 * (reading.depth_m or 0.0)) if placed else None,
    )


def _layer(levels: UInt8[np.ndarray, "rows columns"], geometry: ScanGeometry) -> Layer:
    rows, columns = levels.shape
    left, right, bottom, top = geometry.edges_mm(rows, columns)
    pixels = base64.b64encode(levels.tobytes()).decode("ascii")
    return Layer(pixels=pixels, rows=rows, columns=columns, lateral_mm=(left, right), depth_mm=(top, bottom))


def _b_mode_layer(b_mode: BModeImage) -> Layer:
    """Every pixel, or every n-th of an image with more than `MAX_B_MODE` rows or columns."""
    nth, geometry = -(-max(b_mode.pixels.shape) // MAX_B_MODE), b_mode.geometry
    coarser = replace(geometry, lateral_step_m=nth * geometry.lateral_step_m, depth_step_m=nth * geometry.depth_step_m)
    return _layer(b_mode.pixels[::nth, ::nth], coarser)


def pooled_levels(image: PaImage, *, brightest: float, range_db: float = RANGE_DB) -> UInt8[np.ndarray, "rows columns"]:
    """Levels of an image; several rows become one that holds their largest value, so that peaks are kept.

    ``brightest``: envelope of level 255, in the image's unit. ``range_db``: from level 255 to level 0.
    """
    starts = np.arange(0, image.envelope.shape[0], _rows_together(image))
    return messages.grey(np.maximum.reduceat(image.envelope, starts, axis=0), brightest=brightest, range_db=range_db)


def _rows_together(image: PaImage) -> int:
    """How many rows of an image become one."""
    return int(-(-image.envelope.shape[0] // MAX_ROWS))
