"""Rigid transforms between named frames, point registration with its errors, and stereo cameras. Pure."""

from markerseek.geometry.cameras import Camera, StereoCameras
from markerseek.geometry.errors import RegistrationErrors, registration_errors
from markerseek.geometry.horn import best_rotation, mirror_image_fre
from markerseek.geometry.leave_one_out import LeftOut, leave_one_out
from markerseek.geometry.registration import LEAST_POINTS, Registration, register_points
from markerseek.geometry.transform import RigidTransform
from markerseek.geometry.triangulation import Triangulated, triangulate

__all__ = [
    "LEAST_POINTS",
    "Camera",
    "LeftOut",
    "Registration",
    "RegistrationErrors",
    "RigidTransform",
    "StereoCameras",
    "Triangulated",
    "best_rotation",
    "leave_one_out",
    "mirror_image_fre",
    "register_points",
    "registration_errors",
    "triangulate",
]
