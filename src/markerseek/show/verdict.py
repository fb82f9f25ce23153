"""What a run says: its verdict and its numbers, in words."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Literal, TypeAlias

from markerseek.core import AngleBelief
from markerseek.records.journal import RunView
from markerseek.show.log import FAULT_END, event_line
from markerseek.show.result import SearchResult
from markerseek.show.words import (
    NO_CLAIM,
    acquisitions_text,
    angle_text,
    answer_name,
    answer_reason,
    digits_of,
    interval_text,
    others_rows,
    sigma_text,
    time_text,
    with_minus,
)

VerdictKind: TypeAlias = Literal["idle", "busy", "found", "unsure", "nothing", "stopped", "fault"]
"""Kind of a verdict: its colour."""

ON_MARKER_DEG = 0.05
"""Distance from the angle of the marker below which the probe is on it, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a run says, in the order in which it is read.

    Attributes
    ----------
    word, kind
        The word of the badge, and its colour.
    lead
        What the angle is if it is not claimed.
    angle, sigma
        The angle, and its standard deviation.
    turn
        How far the probe has to turn.
    interval
        Where the marker is with 95 %.
    problem
        What went wrong, with its cure; empty but for a fault.
    reason
        Why the answer is so, in one sentence; at a fault what laser and stage did.
    next_step
        What a person can do next; at the end of a recording, what a search would have said.
    """

    word: str = "READY"
    kind: VerdictKind = "idle"
    lead: str = ""
    angle: str = ""
    sigma: str = ""
    turn: str = ""
    interval: str = ""
    problem: str = ""
    reason: str = ""
    next_step: str = ""


def verdict_of(view: RunView, *, next_step: str = "") -> Verdict:
    """Return the verdict after an event; an angle counts as found only once the search is over and says so.

    Parameters
    ----------
    view
        The run.
    next_step
        What a person can do next if the run has ended without an answer.
    """
    word, kind = _word(view)
    belief = view.belief
    if view.asked_deg is not None:
        # The line begins with what stands beside it in large letters.
        read = event_line(view).partition(": ")[2]
        angle = with_minus(f"{view.asked_deg:.1f}°")
        return Verdict(word="TURN", kind=kind, lead="turn the probe to", angle=angle, reason=read)
    next_step = next_step if kind in {"stopped", "fault"} else ""
    if view.finished is not None and view.finished.searched is not None:
        next_step = with_minus(f"a search would have said: {SearchResult.of(view).comparison}")
    reason = with_minus(_reason(view))
    if belief is None:
        angle = "" if view.over or kind == "idle" else "–"
        return Verdict(
            word=word, kind=kind, angle=angle, problem=with_minus(view.problem), reason=reason, next_step=next_step
        )
    angle = angle_text(belief) or "–"
    # Where the badge says it all, or no more will come, there is no angle to wait for.
    waits = not (kind == "nothing" and belief.claims) and not (view.over and angle == "–")
    return Verdict(
        word=word,
        kind=kind,
        lead=_lead(view, belief),
        angle=angle if waits else "",
        sigma=sigma_text(belief),
        # At a fault what went wrong counts; the interval so far is in the chart.
        interval="" if kind == "fault" else interval_text(belief),
        turn=_turn(view, belief) if kind == "found" else "",
        problem=with_minus(view.problem),
        reason=reason,
        next_step=next_step,
    )


def _word(view: RunView) -> tuple[str, VerdictKind]:
    if view.phase in {"fault", "cut off"}:
        return "FAULT", "fault"
    if view.phase == "stopped":
        return "STOPPED", "stopped"
    if view.phase == "finished" and view.belief is not None:
        if not view.belief.claims:
            return "NO CLAIM", "nothing"
        name = answer_name(view.belief.estimate)
        return name.upper(), "found" if name == "found" else "nothing" if name == "not found" else "unsure"
    if view.number == 0:
        return "READY", "idle"
    return ("CHECKING" if view.phase == "checking" else "SEARCHING"), "busy"


def _lead(view: RunView, belief: AngleBelief) -> str:
    if view.phase != "finished":
        return "so far"
    if not belief.claims:
        return "angle"
    return {"found": "", "ambiguous": "either"}.get(answer_name(belief.estimate), "best guess")


def _reason(view: RunView) -> str:
    belief = view.belief
    if view.phase in {"stopped", "fault", "cut off"}:
        # The log says how it ended, in the words of the badge, and after the problem what laser and stage did.
        said = FAULT_END if view.phase == "fault" else event_line(view).removeprefix(f"{view.phase}: ")
        return said.removeprefix(with_minus(view.problem)).removeprefix("; ")
    if view.dark and not view.points:
        return f"measuring the noise, laser off, {view.dark} of {max(view.dark, view.plan.dark_frames)}"
    if belief is None:
        return "" if view.number else "nothing measured yet"
    if not belief.claims:
        return NO_CLAIM
    reason = answer_reason(belief.estimate) or ""
    if view.phase == "finished":
        return reason
    return f"so far {answer_name(belief.estimate)}" + (f": {reason}" if reason else "")


def _turn(view: RunView, belief: AngleBelief) -> str:
    """Return how far the probe has to turn to the marker; empty if nothing turns."""
    if view.facts.kind == "replayed" or view.probe_deg is None:
        return ""
    turn_deg = belief.estimate.mean_deg - view.probe_deg
    if abs(turn_deg) > ON_MARKER_DEG:
        return with_minus(f"turn by {turn_deg:+.1f}°")
    return with_minus(f"the probe is on it, turned by {view.probe_deg - view.start_deg:+.1f}°")


def numbers_of(view: RunView, *, name: str, pulse_j: float | None = None) -> list[tuple[str, str]]:
    """Return names and formatted values of a run, besides its verdict.

    Parameters
    ----------
    view
        The run.
    name
        What is run: method, form and seed.
    pulse_j
        Energy of one pulse in joules; None if it is not known.
    """
    belief = view.belief
    simulated = view.facts.kind == "simulated"
    rows = [
        ("search", name),
        ("acquisitions", acquisitions_text(view.acquisitions, view.refused)),
        ("rotation", f"{view.travel_deg:.1f}°"),
        ("time", time_text(view.elapsed_s, known_s=view.known_s, simulated=simulated)),
        ("peak SNR", _snr(view)),
        ("detection threshold", "unknown" if view.floor_level is None else f"{view.floor_level:.4g} {view.unit}"),
        ("pulses", str(view.pulses)),
    ]
    if view.finished is not None and view.finished.near is not None and view.plan.near is not None:
        rows.append(("prior", with_minus(view.finished.near.said(view.plan.near))))
    if belief is not None:
        estimate = belief.estimate
        others = [with_minus(f"{each.relative_db:+.1f} dB at {each.angle_deg:.2f}°") for each in estimate.others]
        none = "none seen" if belief.angles_deg else "not looked for"
        rows.append(("other sources", ", ".join(others[:2]) or none))
        rows += others_rows((), estimate.surveyed, estimate.other_probability)
        if view.target_deg is not None and belief.choice_deg:
            place = min(bisect_left(belief.choice_deg, view.target_deg), len(belief.choice_deg) - 1)
            sigma_deg = belief.choice_sigma_deg[place]
            rows.append(("expected next", f"± {sigma_deg:.{digits_of(sigma_deg)}f}°"))
    if pulse_j is not None:
        rows.append(("light", f"{view.pulses * pulse_j * 1e3:.3g} mJ"))
    return rows


def _snr(view: RunView) -> str:
    """Return the largest intensity over the noise, or that it is below the threshold."""
    if view.snr_db is None:
        return "–"
    below = view.floor_level is not None and view.strongest <= view.floor_level
    return "below the threshold" if below else f"{view.snr_db:.1f} dB"
