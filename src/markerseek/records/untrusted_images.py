"""Reads grey images from PNG and DICOM files of other programs; the functions run in the child of a `Sandbox`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import RecordError

_CENTIMETRE_UNITS = 3
"""Physical units of an ultrasound region that mean centimetres (DICOM PS3.3, C.8.5.5.1.1)."""

_IMAGE_FORMAT = 1
"""Spatial format of an ultrasound region that is an image, no M-mode, spectrum or graphic."""


def read_png(path: Path) -> dict[str, np.ndarray]:
    """``pixels`` of one image, shape (1, rows, columns), of 8 or 16 bits; colours become grey."""
    import cv2

    image = _decoded(path, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    return {"pixels": image[np.newaxis]}


def read_camera_png(path: Path) -> dict[str, np.ndarray]:
    """``pixels`` of one camera image, shape (1, rows, columns): the brightest of its colours, without transparency."""
    import cv2

    image = _decoded(path, cv2.IMREAD_UNCHANGED)
    return {"pixels": (image if image.ndim == 2 else image[..., :3].max(axis=-1))[np.newaxis]}


def _decoded(path: Path, flags: int) -> np.ndarray:
    import cv2

    try:
        image = cv2.imdecode(np.fromfile(path, np.uint8), flags)
    except cv2.error as problem:
        # Its text is a place in OpenCV's own source.
        reason = "it is empty" if not path.stat().st_size else "it is far larger than its file, or damaged"
        raise RecordError(f"{path}: it cannot be read as an image: {reason}; export it again") from problem
    if image is None:
        raise RecordError(f"{path}: it cannot be read as an image; it is damaged, or of another kind: export it again")
    return np.asarray(image)


def read_dicom(path: Path) -> dict[str, np.ndarray]:
    """``pixels`` of all frames as grey values, shape (frames, rows, columns), and what is known of a pixel's size.

    ``regions``: first row and column, last row and column, and height and width of a pixel in metres of each region
    that is an image. ``pixel_m``: height and width by ``PixelSpacing``.
    """
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
