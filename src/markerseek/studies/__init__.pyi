from .benchmark import WORLDS, BenchmarkResults, Entry, Score, benchmark_size, run_benchmark
from .bound import BoundComparison, compare_with_bound, error_figure, mean_bounds, require_bound
from .policies import PolicySettings
from .runner import FinishedStudy, columns, read_rows, run_study, values_of
from .scene import ClutterAround, Repeats, SceneSettings, SecondSource
from .statistics import Mean, Share
from .study import Axis, Cell, CellWorld, CurveSettings, Study, cells, read_study
from .summary import FAILURE_DEG, Difference, PolicySummary, Summary, TwoSources, summarise
from .tracking import SweptTrack, Track, track, track_by_sweeps
from .trial import Row, fault_of, run_row, run_trial
from .workers import default_workers
from .worlds import intensity_curve

__all__ = [
    "FAILURE_DEG",
    "WORLDS",
    "Axis",
    "BenchmarkResults",
    "BoundComparison",
    "Cell",
    "CellWorld",
    "ClutterAround",
    "CurveSettings",
    "Difference",
    "Entry",
    "FinishedStudy",
    "Mean",
    "PolicySettings",
    "PolicySummary",
    "Repeats",
    "Row",
    "SceneSettings",
    "Score",
    "SecondSource",
    "Share",
    "Study",
    "Summary",
    "SweptTrack",
    "Track",
    "TwoSources",
    "benchmark_size",
    "cells",
    "columns",
    "compare_with_bound",
    "default_workers",
    "error_figure",
    "fault_of",
    "intensity_curve",
    "mean_bounds",
    "read_rows",
    "read_study",
    "require_bound",
    "run_benchmark",
    "run_row",
    "run_study",
    "run_trial",
    "summarise",
    "track",
    "track_by_sweeps",
    "values_of",
]
