"""Fig. 5: the three searches on 1000 random markers (section 2.4), from curves; a tenth of them also from frames."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from markerseek.core import PAPER_RANGE, Float64
from markerseek.studies.paper.curve_runs import USUAL, Condition, MarkerAnswers, over_trials, study_of
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
    summary_of,
)
from markerseek.studies.paper.style import Panel, errors_figure
from markerseek.studies.policies import PolicySettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FITTED = Condition(source_radius_m=0.35e-3, peak_snr_db=80.0)
"""The combination of width and noise with the Fig. 5 nearest to the paper's: not chosen by hand, but the result of
`reproduce consistency` with its usual seed and number of markers, which also prints it."""

FRAME_SHARE = 0.1
"""Share of the markers that are also searched from frames."""

FRAME_SNR_DB = 50.0
"""Peak SNR from frames: noise that is larger than the steps of a 12-bit converter."""

FRAME_SWEEPS = (8, 18, 28)
"""N of the full scans of WA from frames: all of them would take ten times as long."""

FRAME_BRACKETS = (2, 8, 16, 28)
"""N of TS and GSS that are compared between curves and frames."""

POSTERIOR_SHARE = 0.2
"""Share of the markers that the posterior searches for: it computes a hundred times as long as TS."""

POSTERIOR_COUNTS = (8, 16, 28)
"""N of the posterior that stand beside the paper's numbers."""
_ALL_OF_THE_POSTERIOR = PolicySettings(method="posterior", acquisitions=28, early_end=False, others=0.0)

_METHOD = (
    "Markers spread evenly over ±35°, the published searches, full scans of WA, threshold 0.2. The intensity curve is "
    "computed by the acoustic model and the imaging chain for one absorber; its radius sets the width. Intensities are "
    "drawn with the statistics of the peak of a noisy envelope image."
)
_POSTERIOR = (
    "The posterior is markerseek's own search, and not in the paper. It makes exactly N acquisitions after three dark "
    "frames, knows that there is one source, as the paper's searches assume, and searches for the first {markers} of "
    "the markers. Its mean error is that of all its answers, those without a claim included: not found, at bound, "
    "ambiguous or unsure. The paper's searches always claim an angle."
)

_Summary: TypeAlias = Mapping[tuple[AnyMethod, int], Errors]
"""Errors over the markers, by method and number of acquisitions."""

_NoiseFree: TypeAlias = Mapping[PaperMethod, Mapping[int, Errors]]
"""Errors without noise, by method and number of acquisitions."""


def fig5(options: RunOptions) -> Section:
    """Fig. 5: mean error over the number of acquisitions, for the rig's defaults and for the nearest condition."""
    conditions = (FITTED, USUAL)
    studies = [
        study_of(condition, seed=options.seed, trials=options.markers, sweeps=AVERAGE_ACQUISITIONS)
        for condition in conditions
    ]
    by_marker = over_trials(studies, options, stage="Fig. 5 from curves")
    fewer = max(4, round(POSTERIOR_SHARE * options.markers))
    by_posterior = over_trials(
        [replace(study, trials=fewer, policies=(_ALL_OF_THE_POSTERIOR,)) for study in studies],
        options,
        stage=f"Fig. 5, posterior, {fewer} markers",
        part=5,
    )
    errors = {
        condition: {**_summary(found), **_summary(ours)}
        for condition, found, ours in zip(conditions, by_marker, by_posterior, strict=True)
    }
    rng = np.random.Generator(np.random.PCG64(options.seed))
    markers_deg = rng.uniform(PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, 500)
    noise_free = {name: _noise_free_errors(name, markers_deg) for name in BRACKETS}
    return Section(
        name="fig5",
        title=f"Fig. 5: {options.markers} random markers, mean error over the number of acquisitions",
        method=(
            _METHOD,
            (
                f"Two conditions: {USUAL.words}, the defaults of the simulated rig; and {FITTED.words}, the condition "
                "with the numbers nearest to the paper's in the sweep of the section on consistency."
            ),
            _POSTERIOR.format(markers=fewer),
        ),
        comparisons=_comparisons(errors),
        tables=(
            Table(
                name="fig5",
                caption="Errors over the number of acquisitions",
                rows=tuple(
                    {
                        "source_radius_mm": 1e3 * condition.source_radius_m,
                        "peak_snr_db": condition.peak_snr_db,
                        "method": name,
                        "acquisitions": count,
                        **each.cells,
                    }
                    for condition, by_group in errors.items()
                    for (name, count), each in by_group.items()
                ),
                shown=False,
            ),
            _noise_free_table(noise_free),
            _frames_and_curves(options),
        ),
        draw=partial(_draw, errors),
        alt="Mean error of TS, GSS, WA and the posterior over the number of acquisitions, one panel for each condition",
        remarks=_remarks(noise_free),
    )


def _summary(by_marker: Sequence[MarkerAnswers]) -> _Summary:
    return {key: summary_of(answers[key] for answers in by_marker) for key in by_marker[0]}


