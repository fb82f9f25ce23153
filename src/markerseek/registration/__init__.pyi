from .choice import Choice, SeenMarker, choose
from .device_room import DeviceRoom
from .points import point_pairs, spot_pairs
from .poses import Place, Poses, Prediction, Reach
from .record import (
    CAMERA_IMAGES,
    REGISTRATION,
    SessionRecord,
    camera_text,
    default_folder,
    follow_session,
    is_running,
    read_session,
    session_folder,
)
from .report import (
    TARGET_DEPTH_M,
    KnownRegistration,
    PointPair,
    RegistrationReport,
    davinci_to_probe_home,
    read_registration,
    register_pairs,
)
from .room import Room
from .session import REGISTRATION_TOLERANCE_MM, RegistrationSession, SessionPlan
from .shared_errors import FOCAL_LENGTH, camera_shared_m, focal_shared_m, trus_shared_m
from .simulated_room import SimulatedRoom, SimulatedRoomSettings, SimulatedTruth
from .state import RegistrationState
from .steps import (
    Begun,
    Ended,
    MovedMarker,
    RecordedStep,
    Registered,
    Searching,
    Spot,
    SpotRefused,
    SpotSeen,
    Step,
    TakenMarker,
    Waiting,
)
from .stereo_files import StereoSettings, read_stereo
from .target_pixels import target_pixels

__all__ = [
    "CAMERA_IMAGES",
    "FOCAL_LENGTH",
    "REGISTRATION",
    "REGISTRATION_TOLERANCE_MM",
    "TARGET_DEPTH_M",
    "Begun",
    "Choice",
    "DeviceRoom",
    "Ended",
    "KnownRegistration",
    "MovedMarker",
    "Place",
    "PointPair",
    "Poses",
    "Prediction",
    "Reach",
    "RecordedStep",
    "Registered",
    "RegistrationReport",
    "RegistrationSession",
    "RegistrationState",
    "Room",
    "Searching",
    "SeenMarker",
    "SessionPlan",
    "SessionRecord",
    "SimulatedRoom",
    "SimulatedRoomSettings",
    "SimulatedTruth",
    "Spot",
    "SpotRefused",
    "SpotSeen",
    "Step",
    "StereoSettings",
    "TakenMarker",
    "Waiting",
    "camera_shared_m",
    "camera_text",
    "choose",
    "davinci_to_probe_home",
    "default_folder",
    "focal_shared_m",
    "follow_session",
    "is_running",
    "point_pairs",
    "read_registration",
    "read_session",
    "read_stereo",
    "register_pairs",
    "session_folder",
    "spot_pairs",
    "target_pixels",
    "trus_shared_m",
]
