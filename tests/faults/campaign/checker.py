"""Which promises a run broke, decided only from its simulated truth and its journal."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from markerseek.core import Failed, Finished, Found, Measured, ReadingFrame, Refused

from .runs import CAPS, Trace
from .vocabulary import FAULTS
from .world import Received

SETTLED_DEG = 0.2
"""Most that a sample's angle may be off in truth: settling 0.05, play 0.1, counts, and an edge."""

OFF_DEG = 2.0
"""P10: found, and off by more than twice the tolerance, which is 1 degree where the marker's depth is not known."""

SAMPLE_S = 120.0
"""Longest virtual time of one acquisition with all its attempts under the faults' deadlines, beside the cap."""


@dataclass(kw_only=True)
class Verdict:
    """Findings of a run; ``broken`` holds promise and sentence."""

    broken: list[tuple[str, str]] = field(default_factory=list)
    outcome: str = ""
    acted: bool = False
    reported: bool = False
    excess_deg: float = 0.0
    injected_deg: float = 0.0
    excess_pulses: int = 0
    moving_pulses: int = 0
    noticed_later: bool = False
    found: bool = False
    off: bool = False


def check(trace: Trace) -> Verdict:
    """Look at a run."""
    verdict = Verdict()
    plan = trace.plan
    kinds = {(fault.device, fault.name): FAULTS[fault.device, fault.name] for fault in plan.faults}
    events = [entry.event for entry in trace.journal.entries]
    last = events[-1] if events else None
    verdict.outcome = "fault" if trace.guard.fault else "ended" if isinstance(last, Failed) else "finished"
    verdict.acted = bool(trace.acted)
    verdict.reported = any(isinstance(event, Refused | Failed) for event in events)
    _p1(trace, verdict, harmless=not any(each.harm == "angle" for each in kinds.values()))
    _p3(trace, verdict, harmless=not any(each.harm == "pulses" for each in kinds.values()))
    _p6(trace, verdict, observable=all(each.harm in ("none", "pulses") for each in kinds.values()))
    if trace.left_fault:
        verdict.broken.append(("P7", "FAULT was left by something else than a person's reset"))
    if not trace.virtual_s <= CAPS.duration_s + 3 * CAPS.attempts * (SAMPLE_S + 3 * plan.readout_s):
        verdict.broken.append(("P8", f"the run took {trace.virtual_s:.0f} virtual seconds"))
    if not isinstance(last, Finished | Failed):
        verdict.broken.append(("P8", f"the journal ends with {last!r}"))
    if isinstance(last, Finished) and isinstance(last.estimate, Found):
        verdict.found = True
        verdict.off = plan.marker_deg is None or not abs(last.estimate.mean_deg - plan.marker_deg) <= OFF_DEG
    return verdict


def _p1(trace: Trace, verdict: Verdict, *, harmless: bool) -> None:
    travel = trace.plan.limits.travel
    play_deg = 0.1
    lowest, highest = trace.world.lowest_deg, trace.world.highest_deg
    verdict.excess_deg = max(0.0, travel.low_deg - lowest, highest - travel.high_deg - play_deg)
    injected = 0.0
    for fault in trace.plan.faults:
        if fault.name == "scale":
            injected += abs(fault.amount) * max(abs(travel.low_deg), abs(travel.high_deg))
        elif FAULTS[fault.device, fault.name].harm == "angle":
            injected += abs(fault.amount)
    verdict.injected_deg = injected
    if not verdict.excess_deg <= (0.0 if harmless else injected + 1e-3):
        verdict.broken.append(("P1", f"the probe was between {lowest:.3f} and {highest:.3f} deg, travel {travel}"))


def _p3(trace: Trace, verdict: Verdict, *, harmless: bool) -> None:
    lights = trace.world.lights
    verdict.moving_pulses = sum(light.pulses for light in lights if light.moving)
    permitted = sum(pulses for _, pulses in trace.sent_permits)
    fired = sum(light.pulses for light in lights if not light.moving)
    largest = max((light.pulses for light in lights), default=0)
    verdict.excess_pulses = max(0, fired - permitted, largest - trace.plan.pulses)
    if permitted > trace.guard.pulses_permitted:
        verdict.broken.append(("P3", f"{permitted} pulses were commanded of the laser, more than were permitted"))
    if harmless and (verdict.excess_pulses or verdict.moving_pulses):
        verdict.broken.append(("P3", f"{verdict.excess_pulses} pulses too many, {verdict.moving_pulses} while moving"))
    injected = sum(max(1, round(fault.amount)) for fault in trace.plan.faults if fault.name == "extra pulses")
    if any(fault.name == "extra pulses" for fault in trace.plan.faults) and largest > trace.plan.pulses + injected + 4:
        verdict.broken.append(("P3", f"{largest} pulses at once, {trace.plan.pulses} permitted, {injected} injected"))


def _p6(trace: Trace, verdict: Verdict, *, observable: bool) -> None:
    if not observable:
        return
    silent = ("fires by itself",)
    seen = [fault for fault in trace.acted if fault.name not in silent]
    if seen and not verdict.reported:
        verdict.broken.append(("P6", f"not reported: {', '.join(f'{each.device} {each.name}' for each in seen)}"))
    faulty = _accepted_faulty(trace)
    if faulty and verdict.outcome == "finished":
        verdict.broken += [("P6", said) for said in faulty]
    verdict.noticed_later = bool(faulty) and verdict.outcome != "finished"


def _accepted_faulty(trace: Trace) -> list[str]:
    """Frames that were accepted and are not what was received, or not at that angle."""
    truth: dict[str, list[Received]] = {}
    for each in trace.world.received:
        truth.setdefault(each.token, []).append(each)
    faulty = []
    for entry in trace.journal.entries:
        if not isinstance(entry.event, Measured):
            continue
        frame, sample = entry.event.sample.frame, entry.event.sample
        own = truth.get("" if frame is None else frame.header.token, [])
        received = min(own, key=lambda each: abs(each.intensity - sample.reading.intensity), default=None)
        if received is None or not isinstance(frame, ReadingFrame):
            faulty.append("a frame was accepted that was never received")
        elif not math.isclose(sample.reading.intensity, received.intensity):
            faulty.append(f"accepted {sample.reading.intensity:g}, received {received.intensity:g}")
        elif not abs(sample.angle_deg - received.angle_deg) <= SETTLED_DEG:
            faulty.append(f"accepted at {sample.angle_deg:.3f}, received at {received.angle_deg:.3f} deg")
        elif received.pulses != frame.header.pulses:
            faulty.append(f"accepted with {frame.header.pulses} pulses, {received.pulses} were received")
    return faulty
