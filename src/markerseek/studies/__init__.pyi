from .figure import error_figure
from .policies import StudyPolicy, study_policy
from .runner import FinishedStudy, columns, read_rows, run_study, values_of
from .study import Axis, Cell, CellWorld, CurveSettings, Study, cells, read_study
from .summary import Difference, Mean, PolicySummary, Share, Summary, TwoSources, summarise
from .trial import Row, run_row, run_trial
from .unknowns import ClutterAround, Repeats, SceneSettings, SecondSource
from .workers import default_workers
from .worlds import intensity_curve

__all__ = [
    "Axis",
    "Cell",
    "CellWorld",
    "ClutterAround",
    "CurveSettings",
    "Difference",
    "FinishedStudy",
    "Mean",
    "PolicySummary",
    "Repeats",
    "Row",
    "SceneSettings",
    "SecondSource",
    "Share",
    "Study",
    "StudyPolicy",
    "Summary",
    "TwoSources",
    "cells",
    "columns",
    "default_workers",
    "error_figure",
    "intensity_curve",
    "read_rows",
    "read_study",
    "run_row",
    "run_study",
    "run_trial",
    "study_policy",
    "summarise",
    "values_of",
]
