"""The heart: `Scanner` measures at one angle, `run` drives a policy over it."""

from markerseek.scan.loop import RunLimits, run
from markerseek.scan.scanner import DeadMan, Scanner

__all__ = ["DeadMan", "RunLimits", "Scanner", "run"]
