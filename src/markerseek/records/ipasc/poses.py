"""Where the array is at each measurement, in the coordinates of IPASC.

These lie in the array as it was at the first measurement: x1 along it from its centre (y of the TRUS home frame), x3
out of it, and x2 = x3 × x1. The probe turns about an axis parallel to x1, which lies the face's radius behind the face.
"""

from __future__ import annotations

import math

import numpy as np

from markerseek.core.shapes import Float64


def probe_pose(angle_deg: float, *, first_deg: float, face_radius_m: float) -> Float64[np.ndarray, " 6"]:
    """Position of the array's centre in metres, then its rotation in radians about x1, x2 and x3.

    Parameters
    ----------
    angle_deg, first_deg
        Angle of the measurement and of the first one, in degrees.
    face_radius_m
        Distance of the array's face from the axis of rotation in metres.
    """
    turned = math.radians(angle_deg - first_deg)
    # 1 - cos in a form that keeps small angles exact.
    sinking_m = 2 * face_radius_m * math.sin(turned / 2) ** 2
    return np.array([0.0, -face_radius_m * math.sin(turned), -sinking_m, turned, 0.0, 0.0])
