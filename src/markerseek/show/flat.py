"""Answers and results as one flat JSON object, with the units in the names of its keys: what ``--json`` prints.

Only programs outside read these keys; inside, an answer is an `Estimate`, and a result holds it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from markerseek._version import __version__
from markerseek.core import Estimate, Found, Unsure
from markerseek.show.result import SearchResult, sample_row
from markerseek.show.words import answer_line, answer_name, answer_reason


def flat_answer(estimate: Estimate, *, as_published: bool = False) -> dict[str, object]:
    """Return an answer and its angle.

    ``as_published``: whether it is that of the paper's form of a method, which answers also where there is no marker,
    so that its uncertainty means nothing.
    """
    interval = estimate.interval95_deg
    certainty = {
        "sigma_deg": estimate.sigma_deg,
        "interval95_deg": None if interval is None else (interval.low_deg, interval.high_deg),
        "interval_kind": estimate.interval_kind,
    }
    return {
        "answer": answer_name(estimate),
        "reason": answer_reason(estimate),
        "angle_deg": estimate.mean_deg,
        **(dict.fromkeys(certainty) if as_published else certainty),
    }


def flat_line(flat: Mapping[str, Any]) -> str:
    """Return the answer of a flat result in one line, as `answer_line` has it."""
    return answer_line(
        flat["answer"],
        flat["angle_deg"],
        sigma_deg=flat.get("sigma_deg"),
        interval95_deg=flat.get("interval95_deg"),
        reason=flat.get("reason"),
        as_published=bool(flat.get("as_published")),
    )


def flat_result(result: SearchResult) -> dict[str, object]:
    """Return a result."""
    estimate = result.estimate
    marker = result.marker
    plan = result.run.plan
    facts = result.run.facts
    return {
        "found": result.found,
        **flat_answer(estimate, as_published=plan.as_published),
        "doubt": estimate.doubt if isinstance(estimate, Unsure) else None,
        "method": result.method,
        "as_published": plan.as_published,
        "rig": facts.kind,
        "emulated": facts.emulated,
        "half_width_m": None if plan.as_published else estimate.half_width_m,
        "marker_trus_m": None if marker is None else marker.position_m,
        "marker_sigma_m": None if marker is None or plan.as_published else marker.sigma_m,
        "candidates": result.candidates,
        "acquisitions": result.acquisitions,
        "refused": result.run.refused,
        "travel_deg": result.travel_deg,
        "elapsed_s": result.elapsed_s,
        "known_s": result.known_s,
        "confirmation": None if result.confirmation is None else sample_row(result.confirmation),
        "confirmed": result.confirmed,
        "floor": estimate.floor,
        "others": estimate.others,
        "surveyed": estimate.surveyed,
        "other_probability": estimate.other_probability,
        "curve": estimate.curve if isinstance(estimate, Found) else None,
        "samples": [sample_row(each) for each in result.samples],
        "truth_deg": facts.truth_deg,
        "reference_deg": facts.reference_deg,
        "error_deg": result.error_deg,
        "seed": facts.seed,
        "configuration": facts.fingerprint,
        "notes": result.notes,
        "outliers_deg": estimate.outliers_deg,
        "motion": estimate.motion,
        "near": None if result.near_evidence is None else plan.near,
        "near_evidence": result.near_evidence,
        "search": None if result.search is None else _flat_search(result.search),
        "version": __version__,
    }


def _flat_search(search: SearchResult) -> dict[str, object]:
    """Return what a search of a recording would have taken and said."""
    return {
        **flat_answer(search.estimate),
        "method": search.method,
        "error_deg": search.error_deg,
        "acquisitions": search.acquisitions,
        "travel_deg": search.travel_deg,
        "samples": [sample_row(each) for each in search.samples],
    }
