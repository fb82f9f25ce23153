"""A part of the markers of Fig. 5 from frames of channel data: the same searches, markers and noise as from curves."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from markerseek.studies.paper.curve_runs import Condition, errors_of_studies, study_of
from markerseek.studies.paper.effort import PAPER_MARKERS, Effort
from markerseek.studies.paper.methods import BRACKETS, Name
from markerseek.studies.paper.section import Cell, Table

SHARE = 0.1
"""Share of the markers that are searched from frames."""

PEAK_SNR_DB = 50.0
"""Noise that a 12-bit converter still shows."""

SWEEPS = (8, 18, 28)
"""N of the full scans of WA: one for every N would take ten times as long."""

NARROWED = (2, 8, 16, 28)
"""N of TS and GSS."""


def agreement(effort: Effort, *, source_radius_m: float) -> Table:
    """The same markers from curves and from frames: paired differences of the errors, and whether 0 is among them.

    Parameters
    ----------
    effort
        What may be used.
    source_radius_m
        Radius of the absorber in metres.
    """
    condition = Condition(source_radius_m=source_radius_m, peak_snr_db=PEAK_SNR_DB)
    markers = max(4, round(SHARE * min(effort.markers, PAPER_MARKERS)))
    levels: tuple[Literal["frames", "curves"], ...] = ("frames", "curves")
    studies = [study_of(condition, seed=effort.seed, trials=markers, sweeps=SWEEPS, level=level) for level in levels]
    frames, curves = errors_of_studies(studies, effort, what=f"Fig. 5 from frames, {markers} markers")
    rows: list[tuple[Cell, ...]] = []
    keys: list[tuple[Name, int]] = [(name, count) for name in BRACKETS for count in NARROWED]
    keys += [("WA", count) for count in SWEEPS]
    for key in keys:
        by_curve = np.array([errors[key] for errors in curves])
        by_frame = np.array([errors[key] for errors in frames])
        paired = by_frame - by_curve
        half = 1.96 * float(np.std(paired, ddof=1)) / math.sqrt(paired.size)
        mean = float(paired.mean())
        # Errors of a bracket are equal to rounding as long as both compare alike.
        agree = abs(mean) <= half + 1e-3
        rows.append(
            (*key, paired.size, float(by_curve.mean()), float(by_frame.mean()), mean, half, "yes" if agree else "no")
        )
    return Table(
        name="fig5_frames",
        caption=f"The same markers from curves and from frames of channel data ({condition.words}); of these lines "
        "one in twenty may disagree by chance",
        columns=(
            "method",
            "acquisitions",
            "markers",
            "from_curves_deg",
            "from_frames_deg",
            "difference_deg",
            "half_interval95_deg",
            "agree",
        ),
        rows=tuple(rows),
    )