def _comparisons(by_condition: Mapping[Condition, _Summary]) -> tuple[Comparison, ...]:
    comparisons = []
    for condition, errors in by_condition.items():
        # The paper prints one number for WA: the mean of its mean errors over N, and their scatter over N.
        sweeps = [errors["WA", count] for count in AVERAGE_ACQUISITIONS]
        means_deg = [sweep.mean_deg for sweep in sweeps]
        comparisons.append(
            Comparison(
                paper=paper_number("fig5/WA"),
                ours=float(np.mean(means_deg)),
                sd=float(np.std(means_deg, ddof=1)),
                failed=float(np.mean([sweep.failed for sweep in sweeps])),
                condition=condition.words,
            )
        )
        comparisons += [
            compared(f"fig5/{name}", errors[name, max(BRACKET_ACQUISITIONS)], condition=condition.words)
            for name in BRACKETS
        ]
        comparisons += [
            compared(
                OwnNumber(quantity=f"posterior (ours) after {count} acquisitions, mean error"),
                errors["posterior", count],
                condition=condition.words,
            )
            for count in POSTERIOR_COUNTS
        ]
    return tuple(comparisons)


def _noise_free_errors(name: PaperMethod, markers_deg: Float64[np.ndarray, " markers"]) -> dict[int, Errors]:
    """Errors without noise, by number of acquisitions: what the width of the last bracket leaves."""
    return {
        count: errors_of(abs(noise_free_track(name, at, acquisitions=count)[1] - at) for at in markers_deg.tolist())
        # The counts of section 4, of Table 1 and 2, and of Fig. 5.
        for count in (2, 16, 28)
    }


def _noise_free_table(noise_free: _NoiseFree) -> Table:
    """Errors without noise, beside the mean error of a marker that is equally likely anywhere in the last bracket."""
    # Part of the bracket that one iteration (two acquisitions) keeps.
    ratios = {"TS": 2 / 3, "GSS": (math.sqrt(5) - 1) / 2}
    return Table(
        name="fig5_without_noise",
        caption="Without noise, on any symmetric unimodal curve",
        rows=tuple(
            {
                "method": name,
                "acquisitions": count,
                "mean_error_deg": errors.mean_deg,
                "spread_deg": errors.sd_deg,
                # The middle of a bracket of width w is on average w/4 from a marker that is uniform in it.
                "quarter_of_the_last_bracket_deg": 70 * ratios[name] ** (count // 2) / 4,
            }
            for name, by_count in noise_free.items()
            for count, errors in by_count.items()
        ),
    )


def _frames_and_curves(options: RunOptions) -> Table:
    """Errors of the same markers from curves and from frames: paired differences; whether their interval covers 0."""
    condition = Condition(source_radius_m=FITTED.source_radius_m, peak_snr_db=FRAME_SNR_DB)
    markers = max(4, round(FRAME_SHARE * min(options.markers, PAPER_MARKERS)))
    by_curves = study_of(condition, seed=options.seed, trials=markers, sweeps=FRAME_SWEEPS)
    studies = [replace(by_curves, level="frames"), by_curves]
    # A trial from frames takes about a second.
    stage = f"Fig. 5 from frames, {markers} markers"
    frames, curves = over_trials(studies, options, stage=stage, part=2)
    rows: list[dict[str, Cell]] = []
    keys: list[tuple[PaperMethod, int]] = [(name, count) for name in BRACKETS for count in FRAME_BRACKETS]
    keys += [("WA", count) for count in FRAME_SWEEPS]
    for method, count in keys:
        by_curve = np.array([answers[method, count].error_deg for answers in curves])
        by_frame = np.array([answers[method, count].error_deg for answers in frames])
        paired = by_frame - by_curve
        # Paired, because markers and noise seeds are the same: most of the scatter cancels.
        half = 1.96 * float(np.std(paired, ddof=1)) / math.sqrt(paired.size)
        mean = float(paired.mean())
        # 1e-3 deg for rounding: bracket searches that compare alike have equal errors, and an interval of no width.
        agree = "yes" if abs(mean) <= half + 1e-3 else "no"
        rows.append(
            {
                "method": method,
                "acquisitions": count,
                "markers": paired.size,
                "from_curves_deg": float(by_curve.mean()),
                "from_frames_deg": float(by_frame.mean()),
                "difference_deg": mean,
                "half_interval95_deg": half,
                "agree": agree,
            }
        )
    return Table(
        name="fig5_frames",
        caption=f"The same markers from curves and from frames of channel data ({condition.words}); of these lines "
        "one in twenty may disagree by chance",
        rows=tuple(rows),
    )


def _remarks(noise_free: _NoiseFree) -> tuple[str, ...]:
    last = max(BRACKET_ACQUISITIONS)
    exact = 70 * (2 / 3) ** (last // 2) / 4
    return (
        (
            f"The paper's TS error after {last} acquisitions, {paper_number('fig5/TS')}, is 70°·(2/3)^14/4 = "
            f"{exact:.3f}°: the mean error of a marker that is equally likely anywhere in the last bracket. Searches "
            f"without noise give {noise_free['TS'][last].mean_deg:.3f}° for TS and "
            f"{noise_free['GSS'][last].mean_deg:.3f}° for GSS."
        ),
        (
            "A bracket search that once drops the part with the marker never finds it again: where the share of "
            "searches that are off by more than 4.33° is not zero, the mean error comes from those few."
        ),
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
