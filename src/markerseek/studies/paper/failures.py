"""How searches fail, as a table: share of runs that are off by more than 4.33°, and share that claim no angle."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.failure_kinds import FAULTS, NARROW, WIDE
from markerseek.studies.paper.failure_runs import MARKERS_DEG, METHODS, Outcome, outcomes_of
from markerseek.studies.paper.reported import SENSITIVE_DEG
from markerseek.studies.paper.section import Cell, Section, Table
from markerseek.studies.statistics import Share, clopper_pearson

CLOSE_DEG = 1.0
"""Largest error of an angle that may be called found (promise P10)."""


def failures(effort: Effort) -> Section:
    """Table of failures: share of runs that are off by more than 4.33°, and share that claim no angle.

    Parameters
    ----------
    effort
        What may be used.
    """
    outcomes = outcomes_of(effort)
    return Section(
        name="failures",
        title="Failures: the paper's rules without a guard, and ours as they stand",
        method=(
            (
                f"Markers within ±{MARKERS_DEG:g}°, {WIDE.words} unless said otherwise ({NARROW.words} for the narrow "
                "curve). The paper's rules are written out as a program has them that checks nothing: what comes is "
                "taken for an intensity, TS and GSS make 28 acquisitions, WA goes in 5° steps and ends early. Ours are "
                "the guarded forms of the same methods, and the posterior, with three dark frames, behind the guard's "
                "admission, with their default numbers of acquisitions. All meet the same markers and the same faults."
            ),
            (
                f"Off: an angle is claimed and lies more than {SENSITIVE_DEG}° from the marker; without a marker, from "
                "where it would have been; of one that moves, from where it is then, so that a search that ended "
                "before, as the posterior's did, is off by as far. No angle: refused, not found, at a bound or unsure; "
                "of the bare rules, a result that is no number."
            ),
        ),
        tables=(_table(outcomes),),
        remarks=_remarks(outcomes),
    )


def _table(outcomes: Sequence[Outcome]) -> Table:
    rows: list[tuple[Cell, ...]] = []
    for fault, rules, method in dict.fromkeys((each.fault, each.rules, each.method) for each in outcomes):
        here = [o for o in outcomes if (o.fault, o.rules, o.method) == (fault, rules, method)]
        errors = [o.error_deg for o in here if o.error_deg is not None]
        off, close = share_off(here), share_off(here, limit_deg=CLOSE_DEG)
        rows.append(
            (
                FAULTS[fault].words,
                method,
                rules,
                len(here),
                off.share,
                *(off.interval95 or (None, None)),
                close.share,
                (close.interval95 or (None, None))[1],
                1 - len(errors) / len(here),
                float(np.mean(errors)) if errors else None,
            )
        )
    return Table(
        name="failures",
        caption="Share of runs off by more than 4.33° with its 95 % interval (Clopper-Pearson), share off by "
        "more than 1° with its upper limit, share that claim no angle, and mean of the signed error",
        columns=(
            "fault",
            "method",
            "rules",
            "runs",
            "off",
            "low95",
            "high95",
            "off_by_1_deg",
            "off_by_1_deg_high95",
            "no_angle",
            "mean_signed_error_deg",
        ),
        rows=tuple(rows),
    )


def share_off(outcomes: Sequence[Outcome], *, limit_deg: float = SENSITIVE_DEG) -> Share:
    """Return the share of runs that claim an angle and are off by more than the limit.

    Parameters
    ----------
    outcomes
        How the runs ended.
    limit_deg
        Largest error that is not off, in degrees.
    """
    errors = [each.error_deg for each in outcomes]
    return Share.of(sum(error is not None and abs(error) > limit_deg for error in errors), len(errors))


def _remarks(outcomes: Sequence[Outcome]) -> tuple[str, ...]:
    remarks = []
    for rules, methods in METHODS.items():
        worst = {
            fault: max(
                (
                    share_off([o for o in outcomes if (o.fault, o.rules, o.method) == (fault, rules, m)])
                    for m in methods
                ),
                key=lambda off: off.share or 0.0,
            )
            for fault in FAULTS
        }
        said = ", ".join(
            f"{FAULTS[fault].words} ({off.hits} of {off.count})" for fault, off in worst.items() if off.hits
        )
        remarks.append(
            f"Faults under which a method by {rules.replace('ours', 'our')} rules claims a wrong angle, "
            f"with the most of its runs: {said or 'none'}."
        )
    counts = sorted({off.count for off in worst.values()})
    limits = ", ".join(f"{clopper_pearson(0, count)[1]:.2g} for {count}" for count in counts)
    remarks.append(f"None of so many runs still leaves room for a share of (95 %): {limits}.")
    return tuple(remarks)
