"""The verdict of a run in words: the largest text of the page, which is read from two metres. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from markerseek.core import Ambiguous, AngleBelief, Found, Unsure
from markerseek.records import answer_name, answer_reason
from markerseek.runs import RunView, angle_text, digits_of, with_minus

Kind: TypeAlias = Literal["idle", "busy", "found", "unsure", "nothing", "stopped", "fault"]
"""Kind of a verdict: its colour."""

ON_MARKER_DEG = 0.05
"""Distance from the angle of the marker below which the probe is on it, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What a run says, in the order in which it is read."""

    word: str = "READY"
    kind: Kind = "idle"
    """``word`` and ``kind``: the word of the badge, and its colour."""
    lead: str = ""
    angle: str = ""
    sigma: str = ""
    """``lead``, ``angle`` and ``sigma``: what the angle is where it is not claimed, the angle, and its standard
    deviation."""
    interval: str = ""
    turn: str = ""
    """``interval`` and ``turn``: where the marker is with 95 %, and how far the probe has to turn."""
    problem: str = ""
    """What went wrong, with its cure; empty but for a fault."""
    reason: str = ""
    """Why it is so, in one sentence; at a fault what laser and stage did."""
    next_step: str = ""
    """What a person can do next while nothing runs, and where a person must arm the rig; at the end of a recording,
    what a search would have said."""

    @property
    def line(self) -> str:
        """The word and the angle in one line."""
        joined = " at" if self.kind == "found" else f", {self.lead}"
        return self.word.lower() + ("" if self.angle in {"", "–"} else f"{joined} {self.angle}{self.sigma}")


def verdict_of(snapshot: RunView, *, next_step: str = "", comparison: str = "") -> Verdict:
    """The verdict after an event; an angle counts as found only once the search is over and says so.

    ``next_step``: what a person can do next if the run has ended without an answer. ``comparison``: what a search would
    have said, if it has ended with the answer from all angles of a recording.
    """
    word, kind = _word(snapshot)
    belief = snapshot.belief
    if snapshot.asked_deg is not None:
        angle = with_minus(f"{snapshot.asked_deg:.1f}°")
        # The line begins with what stands beside it in large letters.
        read = snapshot.line.partition(": ")[2]
        return Verdict(word="TURN", kind=kind, lead="turn the probe to", angle=angle, reason=read)
    problem, next_step = snapshot.problem, next_step if kind in {"stopped", "fault"} else ""
    if snapshot.phase == "finished" and comparison:
        next_step = with_minus(f"a search would have said: {comparison}")
    if belief is None:
        angle = "" if snapshot.over or kind == "idle" else "–"
        return Verdict(
            word=word, kind=kind, angle=angle, problem=problem, reason=_reason(snapshot), next_step=next_step
        )
    angle = angle_text(belief) or "–"
    # Where the badge says it all, or no more will come, there is no angle to wait for.
    waits = not (kind == "nothing" and belief.claims) and not (snapshot.over and angle == "–")
    return Verdict(
        word=word,
        kind=kind,
        lead=_lead(snapshot, belief),
        angle=angle if waits else "",
        sigma=sigma_text(belief),
        # At a fault what went wrong counts; the interval so far is in the chart.
        interval="" if kind == "fault" else interval_text(belief),
        turn=turn_text(snapshot) if kind == "found" else "",
        problem=problem,
        reason=with_minus(_reason(snapshot)),
        next_step=next_step,
    )


def _word(snapshot: RunView) -> tuple[str, Kind]:
    if snapshot.phase in {"fault", "cut off"}:
        return "FAULT", "fault"
    if snapshot.phase == "stopped":
        return "STOPPED", "stopped"
    if snapshot.phase == "finished" and snapshot.belief is not None:
        if not snapshot.belief.claims:
            return "NO CLAIM", "nothing"
        name = answer_name(snapshot.belief.estimate)
        return name.upper(), "found" if name == "found" else "nothing" if name == "not found" else "unsure"
    if snapshot.number == 0:
        return "READY", "idle"
    return ("CHECKING" if snapshot.phase == "checking" else "SEARCHING"), "busy"


def _lead(snapshot: RunView, belief: AngleBelief) -> str:
    if snapshot.phase != "finished":
        return "so far"
    if not belief.claims:
        return "angle"
    return {"found": "", "ambiguous": "either"}.get(answer_name(belief.estimate), "best guess")


def _reason(snapshot: RunView) -> str:
    belief = snapshot.belief
    if snapshot.phase in {"stopped", "fault", "cut off"}:
        # The log says how it ended, in the words of the badge, and after the problem what laser and stage did.
        said = snapshot.line.removeprefix(f"{snapshot.phase}: ")
        return said.removeprefix(snapshot.problem).removeprefix("; ")
    if belief is None:
        return "" if snapshot.points or snapshot.number else "nothing measured yet"
    if not belief.claims:
        return "the paper's form of a method always answers, also where there is no marker"
    if snapshot.phase != "finished":
        return f"so far {answer_name(belief.estimate)}"
    return answer_reason(belief.estimate) or ""


def sigma_text(belief: AngleBelief) -> str:
    """Its standard deviation with two significant digits; empty where the answer has none, or names several angles."""
    sigma_deg = belief.sigma_deg
    # That of an ambiguous answer is of one of its sources, and would be read as that of the last angle.
    if sigma_deg is None or isinstance(belief.estimate, Ambiguous):
        return ""
    return f" ± {sigma_deg:.{digits_of(sigma_deg)}f}°"


def interval_text(belief: AngleBelief) -> str:
    """The 95 % interval of an angle, and how far it reaches from it at the marker, where that is known."""
    # Of one source only where an answer names several.
    if belief.interval95_deg is None or belief.sigma_deg is None or isinstance(belief.estimate, Ambiguous):
        return ""
    low, high = (f"{end_deg:z.{digits_of(belief.sigma_deg)}f}°" for end_deg in belief.interval95_deg)
    estimate = belief.estimate
    half_width_m = estimate.half_width_m if isinstance(estimate, Found | Unsure) else None
    at_marker = "" if half_width_m is None else f", ±\N{NO-BREAK SPACE}{1e3 * half_width_m:.2g}\N{NO-BREAK SPACE}mm"
    # What a bracket search has left is no probability.
    name = "last bracket" if getattr(estimate, "interval_kind", None) == "bracket" else "95 %"
    return with_minus(f"{name}: {low} to {high}{at_marker}")


def turn_text(snapshot: RunView) -> str:
    """How far the probe has to turn to the marker; empty where nothing turns, or nobody knows where it is."""
    if snapshot.facts.kind == "replayed" or snapshot.probe_deg is None or snapshot.belief is None:
        return ""
    turn_deg = snapshot.belief.estimate.mean_deg - snapshot.probe_deg
    if abs(turn_deg) > ON_MARKER_DEG:
        return with_minus(f"turn by {turn_deg:+.1f}°")
    turned = "" if math.isnan(snapshot.start_deg) else f", turned by {snapshot.probe_deg - snapshot.start_deg:+.1f}°"
    return with_minus(f"the probe is on it{turned}")
