"""Fig. 5: the three searches on 1000 random markers (section 2.4), from curves; a tenth of them also from frames."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import PAPER_RANGE
from markerseek.studies.paper.curve_runs import USUAL, Condition, over_trials, study_of
from markerseek.studies.paper.methods import (
    AVERAGE_ACQUISITIONS,
    BRACKET_ACQUISITIONS,
    BRACKETS,
    AnyMethod,
    PaperMethod,
    noise_free_track,
)
from markerseek.studies.paper.options import PAPER_MARKERS, RunOptions
from markerseek.studies.paper.printed import OwnNumber, paper_number
from markerseek.studies.paper.section import (
    Cell,
    Comparison,
    Errors,
    Section,
    Table,
    compared,
    errors_of,
    errors_table,
    make_section,
    make_table,
    summary_of,
)
from markerseek.studies.paper.style import Panel, errors_figure
from markerseek.studies.policies import study_policy

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FITTED = Condition(source_radius_m=0.35e-3, peak_snr_db=80.0)
"""The combination of width and noise with the Fig. 5 nearest to the paper's: not chosen by hand, but the result of
`docs/explanation/measure_consistency.py`."""

POSTERIOR_SHARE = 0.2
"""Share of the markers that the posterior searches for: it computes a hundred times as long as TS."""

_ALL_OF_THE_POSTERIOR = study_policy(method="posterior", acquisitions=28, early_end=False, others=0.0)

_Summary: TypeAlias = Mapping[tuple[AnyMethod, int], Errors]
"""Errors over the markers, by method and number of acquisitions."""


def fig5(options: RunOptions) -> Section:
    """Fig. 5: mean error over the number of acquisitions, for the rig's defaults and for the nearest condition."""
    studies = [
        study_of(condition, seed=options.seed, trials=options.markers, sweeps=AVERAGE_ACQUISITIONS)
        for condition in (FITTED, USUAL)
    ]
    by_paper = over_trials(studies, options, stage="Fig. 5 from curves")
    fewer = max(4, round(POSTERIOR_SHARE * options.markers))
    by_posterior = over_trials(
        [replace(study, trials=fewer, policies=(_ALL_OF_THE_POSTERIOR,)) for study in studies],
        options,
        stage=f"Fig. 5, posterior, {fewer} markers",
        part=5,
    )
    errors: dict[Condition, _Summary] = {
        condition: {key: summary_of(each[key] for each in found) for found in both for key in found[0]}
        for condition, *both in zip((FITTED, USUAL), by_paper, by_posterior, strict=True)
    }
    rng = np.random.Generator(np.random.PCG64(options.seed))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, 500).tolist()
    # What the width of the last bracket leaves, for the counts of section 4, of the tables and of Fig. 5.
    noise_free = {
        (name, count): errors_of(abs(noise_free_track(name, at, acquisitions=count)[1] - at) for at in markers_deg)
        for name in BRACKETS
        for count in (2, 16, 28)
    }
    return make_section(
        "fig5",
        comparisons=tuple(each for condition in errors for each in _comparisons(condition, errors[condition])),
        tables=(
            errors_table(
                "fig5",
                "Errors over the number of acquisitions",
                "source_radius_mm peak_snr_db method acquisitions",
                {
                    (1e3 * condition.source_radius_m, condition.peak_snr_db, *key): each
                    for condition, by_key in errors.items()
                    for key, each in by_key.items()
                },
            ),
            _noise_free_table(noise_free),
            _frames_and_curves(options),
        ),
        draw=partial(_draw, errors),
        markers=options.markers,
        usual=USUAL.words,
        fitted=FITTED.words,
        fewer=fewer,
        paper=str(paper_number("fig5/TS")),
        exact=70 * (2 / 3) ** 14 / 4,
        ours={name: noise_free[name, 28].mean_deg for name in BRACKETS},
    )


