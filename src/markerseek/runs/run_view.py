"""The one fold of a run's events: what terminal, page, bridges, notebook and report show of a run.

A view is a value: each event gives the next one, and an earlier one stays what it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from markerseek.core import (
    AngleBelief,
    Asked,
    Failed,
    Finished,
    Measured,
    Refused,
    RigFacts,
    Role,
    Sample,
    SearchPlan,
    Started,
    Swept,
    Turning,
    counted,
)
from markerseek.records.journal import Checked, Configuration, Entry, Interrupted, JournalEvent, RecordedRun, Resuming
from markerseek.show import SearchResult, angle_text, answer_name, with_minus

Phase: TypeAlias = Literal[
    "ready",
    "dark",
    "moving",
    "turning",
    "sweeping",
    "measured",
    "refused",
    "checking",
    "stopped",
    "finished",
    "fault",
    "cut off",
]
"""What the rig does, as far as its events say; a run is cut off if it ended without saying why."""

STOPPED = "stopped: the laser is disarmed, and the probe stays where it was"
"""How a run ended that a person, or a program, has stopped."""

FAULT_END = "the laser was told to disarm, and the stage to stop"
"""What laser and stage did at a fault."""

_ROLES: dict[Role, str] = {"dark": "dark frame", "search": "acquisition", "confirmation": "confirmation"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One acquisition with light.

    Attributes
    ----------
    role
        ``search`` or ``confirmation``.
    number
        Number of the acquisition within its role, counted from 1.
    sample
        What was measured.
    """

    role: Role
    number: int
    sample: Sample

    @property
    def angle_deg(self) -> float:
        """Angle that the probe reached, in degrees."""
        return self.sample.angle_deg

    @property
    def intensity(self) -> float:
        """Intensity of the reading, in the unit of the frames."""
        return self.sample.reading.intensity


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunView:
    """The state of a run after one of its events.

    Attributes
    ----------
    plan
        What was asked of the search.
    facts
        What is known of the rig.
    number
        Number of the event, counted from 1; 0 before the first.
    phase
        What the rig does.
    start_deg
        Angle of the probe when the run began, in degrees; NaN before.
    probe_deg
        Last angle of the probe that was read back, in degrees; None before the first.
    seen_deg
        Last angle of the probe, read back or while a person turns it, in degrees; None before the first, and while a
        person turns the probe who will type the angle in.
    target_deg
        Angle to which the stage was sent and which is not read back yet, in degrees; None if nothing moves.
    asked_deg
        Angle to which a person is asked to turn the probe, in degrees; None if nobody is asked.
    role
        Role of the newest acquisition, asked for or measured; None before the first.
    index
        Number of the newest acquisition within its role, counted from 1; 0 before the first.
    points
        Acquisitions with light, in order.
    belief
        What the policy believed when it last asked; None before the first acquisition with light.
    finished
        The end of the run with its answer; None before, and after a fault.
    travel_deg
        Rotation since the start, in degrees.
    started_s
        The rig's clock at the start, in seconds.
    elapsed_s
        Time on the rig's clock since the start, in seconds.
    known_s
        The same when the answer was known; None before.
    snr_db
        Largest intensity over the noise, in dB; None if the noise is not known.
    pulses
        Laser pulses that were fired for the frames so far.
    refused
        Acquisitions that were refused.
    dark
        Dark frames that were asked for, before the search or after it.
    line
        One line of the log on this event.
    problem
        What went wrong, with its cure, if a fault ended the run; else empty.
    fault
        The same in the words of the record; None unless a fault ended the run and no person has reset it.
    """

    plan: SearchPlan
    facts: RigFacts
    number: int = 0
    phase: Phase = "ready"
    start_deg: float = math.nan
    probe_deg: float | None = None
    seen_deg: float | None = None
    target_deg: float | None = None
    asked_deg: float | None = None
    role: Role | None = None
    index: int = 0
    points: tuple[Point, ...] = ()
    belief: AngleBelief | None = None
    finished: Finished | None = None
    travel_deg: float = 0.0
    started_s: float = 0.0
    elapsed_s: float = 0.0
    known_s: float | None = None
    snr_db: float | None = None
    pulses: int = 0
    refused: int = 0
    dark: int = 0
    line: str = ""
    problem: str = ""
    fault: str | None = None

    @classmethod
    def of(cls, run: Configuration | RecordedRun) -> RunView:
        """The view of a run before its first event, or of a recorded run after its last."""
        if isinstance(run, Configuration):
            return cls(plan=run.plan, facts=run.facts)
        view = cls.of(run.configuration)
        for entry in run.entries:
            view = view.add_entry(entry)
        return view

    @property
    def acquisitions(self) -> int:
        """Acquisitions that the search asked for; a confirmation does not count."""
        return sum(point.role == "search" for point in self.points)

    @property
    def confirmation(self) -> Sample | None:
        """The acquisition at the answer; None if there is none, or the search went on after it."""
        return self.points[-1].sample if self.points and self.points[-1].role == "confirmation" else None

    @property
    def samples(self) -> list[Sample]:
        """All samples with light but the confirmation; one after which the search went on is one of them."""
        lit = [point.sample for point in self.points]
        return lit if self.confirmation is None else lit[:-1]

    @property
    def search_samples(self) -> list[Sample]:
        """The samples of the search: all, but of a recording only those that its search took."""
        searched = None if self.finished is None else self.finished.searched
        return self.samples if searched is None else self.samples[: searched.acquisitions]

    @property
    def strongest(self) -> float:
        """The largest intensity so far; 0 before the first."""
        return max((point.intensity for point in self.points), default=0.0)

    @property
    def floor_level(self) -> float | None:
        """Detection threshold, in the unit of the intensities; None if it is not known."""
        floor = self.belief.estimate.floor if self.belief else None
        return None if floor is None else floor.level

    @property
    def unit(self) -> str:
        """Unit of the intensities; those of a table have the unit of whoever made the table."""
        return "as recorded" if self.facts.probe is None else "counts"

    @property
    def state(self) -> Literal["finished", "fault", "open"]:
        """Finished with an answer, ended by a fault, or open: it runs, or was stopped or died, and can be resumed."""
        if self.finished is not None:
            return "finished"
        return "open" if self.fault is None else "fault"

    @property
    def over(self) -> bool:
        """Whether the run has ended in any way."""
        return self.phase in {"finished", "fault", "stopped", "cut off"}

    def result(self) -> SearchResult:
        """The result of the run; `SearchError` if the run is not over, or ended with a fault."""
        return SearchResult.of(
            self.finished,
            plan=self.plan,
            facts=self.facts,
            samples=self.samples,
            confirmation=self.confirmation,
            start_deg=self.start_deg,
            refused=self.refused,
        )

    def add_entry(self, entry: Entry) -> RunView:
        """The view after one more entry of the journal."""
        return self.add(entry.event, clock_s=entry.clock_s)

    def add(self, event: JournalEvent, *, clock_s: float) -> RunView:
        """The view after one more event.

        Parameters
        ----------
        event
            The event.
        clock_s
            The rig's clock when the event was committed, in seconds.

        Returns
        -------
        RunView
            The next view; this one stays as it is.
        """
        now = replace(
            self,
            number=self.number + 1,
            target_deg=None,
            asked_deg=None,
            problem="",
            elapsed_s=clock_s - self.started_s,
            pulses=self.pulses + _pulses(event),
            belief=getattr(event, "belief", None) or self.belief,
        )
        after = _after(now, event, clock_s)
        return replace(after, line=with_minus(after.line))

    def cut_off(self, reason: str, *, problem: str = "") -> RunView:
        """The view after the last event of a run that did not report its end; the angle of its probe is not known.

        Parameters
        ----------
        reason
            How the run ended, for the log.
        problem
            What went wrong; empty if a person has stopped the run.
        """
        phase: Phase = "cut off" if problem else "stopped"
        ended = replace(self, number=self.number + 1, phase=phase, target_deg=None, asked_deg=None)
        return replace(ended, line=with_minus(reason), problem=with_minus(problem))


