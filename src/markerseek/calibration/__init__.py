"""Calibration from one scan of a point source: angle zero, face radius, speed of sound, trigger offset. Pure."""

from markerseek.calibration.delays import require_delays
from markerseek.calibration.elevation import Fitted, Geometry, SourceWaves, fit_geometry
from markerseek.calibration.moveout import Moveout, apex_s, fit_moveout
from markerseek.calibration.requirements import RECEIVED_RATIO, require_peak

__all__ = [
    "RECEIVED_RATIO",
    "Fitted",
    "Geometry",
    "Moveout",
    "SourceWaves",
    "apex_s",
    "fit_geometry",
    "fit_moveout",
    "require_delays",
    "require_peak",
]