def _comparisons(condition: Condition, errors: _Summary) -> Iterator[Comparison]:
    # The paper prints one number for WA: the mean of its mean errors over N, and their scatter over N.
    sweeps = [errors["WA", count] for count in AVERAGE_ACQUISITIONS]
    means_deg = [sweep.mean_deg for sweep in sweeps]
    yield Comparison(
        paper=paper_number("fig5/WA"),
        ours=float(np.mean(means_deg)),
        sd=float(np.std(means_deg, ddof=1)),
        failed=float(np.mean([sweep.failed for sweep in sweeps])),
        condition=condition.words,
    )
    for name in BRACKETS:
        yield compared(f"fig5/{name}", errors[name, max(BRACKET_ACQUISITIONS)], condition=condition.words)
    for count in (8, 16, 28):
        own = OwnNumber(quantity=f"posterior (ours) after {count} acquisitions, mean error")
        yield compared(own, errors["posterior", count], condition=condition.words)


def _noise_free_table(noise_free: Mapping[tuple[PaperMethod, int], Errors]) -> Table:
    """Errors without noise, beside the mean error of a marker that is equally likely anywhere in the last bracket."""
    # Part of the bracket that one iteration (two acquisitions) keeps.
    ratios = {"TS": 2 / 3, "GSS": (math.sqrt(5) - 1) / 2}
    return make_table(
        "fig5_without_noise",
        "Without noise, on any symmetric unimodal curve",
        "method acquisitions mean_error_deg spread_deg quarter_of_the_last_bracket_deg",
        (
            # The middle of a bracket of width w is on average w/4 from a marker that is uniform in it.
            (name, count, errors.mean_deg, errors.sd_deg, 70 * ratios[name] ** (count // 2) / 4)
            for (name, count), errors in noise_free.items()
        ),
    )


def _frames_and_curves(options: RunOptions) -> Table:
    """Errors of the same markers from curves and from frames: paired differences; whether their interval covers 0."""
    # 50 dB: noise that is larger than the steps of a 12-bit converter.
    condition = Condition(source_radius_m=FITTED.source_radius_m, peak_snr_db=50.0)
    markers = max(4, round(0.1 * min(options.markers, PAPER_MARKERS)))
    # Three of the full scans of WA: all of them would take ten times as long.
    sweeps = (8, 18, 28)
    by_curves = study_of(condition, seed=options.seed, trials=markers, sweeps=sweeps)
    # A trial from frames takes about a second.
    frames, curves = over_trials(
        [replace(by_curves, level="frames"), by_curves], options, stage=f"Fig. 5 from frames, {markers} markers", part=2
    )
    rows: list[tuple[Cell, ...]] = []
    keys: list[tuple[PaperMethod, int]] = [(name, count) for name in BRACKETS for count in (2, 8, 16, 28)]
    keys += [("WA", count) for count in sweeps]
    for key in keys:
        by_curve = np.array([answers[key].error_deg for answers in curves])
        by_frame = np.array([answers[key].error_deg for answers in frames])
        # Paired, because markers and noise seeds are the same: most of the scatter cancels.
        paired = by_frame - by_curve
        half, mean = 1.96 * float(np.std(paired, ddof=1)) / math.sqrt(paired.size), float(paired.mean())
        # 1e-3 deg for rounding: bracket searches that compare alike have an interval of no width.
        agree = "yes" if abs(mean) <= half + 1e-3 else "no"
        rows.append((*key, paired.size, float(by_curve.mean()), float(by_frame.mean()), mean, half, agree))
    return make_table(
        "fig5_frames",
        f"The same markers from curves and from frames of channel data ({condition.words}); of these lines "
        "one in twenty may disagree by chance",
        "method acquisitions markers from_curves_deg from_frames_deg difference_deg half_interval95_deg agree",
        rows,
    )


def _draw(by_condition: Mapping[Condition, _Summary]) -> Figure:
    printed_deg = {(name, 28): paper_number(f"fig5/{name}").value for name in BRACKETS}
    return errors_figure(
        [
            Panel(title=condition.words, errors=errors, printed_deg=printed_deg)
            for condition, errors in by_condition.items()
        ],
        heading="Random markers, searched on simulated intensity curves",
        columns=2,
        panel_in=(5.2, 3.8),
        average_deg=paper_number("fig5/WA").value,
    )
