"""The safety kernel between a search and the devices: limits, permits, admission of frames, and the rig's state."""

from markerseek.guard.admission import Admission
from markerseek.guard.lease import Lease
from markerseek.guard.limits import Limits
from markerseek.guard.machine import Guard, State
from markerseek.guard.permits import FiringLimits, Permits

__all__ = ["Admission", "FiringLimits", "Guard", "Lease", "Limits", "Permits", "State"]
