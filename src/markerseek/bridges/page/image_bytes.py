"""The images of a frame as few bytes for the browser."""

from __future__ import annotations

import base64
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import (
    BModeImage,
    ChannelFrame,
    ConfigError,
    Float32,
    PaImage,
    RFFrame,
    Sample,
    ScanGeometry,
    UInt8,
)
from markerseek.ros import messages
from markerseek.signals import AnyImageReader

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
    columns: int
    lateral_mm: tuple[float, float]
    depth_mm: tuple[float, float]
    """``lateral_mm`` and ``depth_mm``: outer edges."""


# eq=False: two images are compared often, and never equal unless they are the same.
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """The images of an acquisition as they are sent."""

    angle_deg: float
    intensity: float
    """``angle_deg`` and ``intensity``: angle of the probe in degrees, and intensity of the reading."""
    image: Layer
    """The photoacoustic image: level 0 is `range_db` below the brightest, or less."""
    b_mode: Layer | None
    """B-mode image of the same angle; None where the rig takes none."""
    range_db: float
    """From the brightest level to black, or to transparent over B-mode."""
    peak_mm: tuple[float, float] | None
    """Lateral position and depth of the largest envelope; None where the reading has none."""


def picture_of(sample: Sample, imaging: AnyImageReader) -> Picture:
    """The images of an acquisition.

    ``sample``: one with channel data or RF lines.
    """
    frame = sample.frame
    if not isinstance(frame, ChannelFrame | RFFrame):
        raise ConfigError("picture: the sample has no frame of counts; ask for one with channel data or RF lines")
    image = imaging.picture(frame)
    reading = sample.reading
    brightest = float(image.envelope.max())
    if reading.noise_sigma is not None:
        brightest = max(brightest, BRIGHT_SIGMAS * reading.noise_sigma)
    range_db = RANGE_DB if frame.b_mode is None else OVER_B_MODE_DB
    together = _rows_together(image.envelope.shape[0])
    geometry = replace(
        image.geometry,
        first_depth_m=image.geometry.position_m(row=(together - 1) / 2, column=0)[1],
        depth_step_m=together * image.geometry.depth_step_m,
    )
    peak_mm = None
    if reading.lateral_m is not None and reading.depth_m is not None:
        peak_mm = 1e3 * reading.lateral_m, 1e3 * reading.depth_m
    return Picture(
        angle_deg=sample.angle_deg,
        intensity=reading.intensity,
        image=_layer(pooled_levels(image, brightest=brightest, range_db=range_db), geometry),
        b_mode=None if frame.b_mode is None else _b_mode_layer(frame.b_mode),
        range_db=range_db,
        peak_mm=peak_mm,
    )


def _layer(levels: UInt8[np.ndarray, "rows columns"], geometry: ScanGeometry) -> Layer:
    rows, columns = levels.shape
    left, right, bottom, top = geometry.edges_mm(rows, columns)
    return Layer(
        pixels=base64.b64encode(levels.tobytes()).decode("ascii"),
        rows=rows,
        columns=columns,
        lateral_mm=(left, right),
        depth_mm=(top, bottom),
    )


def _b_mode_layer(b_mode: BModeImage) -> Layer:
    """Every pixel, or every n-th of an image with more than `MAX_B_MODE` rows or columns."""
    nth = -(-max(b_mode.pixels.shape) // MAX_B_MODE)
    geometry = b_mode.geometry
    coarser = replace(geometry, lateral_step_m=nth * geometry.lateral_step_m, depth_step_m=nth * geometry.depth_step_m)
    return _layer(b_mode.pixels[::nth, ::nth], coarser)


def pooled_levels(image: PaImage, *, brightest: float, range_db: float = RANGE_DB) -> UInt8[np.ndarray, "rows columns"]:
    """Levels of an image; several rows become one that holds their largest value, so that no peak is lost.

    ``brightest``: envelope of level 255, in the image's unit. ``range_db``: from level 255 to level 0.
    """
    return messages.grey(_pooled(image.envelope), brightest=brightest, range_db=range_db)


def _rows_together(rows: int) -> int:
    """How many rows of an image become one."""
    return -(-rows // MAX_ROWS)


def _pooled(envelope: Float32[np.ndarray, "depths laterals"]) -> Float32[np.ndarray, "rows laterals"]:
    together = _rows_together(envelope.shape[0])
    rows = -(-envelope.shape[0] // together)
    missing = rows * together - envelope.shape[0]
    # The last row holds fewer depths: zeros are never the largest envelope.
    padded = np.pad(envelope, ((0, missing), (0, 0)))
    return np.asarray(padded.reshape(rows, together, -1).max(axis=1))
