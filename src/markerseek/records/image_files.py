"""Reads grey images from PNG and DICOM files of other programs."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import RecordError, described

MAX_PIXELS, _LARGEST = 1 << 30, 1 << 28
"""Most pixels of a series, and of one image."""

_CENTIMETRE_UNITS = 3
"""Physical units of an ultrasound region that mean centimetres (DICOM PS3.3, C.8.5.5.1.1)."""

_IMAGE_FORMAT = 1
"""Spatial format of an ultrasound region that is an image, no M-mode, spectrum or graphic."""


def read_png(path: Path) -> np.ndarray:
    """Pixels of one image, shape (rows, columns), of 8 or 16 bits; colours become grey."""
    with _as_image_error(path):
        import cv2

        return _decoded(path, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)


def read_camera_png(path: Path) -> np.ndarray:
    """Pixels of one camera image, shape (rows, columns): the brightest of its colours, without transparency."""
    with _as_image_error(path):
        import cv2

        image = _decoded(path, cv2.IMREAD_UNCHANGED)
        return image if image.ndim == 2 else image[..., :3].max(axis=-1)


@contextmanager
def _as_image_error(path: Path) -> Iterator[None]:
    """Errors of the libraries, which are of any kind, as `RecordError`; their warnings are not shown."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except RecordError:
            raise
        except ImportError as problem:
            raise RecordError(f"{path}: it cannot be read, because of a library: {described(problem)}") from problem
        except Exception as problem:
            reason = " ".join(str(problem).split()).strip("'\"") or type(problem).__name__
            raise RecordError(
                f"{path}: it cannot be read as an image: {reason}; it is damaged: export it again"
            ) from problem


def _decoded(path: Path, flags: int) -> np.ndarray:
    import cv2

    data = np.fromfile(path, np.uint8)
    # Width and height stand first in every PNG; memory is taken for what they say.
    width, height = (int.from_bytes(data[start : start + 4].tobytes(), "big") for start in (16, 20))
    too_large = data[12:16].tobytes() == b"IHDR" and width * height > _LARGEST
    try:
        image = None if too_large else cv2.imdecode(data, flags)
    except cv2.error:
        image = None
    if image is None:
        other = "it is far larger than its file, or damaged" if too_large else "it is damaged, or of another kind"
        reason = "it is empty" if data.size == 0 else other
        raise RecordError(f"{path}: it cannot be read as an image: {reason}; export it again")
    return np.asarray(image)


def read_dicom(path: Path) -> dict[str, np.ndarray]:
    """``pixels`` of all frames as grey values, shape (frames, rows, columns), and what is known of a pixel's size.

    ``regions``: first row and column, last row and column, and height and width of a pixel in metres of each region
    that is an image. ``pixel_m``: height and width by ``PixelSpacing``.
    """
    with _as_image_error(path):
        import pydicom

        file = pydicom.dcmread(path)
        colour = str(file.get("PhotometricInterpretation", ""))
        try:
            pixels = np.asarray(file.pixel_array)
            if colour == "PALETTE COLOR":
                # Without the fourth colour of a palette, transparency.
                pixels = np.asarray(pydicom.pixels.processing.apply_color_lut(pixels, file))[..., :3]
        except (AttributeError, RuntimeError, NotImplementedError, ValueError) as problem:
            reason = " ".join(str(problem).split())
            raise RecordError(f"{path}: its images cannot be unpacked: {reason}; export it uncompressed") from problem
        if colour == "PALETTE COLOR" or (pixels.shape[-1] == 3 and int(file.get("SamplesPerPixel", 1)) == 3):
            # Grey is the same in all three colours of a B-mode image; pydicom has made RGB of YBR.
            pixels = pixels.max(axis=-1)
        if pixels.ndim == 2:
            pixels = pixels[np.newaxis]
        if colour == "MONOCHROME1":
            # About the middle of what the bits can hold, so that the images of a scan can be compared.
            signed = int(file.get("PixelRepresentation", 0))
            pixels = (-1 if signed else 2 ** int(file.BitsStored) - 1) - pixels.astype(np.int64)
        found = {"pixels": pixels, "regions": np.array(_regions(file)).reshape(-1, 6)}
        if file.get("PixelSpacing"):
            found["pixel_m"] = np.array([1e-3 * float(file.PixelSpacing[0]), 1e-3 * float(file.PixelSpacing[1])])
        return found


def _regions(file: Any) -> list[tuple[float, ...]]:
    """Rows as in `read_dicom` of the ultrasound regions that are images."""
    found = []
    for region in file.get("SequenceOfUltrasoundRegions") or ():
        units = {int(region.get(f"PhysicalUnits{axis}Direction", 0)) for axis in "XY"}
        if units != {_CENTIMETRE_UNITS} or int(region.get("RegionSpatialFormat", _IMAGE_FORMAT)) != _IMAGE_FORMAT:
            continue
        places = ("MinY0", "MinX0", "MaxY1", "MaxX1")
        edges = [float(region.get(f"RegionLocation{place}", -1)) for place in places]
        if min(edges) < 0:
            edges = [0, 0, float(file.Rows) - 1, float(file.Columns) - 1]
        found.append((*edges, *(1e-2 * abs(float(region.get(f"PhysicalDelta{axis}", 0))) for axis in "YX")))
    return found
