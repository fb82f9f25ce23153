"""Calibration from one scan of a point source: angle zero, face radius, speed of sound, trigger offset. Pure."""

from markerseek.calibration.elevation import (
    RECEIVED_RATIO,
    Fitted,
    Geometry,
    SourceWaves,
    fit_geometry,
    require_delays,
    require_peak,
)
from markerseek.calibration.moveout import Moveout, apex_s, fit_moveout

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
