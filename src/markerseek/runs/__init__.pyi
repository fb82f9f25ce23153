from .bank_images import (
    bank_curve,
    bank_facts,
    bank_image,
    bank_images,
    bank_samples,
    dark_intensity,
    intensities_stored,
)
from .bank_scan import journal_bank, require_new_scan, scan_angles, scan_bank
from .calibration_scan import Calibration, calibrate
from .delay import DelayRun, MeasuredDelay
from .former_search import former_curve
from .journalled import configuration_of
from .points import point_pairs, spot_pairs
from .rebuild import (
    answer_again,
    rebuild_image_reader,
    rebuild_policy,
    rebuild_reader,
    rebuild_rig,
    recorded_bench,
    require_same_measurement,
)
from .registration import (
    TARGET_DEPTH_M,
    KnownRegistration,
    PointPair,
    RegistrationReport,
    read_registration,
    register_pairs,
)
from .resume import commanded_deg, require_reset, strongest_of, tell_recorded
from .run_curve import curve_of, mark_of, mean_deg, others_deg
from .run_view import FAULT_END, STOPPED, Phase, Point, RunView
from .session import Session, answer_from_all, find_marker, new_session, plan_on, resumed_session
from .shared_errors import FOCAL_LENGTH, camera_shared_m, focal_shared_m, trus_shared_m
from .simulated_registration import (
    GRID_STEP_M,
    MARKER_PLACES,
    REGISTRATION_TOLERANCE_MM,
    SimulatedScene,
    SimulatedTruth,
    simulate_registration,
)
from .stereo_files import StereoSettings, read_stereo
from .target_views import TargetView, target_views
from .verdict import Verdict, VerdictKind, numbers_of, verdict_of

__all__ = [
    "FAULT_END",
    "FOCAL_LENGTH",
    "GRID_STEP_M",
    "MARKER_PLACES",
    "REGISTRATION_TOLERANCE_MM",
    "STOPPED",
    "TARGET_DEPTH_M",
    "Calibration",
    "DelayRun",
    "KnownRegistration",
    "MeasuredDelay",
    "Phase",
    "Point",
    "PointPair",
    "RegistrationReport",
    "RunView",
    "Session",
    "SimulatedScene",
    "SimulatedTruth",
    "StereoSettings",
    "TargetView",
    "Verdict",
    "VerdictKind",
    "answer_again",
    "answer_from_all",
    "bank_curve",
    "bank_facts",
    "bank_image",
    "bank_images",
    "bank_samples",
    "calibrate",
    "camera_shared_m",
    "commanded_deg",
    "configuration_of",
    "curve_of",
    "dark_intensity",
    "find_marker",
    "focal_shared_m",
    "former_curve",
    "intensities_stored",
    "journal_bank",
    "mark_of",
    "mean_deg",
    "new_session",
    "numbers_of",
    "others_deg",
    "plan_on",
    "point_pairs",
    "read_registration",
    "read_stereo",
    "rebuild_image_reader",
    "rebuild_policy",
    "rebuild_reader",
    "rebuild_rig",
    "recorded_bench",
    "register_pairs",
    "require_new_scan",
    "require_reset",
    "require_same_measurement",
    "resumed_session",
    "scan_angles",
    "scan_bank",
    "simulate_registration",
    "spot_pairs",
    "strongest_of",
    "target_views",
    "tell_recorded",
    "trus_shared_m",
    "verdict_of",
]
