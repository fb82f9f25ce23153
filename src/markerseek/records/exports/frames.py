"""Coordinate frames of an exported bank and their transforms, named as in PLUS, in millimetres.

Image
    Pixels (column, row, 0) of an image.
Probe
    y along the array, z out of its middle, x completes a right-handed frame; the origin is on the axis of rotation at
    the array's middle, and the frame rotates with the probe.
ProbeHome
    The frame Probe at 0 degrees.
Transducer
    As PLUS has it: x along the array, y away from it, z the product of both.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import Float64, ScanGeometry

TRANSDUCER_AXES = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
"""Rotation from Transducer to Probe, row by row: Transducer X is +y, towards the element with the highest number.

PLUS calls that side of a transducer the marked one, and an image whose columns run there MF. On which side a housing
has its mark is not known here. If it is the other one, the images must stay MF: PLUS would mirror the pixels of any
other orientation, but not ImageToProbe.
"""

IMAGE_ORIENTATION = "MF"
"""Orientation of the image in PLUS's letters: columns along Transducer X (M), rows along Transducer Y (F)."""


def probe_to_probe_home(angle_deg: float) -> Float64[np.ndarray, "4 4"]:
    """Rotation of the probe about y: a point (0, y, r) comes to (r sin θ, y, r cos θ)."""
    cosine, sine = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return np.array([[cosine, 0, sine, 0], [0, 1, 0, 0], [-sine, 0, cosine, 0], [0, 0, 0, 1]], dtype=np.float64)


def transducer_to_probe(*, face_radius_m: float) -> Float64[np.ndarray, "4 4"]:
    """From the middle of the array's face to the axis of rotation, in millimetres."""
    matrix = np.eye(4)
    # Depth counts from the face, which is the face radius away from the axis of rotation.
    matrix[:3, :3] = TRANSDUCER_AXES
    matrix[2, 3] = 1e3 * face_radius_m
    return matrix


def image_to_transducer(geometry: ScanGeometry) -> Float64[np.ndarray, "4 4"]:
    """Pixels (column, row, 0) to millimetres from the middle of the array's face: the column along x, the row along y.

    The third axis is one millimetre long.
    """
    matrix = np.diag((1e3 * geometry.lateral_step_m, 1e3 * geometry.depth_step_m, 1.0, 1.0))
    matrix[:2, 3] = 1e3 * geometry.first_lateral_m, 1e3 * geometry.first_depth_m
    return matrix


def image_to_probe(geometry: ScanGeometry, *, face_radius_m: float) -> Float64[np.ndarray, "4 4"]:
    """Pixels (column, row, 0) to millimetres: the column along y, the row along z from the axis of rotation."""
    to_probe = transducer_to_probe(face_radius_m=face_radius_m)
    matrix: Float64[np.ndarray, "4 4"] = to_probe @ image_to_transducer(geometry)
    return matrix
