"""A bank as ``.igs.mha``, the sequence metafile of PLUS, which 3D Slicer opens with its transforms.

Lengths are in millimetres. Image coordinates are pixels (column, row); Probe has y along the array, z out of it at
its middle, and the axis of rotation as origin; ProbeToProbeHome is the rotation about y. The field ``angle_deg`` is
ours; programs that do not know it pass it over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from markerseek.core import PaImage, RecordError
from markerseek.records.exports._new_file import new_file

MOST_FRAMES = 9999
"""Frames that four digits of a field's name can count."""


def write_sequence(
    path: Path, images: Iterator[PaImage], *, angles_deg: Sequence[float], face_radius_m: float | None
) -> None:
    """Write images of one shape as a sequence of MET_FLOAT pixels.

    Parameters
    ----------
    path
        File to be written; it must not exist.
    images
        Image of each angle; taken one at a time.
    angles_deg
        Angle of the probe at each, in degrees.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres. None leaves ImageToProbe out, which would
        otherwise be wrong by that distance.

    Raises
    ------
    RecordError
        If the file cannot be written, or the images differ in shape.
    """
    if len(angles_deg) > MOST_FRAMES:
        raise RecordError(f"{path}: {len(angles_deg)} frames, a sequence holds at most {MOST_FRAMES}; scan coarser")
    first = next(images)
    with new_file(path) as file:
        file.write(_header(first, angles_deg, face_radius_m).encode("ascii"))
        file.write(_pixels(first, path, first.envelope.shape))
        for image in images:
            file.write(_pixels(image, path, first.envelope.shape))


def probe_to_probe_home(angle_deg: float) -> Float64[np.ndarray, "4 4"]:
    """Rotation of the probe about y: a point (0, y, r) comes to (r sin θ, y, r cos θ)."""
    cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[cosine, 0, sine, 0], [0, 1, 0, 0], [-sine, 0, cosine, 0], [0, 0, 0, 1]], dtype=np.float64)


def image_to_probe(image: PaImage, *, face_radius_m: float) -> Float64[np.ndarray, "4 4"]:
    """Pixels (column, row, 0) to millimetres: the column along y, the row along z from the axis of rotation."""
    across, down = (1e3 * step for step in _spacing_m(image))
    matrix = np.zeros((4, 4))
    matrix[1, 0], matrix[1, 3] = across, 1e3 * image.lateral_m[0]
    matrix[2, 1], matrix[2, 3] = down, 1e3 * (face_radius_m + image.depth_m[0])
    # The third axis completes the right hand: column × row is y × z, which is x.
    matrix[0, 2] = 1.0
    matrix[3, 3] = 1.0
    return matrix


def _header(image: PaImage, angles_deg: Sequence[float], face_radius_m: float | None) -> str:
    rows, columns = image.envelope.shape
    across, down = (1e3 * step for step in _spacing_m(image))
    lines = [
        "ObjectType = Image",
        "NDims = 3",
        "AnatomicalOrientation = RAI",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CenterOfRotation = 0 0 0",
        "CompressedData = False",
        f"DimSize = {columns} {rows} {len(angles_deg)}",
        "ElementNumberOfChannels = 1",
        f"ElementSpacing = {across:.9g} {down:.9g} 1",
        "ElementType = MET_FLOAT",
        "Kinds = domain domain list",
        "Offset = 0 0 0",
        "TransformMatrix = 1 0 0 0 1 0 0 0 1",
        "UltrasoundImageOrientation = MF",
        "UltrasoundImageType = BRIGHTNESS",
    ]
    for number, angle_deg in enumerate(angles_deg):
        frame = f"Seq_Frame{number:04d}"
        transforms = {"ProbeToProbeHome": probe_to_probe_home(angle_deg)}
        if face_radius_m is not None:
            transforms["ImageToProbe"] = image_to_probe(image, face_radius_m=face_radius_m)
        for name, matrix in transforms.items():
            lines.append(f"{frame}_{name}Transform = {' '.join(f'{value:.12g}' for value in matrix.flat)}")
            lines.append(f"{frame}_{name}TransformStatus = OK")
        lines.append(f"{frame}_angle_deg = {angle_deg:.9g}")
        # A scan has no moments that matter: its frames are numbered, one to a second.
        lines.append(f"{frame}_Timestamp = {number}")
        lines.append(f"{frame}_ImageStatus = OK")
    lines.append("ElementDataFile = LOCAL")
    return "\n".join(lines) + "\n"


def _spacing_m(image: PaImage) -> tuple[float, float]:
    """Distances of columns and of rows, in metres."""
    across, down = (float(np.ptp(axis)) / (len(axis) - 1) for axis in (image.lateral_m, image.depth_m))
    return across, down


def _pixels(image: PaImage, path: Path, shape: tuple[int, ...]) -> bytes:
    if image.envelope.shape != shape:
        raise RecordError(f"{path}: an image of {image.envelope.shape} pixels follows one of {shape}; keep one probe")
    return image.envelope.astype("<f4").tobytes()
