from .bank_images import (
    bank_curve,
    bank_facts,
    bank_image,
    bank_images,
    bank_samples,
    dark_intensity,
    intensities_stored,
)
from .bank_of_journal import journal_bank
from .bank_scan import scan_angles, scan_bank, scan_configuration
from .calibration_scan import Calibration, calibrate
from .former_search import former_curve
from .journalled import configuration_of
from .points import point_pairs, spot_pairs
from .rebuild import next_angle, rebuild_image_reader, rebuild_policy, rebuild_reader, rebuild_rig, recorded_bench
from .recheck import samples_to_recheck
from .recompute import recompute_differences
from .registration import TARGET_DEPTH_M, PointPair, RegistrationReport, register_pairs
from .registration_file import KnownRegistration, read_registration
from .resume import require_reset
from .same_bench import require_same_measurement
from .session import Session, find_marker, new_session, plan_on, resumed_session
from .shared_errors import FOCAL_LENGTH, camera_shared_m, focal_shared_m, trus_shared_m
from .simulated_registration import (
    GRID_STEP_M,
    MARKER_PLACES,
    REGISTRATION_TOLERANCE,
    SimulatedScene,
    SimulatedTruth,
    simulate_registration,
)
from .stereo_files import StereoSettings, read_stereo
from .target_views import TargetView, target_views
from .tracking import (
    AnyTrackingPolicy,
    TrackQuality,
    quality_of,
    require_streaming,
    stage_period_s,
    swept_tracking_policy,
    track_run,
    tracking_policy,
)
from .whole_recording import answer_from_all

__all__ = [
    "FOCAL_LENGTH",
    "GRID_STEP_M",
    "MARKER_PLACES",
    "REGISTRATION_TOLERANCE",
    "TARGET_DEPTH_M",
    "AnyTrackingPolicy",
    "Calibration",
    "KnownRegistration",
    "PointPair",
    "RegistrationReport",
    "Session",
    "SimulatedScene",
    "SimulatedTruth",
    "StereoSettings",
    "TargetView",
    "TrackQuality",
    "answer_from_all",
    "bank_curve",
    "bank_facts",
    "bank_image",
    "bank_images",
    "bank_samples",
    "calibrate",
    "camera_shared_m",
    "configuration_of",
    "dark_intensity",
    "find_marker",
    "focal_shared_m",
    "former_curve",
    "intensities_stored",
    "journal_bank",
    "new_session",
    "next_angle",
    "plan_on",
    "point_pairs",
    "quality_of",
    "read_registration",
    "read_stereo",
    "rebuild_image_reader",
    "rebuild_policy",
    "rebuild_reader",
    "rebuild_rig",
    "recompute_differences",
    "recorded_bench",
    "register_pairs",
    "require_reset",
    "require_same_measurement",
    "require_streaming",
    "resumed_session",
    "samples_to_recheck",
    "scan_angles",
    "scan_bank",
    "scan_configuration",
    "simulate_registration",
    "spot_pairs",
    "stage_period_s",
    "swept_tracking_policy",
    "target_views",
    "track_run",
    "tracking_policy",
    "trus_shared_m",
]
