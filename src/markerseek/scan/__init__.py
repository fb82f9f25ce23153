"""The measuring loop: `Scanner` takes one acquisition at one angle, `run` drives a policy over it.

A recorded scan over all angles is a bank (`markerseek.records.banks`).
"""

from markerseek.scan.confirmation import apply_confirmation, larger_noise, moved_source
from markerseek.scan.followed_tissue import mean_displacement
from markerseek.scan.loop import RunLimits, Tally, run
from markerseek.scan.scanner import Scanner, Watchdog, per_energy
from markerseek.scan.sweeping import SweepingDevices, rest_to_rest_s

__all__ = [
    "RunLimits",
    "Scanner",
    "SweepingDevices",
    "Tally",
    "Watchdog",
    "apply_confirmation",
    "larger_noise",
    "mean_displacement",
    "moved_source",
    "per_energy",
    "rest_to_rest_s",
    "run",
]
