"""Many runs, one table: a study is policies × worlds × trials, run on processes or a cluster, and summarised."""

from markerseek.studies.runner import Finish, run_study
from markerseek.studies.study import Axis, Cell, CurveSettings, PolicySettings, Study, World, cells, read_study
from markerseek.studies.summary import FAILURE_DEG, Difference, PolicySummary, Summary, summarise
from markerseek.studies.table import read_rows
from markerseek.studies.trial import Row, intensity_curve, run_row, run_trial

__all__ = [
    "FAILURE_DEG",
    "Axis",
    "Cell",
    "CurveSettings",
    "Difference",
    "Finish",
    "PolicySettings",
    "PolicySummary",
    "Row",
    "Study",
    "Summary",
    "World",
    "cells",
    "intensity_curve",
    "read_rows",
    "read_study",
    "run_row",
    "run_study",
    "run_trial",
    "summarise",
]
