"""Writes a bank as ``.igs.mha``, the sequence metafile of PLUS, which 3D Slicer opens with its transforms.

Image coordinates are pixels, whose size is in ImageToProbe alone: ElementSpacing is 1, since Slicer and PLUS multiply
by both. Timestamps count from the first acquisition: SlicerIGSIO keeps six digits of them. The fields
``markerseek_...`` and ``angle_deg`` are ours; other programs ignore them. The coordinate frames and their transforms
are named as in PLUS, in millimetres:

Image
    Pixels (column, row, 0) of an image.
Probe
    y along the array, z out of its middle, x completes a right-handed frame; the origin is on the axis of rotation at
    the array's middle, and the frame rotates with the probe.
ProbeHome
    The frame Probe at 0 degrees.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from markerseek.core import Float64, PaImage, RecordError, ScanGeometry
from markerseek.files import new_file
from markerseek.records.banks.bank import Series

MAX_FRAMES = 9999
"""Frames that four digits of a field's name can count."""

PIXELS = "envelope in ADC counts"
"""What a pixel is."""

_LONGEST_LINE = 900


def write_sequence(path: Path, images: Iterator[PaImage], *, series: Series) -> None:
    """Write images of one shape as a sequence of MET_FLOAT pixels.

    ``path``: file to be written; it must not exist. ``images``: image of each acquisition, in the order of the series;
    taken one at a time. ``series``: the acquisitions. Where their facts have no face radius, ImageToProbe is left out,
    which would otherwise be wrong by it.
    """
    count = len(series.angles_deg)
    if count > MAX_FRAMES:
        raise RecordError(f"{path}: {count} frames, a sequence holds at most {MAX_FRAMES}; scan coarser")
    first = next(images)
    with new_file(path) as part, part.open("xb") as file:
        file.write(_header(first, series).encode("ascii"))
        for image in chain((first,), images):
            if image.envelope.shape != first.envelope.shape:
                raise RecordError(
                    f"{path}: an image of {image.envelope.shape} pixels follows one of {first.envelope.shape}; "
                    "keep one probe"
                )
            file.write(image.envelope.astype("<f4").tobytes())


def _header(image: PaImage, series: Series) -> str:
    rows, columns = image.envelope.shape
    lines = [
        "ObjectType = Image",
        "NDims = 3",
        "AnatomicalOrientation = RAI",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CenterOfRotation = 0 0 0",
        "CompressedData = False",
        f"DimSize = {columns} {rows} {len(series.angles_deg)}",
        "ElementNumberOfChannels = 1",
        "ElementSpacing = 1 1 1",
        "ElementType = MET_FLOAT",
        "Kinds = domain domain list",
        "Offset = 0 0 0",
        "TransformMatrix = 1 0 0 0 1 0 0 0 1",
        f"UltrasoundImageOrientation = {IMAGE_ORIENTATION}",
        "UltrasoundImageType = BRIGHTNESS",
    ]
    known = series.known | image.geometry.grid | {"pixels": PIXELS, "first_time_s": series.times_s[0]}
    lines += [_line(f"markerseek_{name}", value) for name, value in known.items()]
    radius_m = series.facts.face_radius_m
    for number, (angle_deg, time_s) in enumerate(zip(series.angles_deg, series.times_s, strict=True)):
        frame = f"Seq_Frame{number:04d}"
        transforms = {"ProbeToProbeHome": probe_to_probe_home(angle_deg)}
        if radius_m is not None:
            transforms["ImageToProbe"] = image_to_probe(image.geometry, face_radius_m=radius_m)
        for name, matrix in transforms.items():
            lines.append(f"{frame}_{name}Transform = {' '.join(f'{value:.12g}' for value in matrix.flat)}")
            lines.append(f"{frame}_{name}TransformStatus = OK")
        lines.append(f"{frame}_angle_deg = {angle_deg:.9g}")
        lines.append(f"{frame}_Timestamp = {time_s - series.times_s[0]:.9g}")
        lines.append(f"{frame}_ImageStatus = OK")
    lines.append("ElementDataFile = LOCAL")
    return "\n".join(lines) + "\n"


def _line(name: str, value: str | float | bool) -> str:
    """Return one field: a single line of printable ASCII, not longer than the 999 bytes that PLUS and Slicer read."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    ascii_text = " ".join(text.encode("ascii", "backslashreplace").decode("ascii").split())
    printable = "".join(each if each.isprintable() else "?" for each in ascii_text)
    return f"{name} = {printable}"[:_LONGEST_LINE].rstrip()


IMAGE_ORIENTATION = "MF"
"""Orientation of the image in PLUS's letters: columns towards the marked side of the transducer (M), rows away (F).

Here the marked side is that of the element with the highest number, +y. On which side a housing has its mark is not
known. If it is the other one, the images must stay MF: PLUS would mirror the pixels of any other orientation, but not
ImageToProbe.
"""


def probe_to_probe_home(angle_deg: float) -> Float64[np.ndarray, "4 4"]:
    """Return the rotation of the probe about y: a point (0, y, r) comes to (r sin θ, y, r cos θ)."""
    cosine = math.cos(math.radians(angle_deg))
    sine = math.sin(math.radians(angle_deg))
    return np.array([[cosine, 0, sine, 0], [0, 1, 0, 0], [-sine, 0, cosine, 0], [0, 0, 0, 1]], dtype=np.float64)


def image_to_probe(geometry: ScanGeometry, *, face_radius_m: float) -> Float64[np.ndarray, "4 4"]:
    """Return the transform from pixels (column, row, 0) to millimetres.

    The column is along y, the row along z from the axis of rotation. The third axis of the image is
    one millimetre of x long.
    """
    matrix = np.zeros((4, 4))
    matrix[0, 2] = 1.0
    matrix[3, 3] = 1.0
    matrix[1, 0] = 1e3 * geometry.lateral_step_m
    matrix[1, 3] = 1e3 * geometry.first_lateral_m
    # Depth counts from the face, which is the face radius away from the axis of rotation.
    matrix[2, 1] = 1e3 * geometry.depth_step_m
    matrix[2, 3] = 1e3 * geometry.first_depth_m + 1e3 * face_radius_m
    return matrix