def _after(view: RunView, event: JournalEvent, clock_s: float) -> RunView:
    match event:
        case Started(start_deg=start_deg, limits=limits):
            # A search that starts again keeps no measurement, but the pulses were fired.
            begun = RunView(plan=view.plan, facts=view.facts, number=view.number, pulses=view.pulses, fault=view.fault)
            line = f"started at {start_deg:.3f}°, searches {limits}"
            begun = replace(begun, probe_deg=start_deg, seen_deg=start_deg)
            return replace(begun, started_s=clock_s, start_deg=start_deg, line=line)
        case Asked() | Turning() | Swept():
            return _turning(view, event)
        case Measured():
            return _measured(view, event)
        case Refused(angle_deg=angle_deg, reason=reason):
            line = f"refused at {angle_deg:.3f}°: {reason}"
            return replace(view, phase="refused", refused=view.refused + 1, line=line)
        case Finished():
            return _finished(view, event)
        case Failed(error=error):
            line = f"fault: {error}; {FAULT_END}"
            ended = replace(view, phase="fault", finished=None, fault=str(error))
            return replace(ended, line=line, problem=with_minus(str(error)))
        case Interrupted(reason=reason):
            return replace(view, phase="stopped", line=f"{STOPPED} ({reason})")
        case Resuming(by=by, fault_reset=fault_reset):
            line = f"armed by {by}" + ("; measures the strongest angle again" if view.points else "")
            return replace(view, phase="checking", fault=None if fault_reset else view.fault, line=line)
        case Checked(difference=difference):
            changed = difference and f"{difference}: the search starts again"
            line = changed or "the strongest angle is unchanged: the search goes on"
            return replace(view, phase="checking", line=line)


