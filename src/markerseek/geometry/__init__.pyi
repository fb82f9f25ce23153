from .cameras import Camera, StereoCameras, Triangulated, triangulate
from .error_length import ErrorLength
from .registration import (
    MIN_POINTS,
    OFFSET_FACTORS,
    Registration,
    RegistrationErrors,
    best_rotation,
    effect_of_motion,
    mirror_image_fre,
    register_points,
    registration_errors,
)
from .stereo_motion import (
    CalibrationErrors,
    RangedPoints,
    StereoMotion,
    StereoPixels,
    at_rest,
    motion_about,
    range_points,
    rigid_motion,
    seen_after,
    shift_between,
)
from .transform import RigidTransform

__all__ = [
    "MIN_POINTS",
    "OFFSET_FACTORS",
    "CalibrationErrors",
    "Camera",
    "ErrorLength",
    "RangedPoints",
    "Registration",
    "RegistrationErrors",
    "RigidTransform",
    "StereoCameras",
    "StereoMotion",
    "StereoPixels",
    "Triangulated",
    "at_rest",
    "best_rotation",
    "effect_of_motion",
    "mirror_image_fre",
    "motion_about",
    "range_points",
    "register_points",
    "registration_errors",
    "rigid_motion",
    "seen_after",
    "shift_between",
    "triangulate",
]
