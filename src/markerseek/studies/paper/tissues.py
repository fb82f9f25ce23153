"""Table 2's setting on the four tissues: the paper's methods and the posterior as `markerseek search` runs it.

The paper searched online on the phantom only; of the tissues it prints the offline numbers of Table 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from markerseek.core import Found, Unsure
from markerseek.studies.paper.banks import TISSUES
from markerseek.studies.paper.methods import PAPER_METHODS
from markerseek.studies.paper.online import OnlineMethod, OnlineRun, OnlineSearch, search_online, visits
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import MATERIALS, OwnNumber
from markerseek.studies.paper.section import (
    ERRORS,
    Cell,
    Comparison,
    Section,
    compared,
    errors_of,
    make_section,
    make_table,
    summary_of,
)
from markerseek.studies.statistics import root_mean_square

PEAK_SNR_DB = 40.0
"""Noise of the simulated rig by default."""

METHODS: tuple[OnlineMethod, ...] = (*PAPER_METHODS, "posterior, survey")

SEARCHED = tuple(material for material in MATERIALS if material != "Plastisol Phantom")
"""The tissues: the phantom is in Table 2."""


def tissues(options: RunOptions) -> Section:
    """Errors, acquisitions and coverage of the online searches on each tissue."""
    runs = [
        OnlineRun(
            method=name,
            peak_snr_db=PEAK_SNR_DB,
            repeat=repeat,
            position=position,
            marker=marker,
            seed=seed,
            tissue=TISSUES[material],
            peak_counts=None,
        )
        for material in SEARCHED
        for repeat, position, marker, seed in visits(options)
        for name in METHODS
    ]
    searches = options.each(search_online, runs, stage="online searches on tissues, from channel data")
    rows: list[tuple[Cell, ...]] = []
    comparisons: list[Comparison] = []
    for material in SEARCHED:
        for name in METHODS:
            found = [each for each in searches if (each.tissue, each.method) == (TISSUES[material], name)]
            errors = summary_of(each.table_answer for each in found)
            counts = errors_of(float(each.table_acquisitions) for each in found)
            measured = (counts.mean_deg, 1 - errors.unclaimed, *_millimetres(found), _covered(found))
            rows.append((material, name, *measured, *errors.cells))
            ours = f"posterior (ours) online on {material}"
            if name in PAPER_METHODS:
                comparisons.append(compared(f"table1/{name}/{material}", errors, condition="ours online"))
            else:
                comparisons.append(compared(OwnNumber(quantity=f"{ours}, mean error"), errors))
                ended = OwnNumber(quantity=f"{ours}, acquisitions until it ended", unit="acquisitions")
                comparisons.append(
                    Comparison(paper=ended, ours=counts.mean_deg, sd=counts.sd_deg, half=counts.half_deg)
                )
    return make_section(
        "tissues",
        comparisons=tuple(comparisons),
        tables=(
            make_table(
                "tissues",
                "Errors of the online searches on the tissues, in degrees and along the turn at the marker",
                f"material method acquisitions found mean_error_mm rms_error_mm intervals_that_cover {ERRORS}",
                rows,
            ),
        ),
        level=PEAK_SNR_DB,
        visits=len(searches) // len(METHODS) // len(SEARCHED),
    )


def _millimetres(found: Sequence[OnlineSearch]) -> tuple[float, float]:
    """Mean and root mean square of the errors along the turn at the marker, in mm."""
    errors_mm = [1e3 * each.marker.radius_m * math.radians(each.table_answer.error_deg) for each in found]
    return float(np.mean(errors_mm)), root_mean_square(errors_mm)


def _covered(found: Sequence[OnlineSearch]) -> float | None:
    """Share of the 95 % intervals that hold the truth; None where no answer has one."""
    answers = [(each.estimates[each.table_acquisitions], each.truth_deg) for each in found]
    held = [truth_deg in answer.interval95_deg for answer, truth_deg in answers if isinstance(answer, Found | Unsure)]
    return float(np.mean(held)) if held else None
