"""Many runs, one table: a study is policies × worlds × trials, run on processes or a cluster, and summarised."""

from markerseek.studies.policies import PolicySettings
from markerseek.studies.runner import Finish, run_study
from markerseek.studies.settings import Axis, CurveSettings, World
from markerseek.studies.study import Cell, Study, cells
from markerseek.studies.study_file import read_study
from markerseek.studies.summary import Difference, Summary, summarise
from markerseek.studies.table import read_rows
from markerseek.studies.tally import FAILURE_DEG, PolicySummary
from markerseek.studies.trial import Row, run_row, run_trial
from markerseek.studies.worlds import intensity_curve

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
