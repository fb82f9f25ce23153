from .cameras import Camera, StereoCameras
from .errors import RegistrationErrors, registration_errors
from .horn import best_rotation, mirror_image_fre
from .registration import MIN_POINTS, Registration, register_points
from .transform import RigidTransform
from .triangulation import Triangulated, triangulate

__all__ = [
    "MIN_POINTS",
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
