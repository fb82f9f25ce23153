"""What stands between a search and the devices: limits, leave to fire, admission of frames, and the state of a rig."""

from markerseek.guard.admission import Admission
from markerseek.guard.lease import Lease
from markerseek.guard.limits import Limits
from markerseek.guard.machine import Guard, State
from markerseek.guard.permits import FiringLimits, Permits

__all__ = [
    "Admission",
    "FiringLimits",
    "Guard",
    "Lease",
    "Limits",
    "Permits",
    "State",
]
