"""How searches fail, as a table: share of runs with an error above 4.33°, and share that claim no angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.studies.paper.curve_runs import USUAL
from markerseek.studies.paper.failure_runs import (
    CASES,
    MARKERS_DEG,
    METHODS,
    WIDE,
    Outcomes,
    draw_runs,
    outcomes_of,
)
from markerseek.studies.paper.options import PAPER_MARKERS, RunOptions
from markerseek.studies.paper.printed import SENSITIVE_DEG
from markerseek.studies.paper.section import Cell, Section, Table
from markerseek.studies.statistics import Share, clopper_pearson

RUNS, FRAMED_RUNS = 120, 30
"""Markers of each case, and of one from frames, for as many markers as the paper has."""

CLOSE_DEG = 1.0
"""Error up to which an angle is close, in degrees: about 1 mm at the marker."""


def failures(options: RunOptions) -> Section:
    """Table of failures: share of runs with an error above 4.33°, and share that claim no angle."""
    rng = np.random.Generator(np.random.PCG64([options.seed, 9]))
    runs = []
    for name, case in CASES.items():
        # Fewer from frames: such a search takes some fifty times as long as one from curves.
        count = max(1, round((FRAMED_RUNS if case.frames else RUNS) * options.markers / PAPER_MARKERS))
        runs += draw_runs(name, count, rng)
    outcomes = outcomes_of(runs, options)
    return Section(
        name="failures",
        title="Failures: the paper's rules without a guard, and our guarded ones",
        method=(
            (
                f"Markers within ±{MARKERS_DEG:g}°, {WIDE.words} unless said otherwise ({USUAL.words} for the narrow "
                "curve). The paper's rules are those of a program without checks: every value counts as an intensity, "
                "TS and GSS make 28 acquisitions, WA goes in 5° steps and ends early. Ours are the checked forms of "
                "the same methods, and the posterior, with three dark frames, behind the guard's admission, with their "
                "default numbers of acquisitions. Markers and faults are the same for all."
            ),
            (
                f"Off: an angle is claimed and lies more than {SENSITIVE_DEG}° from the marker; without a marker, from "
                "where it would have been; with a moving marker, from its last place, so that a search that ended "
                "before the move, as the posterior's does, is off by the move. No angle: refused, not found, at a "
                "bound or unsure; with the paper's rules, a result of NaN."
            ),
        ),
        tables=(_table(outcomes),),
        remarks=_remarks(outcomes),
    )


def _table(outcomes: Outcomes) -> Table:
    rows: list[dict[str, Cell]] = []
    for (case, rules, method), errors_deg in outcomes.items():
        claimed_deg = [error_deg for error_deg in errors_deg if error_deg is not None]
        off, close = share_off(errors_deg), share_off(errors_deg, limit_deg=CLOSE_DEG)
        low, high = off.interval95 or (None, None)
        rows.append(
            {
                "fault": CASES[case].words,
                "method": method,
                "rules": rules,
                "runs": len(errors_deg),
                "off": off.share,
                "low95": low,
                "high95": high,
                "off_by_1_deg": close.share,
                "off_by_1_deg_high95": (close.interval95 or (None, None))[1],
                "no_angle": 1 - len(claimed_deg) / len(errors_deg),
                "mean_signed_error_deg": float(np.mean(claimed_deg)) if claimed_deg else None,
            }
        )
    return Table(
        name="failures",
        caption="Share of runs off by more than 4.33° with its 95 % interval (Clopper-Pearson), share off by "
        "more than 1° with its upper limit, share that claim no angle, and mean of the signed error",
        rows=tuple(rows),
    )


def share_off(errors_deg: Sequence[float | None], *, limit_deg: float = SENSITIVE_DEG) -> Share:
    """Return the share of runs that claim an angle with an error above the limit.

    ``errors_deg``: None where no angle was claimed. ``limit_deg``: largest error that does not count.
    """
    off = sum(error_deg is not None and abs(error_deg) > limit_deg for error_deg in errors_deg)
    return Share.of(off, len(errors_deg))


def _remarks(outcomes: Outcomes) -> tuple[str, ...]:
    remarks = []
    for rules, methods in METHODS.items():
        # Of the worst method: a mean over the methods would hide one that fails.
        worst = {
            case: max(
                (share_off(outcomes[case, rules, method]) for method in methods),
                key=lambda off: off.share or 0.0,
            )
            for case in CASES
        }
        wrong = ", ".join(f"{CASES[case].words} ({off.hits} of {off.count})" for case, off in worst.items() if off.hits)
        remarks.append(
            f"Faults under which a method with {rules.replace('ours', 'our')} rules claims a wrong angle, with the "
            f"number of runs of the worst method: {wrong or 'none'}."
        )
    counts = sorted({off.count for off in worst.values()})
    limits = ", ".join(f"{clopper_pearson(0, count)[1]:.2g} for {count}" for count in counts)
    remarks.append(f"Where no run of so many fails, the share of failures may still be up to (95 %): {limits}.")
    return tuple(remarks)
