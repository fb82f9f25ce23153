from .points import point_pairs, spot_pairs
from .report import (
    TARGET_DEPTH_M,
    KnownRegistration,
    PointPair,
    RegistrationReport,
    davinci_to_probe_home,
    read_registration,
    register_pairs,
)
from .shared_errors import FOCAL_LENGTH, camera_shared_m, focal_shared_m, trus_shared_m
from .simulated import (
    GRID_STEP_M,
    MARKER_PLACES,
    REGISTRATION_TOLERANCE_MM,
    SimulatedScene,
    SimulatedTruth,
    simulate_registration,
)
from .stereo_files import StereoSettings, read_stereo
from .target_views import TargetView, target_views

__all__ = [
    "FOCAL_LENGTH",
    "GRID_STEP_M",
    "MARKER_PLACES",
    "REGISTRATION_TOLERANCE_MM",
    "TARGET_DEPTH_M",
    "KnownRegistration",
    "PointPair",
    "RegistrationReport",
    "SimulatedScene",
    "SimulatedTruth",
    "StereoSettings",
    "TargetView",
    "camera_shared_m",
    "davinci_to_probe_home",
    "focal_shared_m",
    "point_pairs",
    "read_registration",
    "read_stereo",
    "register_pairs",
    "simulate_registration",
    "spot_pairs",
    "target_views",
    "trus_shared_m",
]
