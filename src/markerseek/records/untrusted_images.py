"""Reads grey images from PNG and DICOM files of other programs; the functions run in the child of a `Sandbox`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from markerseek.core import RecordError

_CENTIMETRE_UNITS = 3
"""Physical units of an ultrasound region that mean centimetres (DICOM PS3.3, C.8.5.5.1.1)."""


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
    """``pixels`` of all frames, shape (frames, rows, columns), and ``pixel_m``, height and width, where it is known."""
    import pydicom

    file = pydicom.dcmread(path)
    try:
        pixels = np.asarray(file.pixel_array)
    except (AttributeError, RuntimeError, NotImplementedError) as problem:
        reason = " ".join(str(problem).split())
        raise RecordError(f"{path}: its images cannot be unpacked: {reason}; export it uncompressed") from problem
    colour = str(file.get("PhotometricInterpretation", ""))
    if pixels.ndim > 2 and pixels.shape[-1] == 3 and int(file.get("SamplesPerPixel", 1)) == 3:
        # Grey is the brightness itself in YBR, and the same in all three colours of a B-mode image in RGB.
        pixels = pixels[..., 0] if colour.startswith("YBR") else pixels.max(axis=-1)
    if pixels.ndim == 2:
        pixels = pixels[np.newaxis]
    if colour == "MONOCHROME1":
        pixels = pixels.max() - pixels
    found = {"pixels": pixels}
    size_m = _pixel_m(file)
    if size_m is not None:
        found["pixel_m"] = np.array(size_m)
    return found


def _pixel_m(file: Any) -> tuple[float, float] | None:
    """Height and width of a pixel in metres."""
    if "PixelSpacing" in file:
        return 1e-3 * float(file.PixelSpacing[0]), 1e-3 * float(file.PixelSpacing[1])
    for region in file.get("SequenceOfUltrasoundRegions", ()):
        units = {int(region.get(f"PhysicalUnits{axis}Direction", 0)) for axis in "XY"}
        if units == {_CENTIMETRE_UNITS}:
            return 1e-2 * abs(float(region.PhysicalDeltaY)), 1e-2 * abs(float(region.PhysicalDeltaX))
    return None
