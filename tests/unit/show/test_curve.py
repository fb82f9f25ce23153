"""The model of a curve: what is claimed, what is shown, and when."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest
from msgspec import structs

import markerseek
from markerseek.core import (
    PAPER_RANGE,
    Ambiguous,
    AngleBelief,
    AtBound,
    Estimate,
    Floor,
    Found,
    Interval,
    NotFound,
    OtherSource,
    RigFacts,
    SearchPlan,
    Unsure,
)
from markerseek.records.journal import RunView
from markerseek.show import DrawnCurve, drawn_curve

EXAMPLES = Path(__file__).parents[3] / "examples"
INTERVAL = Interval(low_deg=2.8, high_deg=3.2)
KNOWN: dict[str, Any] = {"sigma_deg": 0.1, "interval95_deg": INTERVAL, "interval_kind": "posterior"}
FLOOR = Floor(level=120.0, source="dark frames")
FOUND = Found(mean_deg=3.0, floor=FLOOR, **KNOWN)


def curve_after(estimate: Estimate | None, *, phase: Any = "finished", **known: Any) -> DrawnCurve:
    belief = None if estimate is None else AngleBelief(estimate=estimate, **known)
    facts = RigFacts(kind="simulated", description="", fingerprint="", search=PAPER_RANGE, truth_deg=3.1)
    view = RunView(plan=SearchPlan(method="ternary"), facts=facts, phase=phase, belief=belief)
    return drawn_curve(view, reveal=False)


@pytest.mark.parametrize(
    ("estimate", "answers", "said"),
    [
        (FOUND, ["3.00°"], "marker at 3.00°"),
        (NotFound(mean_deg=1.7, reason="noise"), [], "no marker was detected"),
        (
            Ambiguous(mean_deg=-24.9, modes_deg=(-24.9, 0.8), **KNOWN),
            ["−24.90°?", "0.80°?"],
            "no marker is claimed; it may be at −24.90° or 0.80°",
        ),
        (AtBound(mean_deg=-35.0, side="low"), ["−35.00°"], "no marker is claimed; best guess −35.00°"),
        (
            Unsure(mean_deg=3.0, reason="too wide", doubt="width", **KNOWN),
            ["3.00°"],
            "no marker is claimed; best guess 3.00°",
        ),
    ],
    ids=lambda each: type(each).__name__ if not isinstance(each, str | list) else "",
)
def test_each_answer_says_what_it_claims(estimate: Estimate, answers: list[str], said: str) -> None:
    curve = curve_after(estimate)
    assert [each.text for each in curve.answers] == answers
    assert curve.answer_text == said
    assert curve.is_claimed == isinstance(estimate, Found)


def test_an_angle_is_claimed_only_at_the_end_and_never_by_the_form_of_the_paper() -> None:
    so_far = curve_after(FOUND, phase="moving")
    assert (so_far.is_claimed, so_far.answer_text) == (False, "no marker is claimed; so far 3.00°")
    published = curve_after(FOUND, claims=False)
    assert (published.is_claimed, published.interval) == (False, None)
    assert published.answer_text == "no marker is claimed; angle of the method 3.00°"


def test_the_interval_is_that_of_one_source() -> None:
    interval = curve_after(FOUND).interval
    assert interval is not None
    assert (interval.low_deg, interval.high_deg, interval.text) == (2.8, 3.2, "95 % interval (posterior)")
    assert curve_after(Ambiguous(mean_deg=3.0, modes_deg=(3.0, 9.0), **KNOWN)).interval is None


def test_the_last_bracket_of_a_search_is_no_interval() -> None:
    found = Found(mean_deg=3.0, **KNOWN | {"interval_kind": "bracket"})
    curve = curve_after(found)
    assert curve.interval is None
    assert curve.bracket is not None
    assert (curve.bracket.low_deg, curve.bracket.high_deg, curve.bracket.text) == (2.8, 3.2, "last bracket")


def test_other_sources_are_those_beside_the_answer() -> None:
    others = tuple(OtherSource(angle_deg=at, sigma_deg=0.5, relative_db=-8.0) for at in (9.0, -20.0, 3.004))
    found = Found(mean_deg=3.0, others=others, **KNOWN)
    assert [each.text for each in curve_after(found).others] == ["−20.00°?", "9.00°?"]


def test_the_threshold_says_where_it_comes_from() -> None:
    threshold = curve_after(FOUND).threshold
    assert threshold is not None
    assert (threshold.level, threshold.text) == (120.0, "detection threshold (dark frames)")
    unknown = Found(mean_deg=3.0, floor=Floor(level=None, source="unknown"), **KNOWN)
    assert curve_after(unknown).threshold is None


def test_before_the_first_event_there_is_a_range_and_nothing_else() -> None:
    curve = curve_after(None, phase="ready")
    assert (curve.low_deg, curve.high_deg, curve.start_deg) == (PAPER_RANGE.low_deg, PAPER_RANGE.high_deg, None)
    assert (curve.marks, curve.answers, curve.answer_text, curve.known) == ((), (), "", None)
    assert curve.text == "intensity over the angle of the probe, measured 0 times"
    assert curve.top > 0


def test_a_result_has_the_curve_of_its_run_and_json_keeps_it() -> None:
    rig = markerseek.simulated(seed=2, marker_deg=-4.0)
    result = markerseek.find_marker(rig)
    curve = drawn_curve(result.run, reveal=True)
    assert result.found
    assert [mark.text for mark in curve.marks] == [*(str(n + 1) for n in range(result.acquisitions)), "✓"]
    swept = replace(result.run, plan=structs.replace(result.run.plan, sweep=True))
    assert {mark.text for mark in drawn_curve(swept, reveal=True).marks} == {"", "✓"}
    assert curve.known is not None
    assert curve.known.text == "truth −4.00°"
    # The density is there without a journal, too.
    peak = max(zip(curve.density_per_deg, curve.density_deg, strict=True))[1]
    assert peak == pytest.approx(result.angle_deg, abs=3 * result.estimate.sigma_deg)
    assert msgspec.json.decode(msgspec.json.encode(curve), type=DrawnCurve) == curve


def test_of_a_recording_the_marks_are_those_of_its_search_and_all_angles_are_the_recorded_curve() -> None:
    result = markerseek.find_marker(markerseek.replayed(EXAMPLES / "two_sources.csv"))
    curve = drawn_curve(result.run, reveal=True)
    assert result.search is not None
    assert len(curve.marks) == result.search.acquisitions
    assert curve.recorded_deg == tuple(each.angle_deg for each in result.samples)
    assert curve.recorded == tuple(each.reading.intensity for each in result.samples)
