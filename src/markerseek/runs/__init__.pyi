from .bank_images import bank_curve, bank_image, bank_images, bank_samples, dark_intensity, described
from .bank_of_journal import journal_bank
from .bank_scan import scan_angles, scan_bank
from .calibration_scan import Calibration, calibrate
from .former_marker import former_curve
from .rebuild import next_angle, rebuild_policy, rebuild_reader, rebuild_rig, recorded_bench
from .recheck import samples_to_recheck
from .recompute import differences
from .resume import require_reset
from .same_bench import require_same_measurement
from .session import Session, new_session, plan_on, resumed_session

__all__ = [
    "Calibration",
    "Session",
    "bank_curve",
    "bank_image",
    "bank_images",
    "bank_samples",
    "calibrate",
    "dark_intensity",
    "described",
    "differences",
    "former_curve",
    "journal_bank",
    "new_session",
    "next_angle",
    "plan_on",
    "rebuild_policy",
    "rebuild_reader",
    "rebuild_rig",
    "recorded_bench",
    "require_reset",
    "require_same_measurement",
    "resumed_session",
    "samples_to_recheck",
    "scan_angles",
    "scan_bank",
]
