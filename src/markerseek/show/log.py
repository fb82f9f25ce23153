"""The log of a run: a line for each of its events."""

from __future__ import annotations

from markerseek.core import Asked, Failed, Finished, Measured, Refused, Role, Started, Swept, Turning, counted
from markerseek.records.journal import Checked, Interrupted, JournalEvent, Resuming, RunView
from markerseek.show.words import angle_text, answer_name, with_minus

STOPPED = "stopped: the laser is disarmed, and the probe stays where it was"
"""How a run ended that a person, or a program, has stopped."""

FAULT_END = "the laser was told to disarm, and the stage to stop"
"""What laser and stage did at a fault."""

_ROLES: dict[Role, str] = {"dark": "dark frame", "search": "acquisition", "confirmation": "confirmation"}


def event_line(view: RunView) -> str:
    """Return the line of the newest event of a run; empty before the first."""
    return with_minus(view.ended if view.event is None else _line(view, view.event))


def _line(view: RunView, event: JournalEvent) -> str:
    match event:
        case Started(start_deg=start_deg, limits=limits):
            return f"started at {start_deg:.3f}°, searches {limits}"
        case Asked():
            return _asked(view, event)
        case Turning(target_deg=target_deg, angle_deg=angle_deg):
            read = "type the angle reached" if angle_deg is None else f"it is at {angle_deg:.1f}°"
            return f"turn the probe to {target_deg:.1f}°: {read}"
        case Swept(pulses=pulses, angle_deg=angle_deg):
            return f"the sweep is over after {counted(pulses, 'pulse')}, the probe is at {angle_deg:.3f}°"
        case Measured(role=role, index=index, sample=sample):
            return f"{_name(view, role, index)}: {sample.angle_deg:.3f}°, intensity {sample.reading.intensity:.4g}"
        case Refused(angle_deg=angle_deg, reason=reason):
            return f"refused at {angle_deg:.3f}°: {reason}"
        case Finished():
            return _finished(view, event)
        case Failed(error=error):
            return f"fault: {error}; {FAULT_END}"
        case Interrupted() | Resuming() | Checked():
            return _broken_off(view, event)


def _asked(view: RunView, event: Asked) -> str:
    name = _name(view, event.role, event.index)
    if event.role == "dark":
        count = f" of {view.plan.dark_frames}" if event.index <= view.plan.dark_frames else ""
        return f"{name}{count}: measures the noise, laser off"
    if view.known_s is not None:
        return f"the answer is {event.angle_deg:.3f}°, known after {view.known_s:.1f} s: turns there to confirm it"
    if event.sweep is not None:
        return f"sweeps to {event.angle_deg:.3f}° at {event.sweep.speed_deg_s:g} deg/s"
    return f"{name} at {event.angle_deg:.3f}°"


def _finished(view: RunView, event: Finished) -> str:
    name = "angle, not claimed" if view.plan.as_published else answer_name(event.estimate)
    angle = "" if view.belief is None else angle_text(view.belief)
    line = f"{name}: {angle}" if angle else name
    if event.searched is None:
        return line
    return f"{line}, from all angles; the search alone: {answer_name(event.searched.estimate)}"


def _broken_off(view: RunView, event: Interrupted | Resuming | Checked) -> str:
    """Return the line of a run that is broken off, or goes on."""
    match event:
        case Interrupted(reason=reason):
            return f"{STOPPED} ({reason})"
        case Resuming(by=by):
            return f"armed by {by}" + ("; measures the strongest angle again" if view.points else "")
        case Checked(difference=difference):
            changed = difference and f"{difference}: the search starts again"
            return changed or "the strongest angle is unchanged: the search goes on"


def _name(view: RunView, role: Role, index: int) -> str:
    """Return the name of an acquisition."""
    if role == "confirmation" and view.plan.as_published:
        return "acquisition at the answer"
    return f"{_ROLES[role]} {index}"
