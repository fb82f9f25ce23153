"""What stands between a search and the devices: limits, leave to fire, admission of frames."""

from markerseek.guard.admission import Admission
from markerseek.guard.limits import Limits
from markerseek.guard.permits import FiringLimits, Permits

__all__ = ["Admission", "FiringLimits", "Limits", "Permits"]
