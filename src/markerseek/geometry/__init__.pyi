from .cameras import Camera, StereoCameras, Triangulated, triangulate
from .registration import (
    MIN_POINTS,
    OFFSET_FACTORS,
    Registration,
    RegistrationErrors,
    best_rotation,
    mirror_image_fre,
    register_points,
    registration_errors,
)
from .transform import RigidTransform

__all__ = [
    "MIN_POINTS",
    "OFFSET_FACTORS",
    "Camera",
    "Registration",
    "RegistrationErrors",
    "RigidTransform",
    "StereoCameras",
    "Triangulated",
    "best_rotation",
    "mirror_image_fre",
    "register_points",
    "registration_errors",
    "triangulate",
]
