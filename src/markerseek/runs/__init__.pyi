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
from .former_runs import JournalSummary, former_curve, journal_summary, read_marker
from .image_ring import ImageRing, hand_images_on
from .journalled import configuration_of
from .own_method import own_errors, own_method, require_own
from .rebuild import answer_again, rebuild_image_reader, rebuild_policy, rebuild_reader
from .recorded_rig import rebuild_rig, recorded_bench, require_same_measurement
from .resume import require_reset, tell_recorded
from .run import Run, answer_from_all, find_marker, new_run, plan_on, require_possible, resumed_run

__all__ = [
    "Calibration",
    "DelayRun",
    "ImageRing",
    "JournalSummary",
    "MeasuredDelay",
    "Run",
    "answer_again",
    "answer_from_all",
    "bank_curve",
    "bank_facts",
    "bank_image",
    "bank_images",
    "bank_samples",
    "calibrate",
    "configuration_of",
    "dark_intensity",
    "find_marker",
    "former_curve",
    "hand_images_on",
    "intensities_stored",
    "journal_bank",
    "journal_summary",
    "new_run",
    "own_errors",
    "own_method",
    "plan_on",
    "read_marker",
    "rebuild_image_reader",
    "rebuild_policy",
    "rebuild_reader",
    "rebuild_rig",
    "recorded_bench",
    "require_new_scan",
    "require_own",
    "require_possible",
    "require_reset",
    "require_same_measurement",
    "resumed_run",
    "scan_angles",
    "scan_bank",
    "tell_recorded",
]
