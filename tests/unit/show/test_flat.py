"""The JSON object of a result: its keys, and what it leaves out where the method claims nothing."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import msgspec
import pytest

import markerseek
from markerseek.core import Ambiguous, AtBound, Estimate, Found, Interval, NotFound, SearchPlan, Unsure
from markerseek.show import SearchResult, flat_answer, flat_result

SCAN = Path(__file__).parents[3] / "examples" / "simulated_scan.csv"
ANSWER = ("answer", "reason", "angle_deg", "sigma_deg", "interval95_deg", "interval_kind")
RESULT = (
    *("found", *ANSWER, "doubt", "method", "as_published", "rig", "emulated", "half_width_m"),
    *("marker_trus_m", "marker_sigma_m", "candidates", "acquisitions", "refused", "travel_deg", "elapsed_s", "known_s"),
    *("confirmation", "confirmed", "floor", "others", "surveyed", "other_probability", "curve", "samples"),
    *("truth_deg", "reference_deg", "error_deg", "seed", "configuration", "notes", "outliers_deg", "motion"),
    *("near", "near_evidence", "search", "version"),
)
SAMPLE = ("angle_deg", "intensity", "lateral_m", "depth_m", "arrival_s", "noise_sigma")
KNOWN: dict[str, Any] = {"sigma_deg": 0.1, "interval95_deg": Interval(low_deg=0.8, high_deg=1.2)}


def printed(result: SearchResult) -> dict[str, Any]:
    """The object as a program reads it."""
    value: dict[str, Any] = msgspec.json.decode(msgspec.json.encode(flat_result(result)))
    return value


def test_programs_find_every_key_in_any_result() -> None:
    page = (Path(__file__).parents[3] / "docs" / "reference" / "results.md").read_text(encoding="utf-8")
    for plan in (SearchPlan(method="posterior"), SearchPlan(method="ternary", as_published=True)):
        result = printed(markerseek.find_marker(markerseek.simulated(seed=1), plan))
        assert set(result) == set(RESULT)
        assert set(result["confirmation"]) == set(SAMPLE)
        assert all(set(each) == set(SAMPLE) for each in result["samples"])
    for key in ANSWER:
        assert f"`{key}`" in page


def test_a_recording_has_the_answer_of_its_search_beside_its_own() -> None:
    result = printed(markerseek.find_marker(markerseek.replayed(SCAN, reference_deg=-8.25), "ternary"))
    assert set(result) == set(RESULT)
    assert set(result["search"]) == {*ANSWER, "method", "error_deg", "acquisitions", "travel_deg", "samples"}
    assert (result["method"], result["search"]["method"]) == ("posterior", "ternary")
    assert (result["travel_deg"], result["elapsed_s"], result["known_s"]) == (None, None, None)
    assert len(result["search"]["samples"]) == result["search"]["acquisitions"] < result["acquisitions"]
    # From -35 degrees, where the recording begins, to each of its angles in turn.
    way = [-35.0, *(each["angle_deg"] for each in result["search"]["samples"])]
    travel = sum(abs(b - a) for a, b in pairwise(way))
    assert result["search"]["travel_deg"] == pytest.approx(travel, abs=1e-9)


def test_the_form_of_the_paper_states_no_uncertainty() -> None:
    plan = SearchPlan(method="ternary", as_published=True)
    result = markerseek.find_marker(markerseek.simulated(seed=1), plan)
    assert result.estimate.sigma_deg is not None
    assert (result.sigma_deg, result.interval95_deg, result.candidates) == (None, None, ())
    flat = flat_result(result)
    unknown = ("sigma_deg", "interval95_deg", "interval_kind", "half_width_m", "marker_sigma_m")
    assert [flat[name] for name in unknown] == [None] * 5
    assert flat["angle_deg"] == result.estimate.mean_deg


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        (Found(mean_deg=1.0, interval_kind="posterior", **KNOWN), ("found", None, 1.0, 0.1, (0.8, 1.2), "posterior")),
        (NotFound(mean_deg=1.0, reason="why"), ("not found", "why", 1.0, None, None, None)),
        (
            Unsure(mean_deg=1.0, interval_kind="bracket", reason="why", doubt="width", **KNOWN),
            ("unsure", "why", 1.0, 0.1, (0.8, 1.2), "bracket"),
        ),
        (
            Ambiguous(mean_deg=1.0, modes_deg=(1.0, 5.0)),
            ("ambiguous", "the samples fit a marker at each of 1.00 deg and 5.00 deg", 1.0, None, None, None),
        ),
        (
            AtBound(mean_deg=35.0, side="high"),
            (
                "at bound",
                "the intensity still rises at the high end of the range; shift the range towards it",
                *(35.0, None, None, None),
            ),
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_each_answer_by_its_keys(estimate: Estimate, expected: tuple[object, ...]) -> None:
    assert flat_answer(estimate) == dict(zip(ANSWER, expected, strict=True))
