"""What a rig must be told about itself, from one scan of a point source: angle, radius, speed, trigger. Pure."""

from markerseek.calibration.elevation import Geometry, Value, Waves, fit_geometry
from markerseek.calibration.moveout import Moveout, apex_s, fit_moveout
from markerseek.calibration.requirements import HEARD_RATIO, require_peak

__all__ = [
    "HEARD_RATIO",
    "Geometry",
    "Moveout",
    "Value",
    "Waves",
    "apex_s",
    "fit_geometry",
    "fit_moveout",
    "require_peak",
]