def _turning(view: RunView, event: Asked | Turning | Swept) -> RunView:
    if isinstance(event, Turning):
        read = "type the angle reached" if event.angle_deg is None else f"it is at {event.angle_deg:.1f}°"
        line = f"turn the probe to {event.target_deg:.1f}°: {read}"
        return replace(view, phase="turning", asked_deg=event.target_deg, seen_deg=event.angle_deg, line=line)
    if isinstance(event, Swept):
        line = f"the sweep is over after {counted(event.pulses, 'pulse')}, the probe is at {event.angle_deg:.3f}°"
        return replace(_moved(view, event.angle_deg), phase="measured", line=line)
    view = replace(view, role=event.role, index=event.index)
    if event.role == "dark":
        count = f" of {view.plan.dark_frames}" if event.index <= view.plan.dark_frames else ""
        line = f"{_name(view, event.role, event.index)}{count}: measures the noise, laser off"
        return replace(view, phase="dark", dark=event.index, line=line)
    line = f"{_name(view, event.role, event.index)} at {event.angle_deg:.3f}°"
    if event.sweep is not None:
        line = f"sweeps to {event.angle_deg:.3f}° at {event.sweep.speed_deg_s:g} deg/s"
    known_s = None
    if event.role == "confirmation" and not view.plan.as_published:
        known_s = view.elapsed_s
        line = f"the answer is {event.angle_deg:.3f}°, known after {known_s:.1f} s: turns there to confirm it"
    return replace(view, phase="moving", target_deg=event.angle_deg, known_s=known_s, line=line)


def _measured(view: RunView, event: Measured) -> RunView:
    sample = event.sample
    view = replace(view, role=event.role, index=event.index, seen_deg=sample.angle_deg)
    name = _name(view, event.role, event.index)
    line = f"{name}: {sample.angle_deg:.3f}°, intensity {sample.reading.intensity:.4g}"
    phase: Phase = "measured" if sample.sweep is None else "sweeping"
    if sample.dark:
        return replace(view, phase=phase, probe_deg=sample.angle_deg, line=line)
    point = Point(role=event.role, number=event.index, sample=sample)
    known = [each for each in (view.snr_db, _snr_db(sample)) if each is not None]
    moved = _moved(view, sample.angle_deg)
    return replace(moved, phase=phase, points=(*view.points, point), snr_db=max(known, default=None), line=line)


def _finished(view: RunView, event: Finished) -> RunView:
    # The paper's form of a method always answers, and claims nothing.
    claims = not view.plan.as_published
    belief = event.belief or AngleBelief(estimate=event.estimate, claims=claims)
    name = answer_name(event.estimate) if claims else "angle, not claimed"
    line = ": ".join(filter(None, (name, angle_text(belief))))
    if event.searched is not None:
        line += f", from all angles; the search alone: {answer_name(event.searched.estimate)}"
    known_s = None if event.confirmation is None else event.known_s
    return replace(view, phase="finished", finished=event, belief=belief, known_s=known_s, line=line)


def _moved(view: RunView, angle_deg: float) -> RunView:
    """The view with the probe read back at an angle."""
    way_deg = 0.0 if view.probe_deg is None else abs(angle_deg - view.probe_deg)
    return replace(view, probe_deg=angle_deg, seen_deg=angle_deg, travel_deg=view.travel_deg + way_deg)


def _name(view: RunView, role: Role, index: int) -> str:
    """Name of an acquisition."""
    if role == "confirmation" and view.plan.as_published:
        return "acquisition at the answer"
    return f"{_ROLES[role]} {index}"


def _pulses(event: JournalEvent) -> int:
    """Laser pulses of the frame of an event."""
    frame = event.sample.frame if isinstance(event, Measured) else getattr(event, "frame", None)
    return 0 if frame is None else frame.header.pulses


def _snr_db(sample: Sample) -> float | None:
    sigma, intensity = sample.reading.noise_sigma, sample.reading.intensity
    return 20 * math.log10(intensity / sigma) if sigma and intensity > 0 else None
