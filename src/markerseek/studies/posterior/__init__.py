"""A study against the limit: bounds for its markers, time of decisions, and the figure of errors."""

from markerseek.studies.posterior.against import Against, against_bound, marker_curve, mean_bounds
from markerseek.studies.posterior.figure import error_figure

__all__ = ["Against", "against_bound", "error_figure", "marker_curve", "mean_bounds"]
