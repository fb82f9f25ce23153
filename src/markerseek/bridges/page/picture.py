"""The photoacoustic image of a frame as few bytes for the browser, and the background drawn behind a simulated one."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek.core import ConfigError, Float32, PaImage, Sample, UInt8
from markerseek.signals import ImageReader

RANGE_DB = 40
"""From the brightest level to black, in dB."""

BRIGHT_SIGMAS = 100.0
"""Brightest level over σ where the frame has nothing stronger: noise alone must look like noise."""

MOST_ROWS = 200
"""Rows of an image that is sent: a screen shows no more."""


# eq=False: two images are compared often, and never equal unless they are the same.
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """An image as it is sent.

    Attributes
    ----------
    angle_deg, intensity
        Angle of the probe in degrees, and intensity of the reading.
    pixels
        Levels from 0 (`RANGE_DB` below the brightest, or less) to 255, row after row, base64.
    rows, columns
        Shape.
    lateral_mm, depth_mm
        Outer edges of the image in millimetres.
    peak_mm
        Lateral position and depth of the largest envelope, in millimetres; None where the reading has none.
    """

    angle_deg: float
    intensity: float
    pixels: str
    rows: int
    columns: int
    lateral_mm: tuple[float, float]
    depth_mm: tuple[float, float]
    peak_mm: tuple[float, float] | None


def picture_of(sample: Sample, imaging: ImageReader) -> Picture:
    """The image of an acquisition.

    Parameters
    ----------
    sample
        One with channel data.
    imaging
        Imaging chain of its rig.

    Raises
    ------
    AcquisitionError
        If the frame is not one of that probe.
    ConfigError
        If the sample has no frame.
    """
    if sample.frame is None:
        raise ConfigError("picture: the sample has no frame; ask for one with channel data")
    image = imaging.picture(sample.frame)
    reading = sample.reading
    brightest = max(float(image.envelope.max()), BRIGHT_SIGMAS * (reading.noise_sigma or 0.0))
    levels = pooled_levels(image, brightest=brightest)
    known = reading.lateral_m is not None and reading.depth_m is not None
    return Picture(
        angle_deg=sample.angle_deg,
        intensity=reading.intensity,
        pixels=base64.b64encode(levels.tobytes()).decode("ascii"),
        rows=levels.shape[0],
        columns=levels.shape[1],
        lateral_mm=(1e3 * float(image.lateral_m[0]), 1e3 * float(image.lateral_m[-1])),
        depth_mm=(1e3 * float(image.depth_m[0]), 1e3 * float(image.depth_m[-1])),
        peak_mm=(1e3 * (reading.lateral_m or 0.0), 1e3 * (reading.depth_m or 0.0)) if known else None,
    )


def pooled_levels(image: PaImage, *, brightest: float) -> UInt8[np.ndarray, "rows columns"]:
    """Levels of an image; several rows become one that holds their largest value, so that no peak is lost.

    Parameters
    ----------
    image
        The image.
    brightest
        Envelope of level 255, in the image's unit.
    """
    pooled = _pooled(image.envelope)
    relative = pooled / max(brightest, float(np.finfo(np.float32).tiny))
    decibels = 20 * np.log10(np.maximum(relative, 10 ** (-RANGE_DB / 20)))
    share = 1 + np.minimum(decibels, 0.0) / RANGE_DB
    return np.asarray(np.rint(255 * share), dtype=np.uint8)


def _pooled(envelope: Float32[np.ndarray, "depths laterals"]) -> Float32[np.ndarray, "rows laterals"]:
    together = -(-envelope.shape[0] // MOST_ROWS)
    rows = -(-envelope.shape[0] // together)
    missing = rows * together - envelope.shape[0]
    # The last row holds fewer depths: zeros are never the largest envelope.
    padded = np.pad(envelope, ((0, missing), (0, 0)))
    return np.asarray(padded.reshape(rows, together, -1).max(axis=1))


@lru_cache(maxsize=4)
def drawn_background(rows: int, columns: int) -> str:
    """Speckle that looks like B-mode, as levels 0 to 255 in base64; it is drawn, no ultrasound was simulated.

    Parameters
    ----------
    rows, columns
        Shape of the image in front of it.
    """
    # A fixed seed: the background must not change from image to image, as if it were data.
    rng = np.random.Generator(np.random.PCG64(7))
    field = rng.normal(size=(rows, columns)) + 1j * rng.normal(size=(rows, columns))
    for axis, length in ((0, 3), (1, 4)):
        # Neighbours share their field, as within a resolution cell.
        field = np.sum([np.roll(field, shift, axis=axis) for shift in range(length)], axis=0)
    speckle = np.abs(field) / np.abs(field).mean()
    depth = np.linspace(0.0, 1.0, rows)[:, None]
    # A quiet gel pad in front, then tissue that fades with depth.
    tissue = np.where(depth < 0.55, 0.12, 0.75 * np.exp(-1.5 * (depth - 0.55)))
    levels = np.clip(110 * speckle * tissue, 0, 255).astype(np.uint8)
    return base64.b64encode(levels.tobytes()).decode("ascii")
