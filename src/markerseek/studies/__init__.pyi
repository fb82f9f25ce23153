from .bound import BoundComparison, compare_with_bound, mean_bounds
from .bound_figure import error_figure
from .policies import PolicySettings
from .runner import FinishedStudy, run_study
from .scene import ClutterAround, Repeats, SceneSettings, SecondSource
from .settings import Axis, CellWorld, CurveSettings
from .statistics import Mean, Share
from .study import Cell, Study, cells
from .study_file import read_study
from .summary import FAILURE_DEG, Difference, PolicySummary, Summary, TwoSources, summarise
from .table import columns, read_rows, values_of
from .tracking import Track, track
from .trial import Row, run_row, run_trial
from .workers import default_workers
from .worlds import intensity_curve

__all__ = [
    "FAILURE_DEG",
    "Axis",
    "BoundComparison",
    "Cell",
    "CellWorld",
    "ClutterAround",
    "CurveSettings",
    "Difference",
    "FinishedStudy",
    "Mean",
    "PolicySettings",
    "PolicySummary",
    "Repeats",
    "Row",
    "SceneSettings",
    "SecondSource",
    "Share",
    "Study",
    "Summary",
    "Track",
    "TwoSources",
    "cells",
    "columns",
    "compare_with_bound",
    "default_workers",
    "error_figure",
    "intensity_curve",
    "mean_bounds",
    "read_rows",
    "read_study",
    "run_row",
    "run_study",
    "run_trial",
    "summarise",
    "track",
    "values_of",
]
