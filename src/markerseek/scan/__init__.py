"""The measuring loop: `Scanner` takes one acquisition at one angle, `run` drives a policy over it.

A recorded scan over all angles is a bank (`markerseek.records.banks`).
"""

from markerseek.scan.confirmation import SEEN_SIGMAS, moved_source
from markerseek.scan.loop import AnyScanner, RunLimits, run
from markerseek.scan.scanner import DeadMan, Scanner

__all__ = ["SEEN_SIGMAS", "AnyScanner", "DeadMan", "RunLimits", "Scanner", "moved_source", "run"]
