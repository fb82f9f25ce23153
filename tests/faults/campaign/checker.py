"""Which promises a run broke, decided only from its simulated truth and its journal."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

from markerseek.core import Failed, Finished, Found, Measured, ReadingFrame, Refused, Sweep
from markerseek.sim import LaserSettings, ReceiverSettings, StageMotion

from .faulty import HostKilled
from .runs import CAPS, LEASE_S, Trace
from .world import Light, Received

SETTLED_DEG = 0.2
"""Most that a sample's angle may be off in truth: settling 0.05, play 0.1, counts, and an edge."""

OFF_DEG = 2.0
"""P10: found, and off by more than twice the tolerance, which is 1 degree where the marker's depth is not known."""

READ_WITHIN_S = 0.06
"""Time from one reading of a sweep to the next, in seconds."""

PERIOD_S = max(1 / LaserSettings().rate_hz, ReceiverSettings().frame_period_s)
"""Least time between two pulses of the simulated laser, in seconds."""

FASTER = 1.3
SLOWER = 1.3
"""How many times as fast, and as long, as it was asked for a sweep may be in light, with some room."""

NOTICED_S = 0.3
"""Time in seconds within which light ends on a probe that stands or is too fast: some readings of the stage."""

TURNING_S = 1.0
"""The same where the probe may turn back: it is lit at rest there."""

DARK_S = 0.01
"""Room of P2, in seconds."""

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
    covered: bool = False


def check(trace: Trace) -> Verdict:
    """Look at a run."""
    verdict = Verdict()
    plan = trace.plan
    harms = {fault.harm for fault in plan.faults}
    events = [entry.event for entry in trace.journal.entries]
    last = events[-1] if events else None
    verdict.outcome = (
        "killed"
        if isinstance(trace.raised, HostKilled)
        else "fault"
        if trace.guard.fault
        else "ended"
        if isinstance(last, Failed)
        else "finished"
    )
    # A host that has died reports nothing more: what it left behind is judged by P1 and P3.
    verdict.acted = bool(trace.acted) and verdict.outcome != "killed"
    verdict.reported = any(isinstance(event, Refused | Failed) for event in events)
    _p1(trace, verdict, harmless="angle" not in harms)
    _p2(trace, verdict, harmless="pulses" not in harms)
    _p3(trace, verdict, harmless="pulses" not in harms)
    _p6(trace, verdict, observable=harms <= {"none", "pulses"})
    if trace.left_fault:
        verdict.broken.append(("P7", "FAULT was left by something else than a person's reset"))
    if not trace.virtual_s <= CAPS.duration_s + 3 * CAPS.attempts * (SAMPLE_S + 3 * plan.readout_s):
        verdict.broken.append(("P8", f"the run took {trace.virtual_s:.0f} virtual seconds"))
    killed = isinstance(trace.raised, HostKilled)
    _left_alone(trace, verdict, harmless="angle" not in harms)
    if not killed and (not events or not isinstance(last, Finished | Failed)):
        verdict.broken.append(("P8", f"the journal ends with {last!r}"))
    if isinstance(last, Finished) and isinstance(last.estimate, Found):
        verdict.found = True
        verdict.off = plan.marker_deg is None or not abs(last.estimate.mean_deg - plan.marker_deg) <= OFF_DEG
        verdict.covered = plan.marker_deg is not None and plan.marker_deg in last.estimate.interval95_deg
    return verdict


def _p1(trace: Trace, verdict: Verdict, *, harmless: bool) -> None:
    travel = trace.plan.limits.travel
    play_deg = 0.1
    lowest = trace.world.lowest_deg
    highest = trace.world.highest_deg
    verdict.excess_deg = max(0.0, travel.low_deg - lowest, highest - travel.high_deg - play_deg)
    injected = 0.0
    for fault in trace.plan.faults:
        if fault.name == "scale":
            injected += abs(fault.amount) * max(abs(travel.low_deg), abs(travel.high_deg))
        elif fault.harm == "angle":
            injected += abs(fault.amount)
    verdict.injected_deg = injected
    if not verdict.excess_deg <= (0.0 if harmless else injected + 1e-3):
        verdict.broken.append(("P1", f"the probe was between {lowest:.3f} and {highest:.3f} deg, travel {travel}"))


def _left_alone(trace: Trace, verdict: Verdict, *, harmless: bool) -> None:
    """P1 after the death of the host: the probe stays in the permit of its sweep."""
    if not trace.left_deg:
        return
    permit = trace.guard._sweep
    low_deg, *_, high_deg = sorted((permit.angle_deg, permit.to_deg, permit.end_deg))
    # A stage that goes beyond its target does so without a host, too: only the room to its travel's end covers that.
    beyond_deg = sum(abs(fault.amount) for fault in trace.plan.faults if fault.name == "overshoot")
    room_deg = SETTLED_DEG + beyond_deg + (0.0 if harmless else verdict.injected_deg)
    lowest_deg = min(trace.left_deg)
    highest_deg = max(trace.left_deg)
    if not low_deg - room_deg <= lowest_deg <= highest_deg <= high_deg + room_deg:
        said = f"after the host's death the probe was between {lowest_deg:.2f} and {highest_deg:.2f} deg"
        verdict.broken.append(("P1", f"{said}, outside {permit}"))


