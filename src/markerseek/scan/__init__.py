"""The measuring loop: `Scanner` takes one acquisition at one angle, `run` drives a policy over it.

A recorded scan over all angles is a bank (`markerseek.records.banks`).
"""

from markerseek.scan.confirmation import SEEN_SIGMAS, larger_noise, moved_source
from markerseek.scan.loop import AnyScanner, RunLimits, run
from markerseek.scan.scanner import Scanner, Watchdog
from markerseek.scan.sweeping_devices import SweepingDevices

__all__ = [
    "SEEN_SIGMAS",
    "AnyScanner",
    "RunLimits",
    "Scanner",
    "SweepingDevices",
    "Watchdog",
    "larger_noise",
    "moved_source",
    "run",
]