def _p2(trace: Trace, verdict: Verdict, *, harmless: bool) -> None:
    """The laser is dark within its lease after a fault or the death of the host, and at once where it can be told."""
    if not harmless:
        return
    killed = isinstance(trace.raised, HostKilled)
    told = not killed and not any(fault.name == "unplugged" for fault in trace.acted)
    for name, since_s, lease_s in (
        ("the end of the run", trace.ended_s, 0.0 if told else LEASE_S),
        ("the fault", trace.fault_s, LEASE_S),
    ):
        late = [light.at_s - since_s for light in trace.world.lights if light.at_s > since_s + lease_s + DARK_S]
        if late:
            verdict.broken.append(("P2", f"{len(late)} pulses up to {max(late):.2f} s after {name}"))


def _p3(trace: Trace, verdict: Verdict, *, harmless: bool) -> None:
    lights = trace.world.lights
    verdict.broken += [("P3", said) for said in _unasked_light(trace, verdict.injected_deg) if harmless]
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


def _unasked_light(trace: Trace, injected_deg: float) -> list[str]:
    """Return what of the light on a probe that turns nobody has asked for; the guard's own permits are not used."""
    said = []
    ends_s = [*(asked_s for _, asked_s in trace.asked[1:]), math.inf]
    own: list[Light] = []
    for (sweep, asked_s), end_s in zip(trace.asked, ends_s, strict=True):
        lights = [light for light in trace.world.lights if asked_s <= light.at_s < end_s]
        own += lights
        if sweep is None:
            turning = sum(light.sweeping for light in lights)
            said += [f"{turning} pulses on a probe that turns, and no sweep was asked for"] if turning else []
        else:
            said += _beyond_sweep(sweep, lights, trace, injected_deg)
    before = sum(light.sweeping for light in trace.world.lights) - sum(light.sweeping for light in own)
    return said + ([f"{before} pulses before a sweep was asked for"] if before else [])


def _beyond_sweep(sweep: Sweep, lights: list[Light], trace: Trace, injected_deg: float) -> list[str]:
    """Return what of the light of a sweep is outside its angles, its time, its rate or its speed."""
    # Each sweep states where it begins.
    places_deg = [each for each in (sweep.from_deg, sweep.to_deg, sweep.back_deg) if each is not None]
    room_deg = SETTLED_DEG + injected_deg + READ_WITHIN_S * FASTER * sweep.speed_deg_s
    low_deg = min(places_deg) - room_deg
    high_deg = max(places_deg) + room_deg
    outside = [light.angle_deg for light in lights if not low_deg <= light.angle_deg <= high_deg]
    said = [f"{len(outside)} pulses of a sweep outside {low_deg:.1f} to {high_deg:.1f} deg"] if outside else []
    if not lights:
        return said
    way_deg = sum(abs(after - before) for before, after in pairwise(places_deg))
    longest_s = SLOWER * (way_deg / sweep.speed_deg_s + 2 * sweep.speed_deg_s / StageMotion().acceleration_deg_s2) + 2.0
    blind_s = sum(fault.amount for fault in trace.acted if fault.name == "late readings")
    slowed = max((fault.amount for fault in trace.acted if fault.name == "slow"), default=1.0)
    lasted_s = lights[-1].at_s - lights[0].at_s
    if not lasted_s <= slowed * longest_s + blind_s:
        said.append(f"light for {lasted_s:.1f} s in a sweep that takes {longest_s:.1f} s")
    largest = max(light.pulses for light in lights)
    if largest > 1:
        said.append(f"{largest} pulses at once in a sweep")
    apart_s = min((after.at_s - before.at_s for before, after in pairwise(lights)), default=math.inf)
    if not apart_s >= 0.999 * PERIOD_S:
        said.append(f"two pulses {apart_s:.4f} s apart in a sweep, the laser's period is {PERIOD_S:g} s")
    # A host that has died notices nothing more: P2 judges the light after that.
    ends_s = trace.ended_s if isinstance(trace.raised, HostKilled) else math.inf
    return said + _unnoticed(sweep, [light for light in lights if light.at_s <= ends_s], blind_s)


def _unnoticed(sweep: Sweep, lights: list[Light], blind_s: float) -> list[str]:
    """Return for how long light fell on a probe that stood, or was too fast, beyond the time to notice it."""
    stood_s = 0.0
    fast_s = 0.0
    longest_stood_s = 0.0
    for before, after in pairwise(lights):
        elapsed_s = after.at_s - before.at_s
        turned_deg = abs(after.angle_deg - before.angle_deg)
        stood_s = stood_s + elapsed_s if turned_deg < 0.005 else 0.0
        longest_stood_s = max(longest_stood_s, stood_s)
        # A slip or a backlash is no speed.
        fast_s += elapsed_s if turned_deg > FASTER * sweep.speed_deg_s * elapsed_s + SETTLED_DEG else 0.0
    most_s = blind_s + (NOTICED_S if sweep.back_deg is None else TURNING_S)
    said = [f"light for {longest_stood_s:.2f} s on a probe that stands"] if longest_stood_s > most_s else []
    return said + ([f"light for {fast_s:.2f} s on a probe that is too fast"] if fast_s > blind_s + NOTICED_S else [])


def _p6(trace: Trace, verdict: Verdict, *, observable: bool) -> None:
    if not observable:
        return
    silent = ("fires by itself",)
    seen = [fault for fault in trace.acted if fault.name not in silent]
    if seen and verdict.acted and not verdict.reported:
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
        frame = entry.event.sample.frame
        sample = entry.event.sample
        # All frames of a sweep have one token.
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
