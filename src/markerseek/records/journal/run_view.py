"""The one fold of a run's events: its state, by which programs go on, and which `markerseek.show` puts into words.

A view is a value: each event gives the next one, and an earlier one stays what it was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from msgspec import structs

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
)
from markerseek.records.journal.entries import (
    Checked,
    Configuration,
    Interrupted,
    JournalEntry,
    JournalEvent,
    Resuming,
    without_frame,
)
from markerseek.records.journal.reader import RecordedRun

RunPhase: TypeAlias = Literal[
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


@dataclass(frozen=True, slots=True, kw_only=True)
class LitAcquisition:
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
    event
        The newest event; None before the first, and after the last of a run that did not report its end.
    ended
        How a run ended that did not report its end; empty for any other.
    problem
        What went wrong, with its cure, if a fault ended the run; else empty.
    fault
        The same in the words of the record; None unless a fault ended the run and no person has reset it.
    """

    plan: SearchPlan
    facts: RigFacts
    number: int = 0
    phase: RunPhase = "ready"
    start_deg: float = math.nan
    probe_deg: float | None = None
    seen_deg: float | None = None
    target_deg: float | None = None
    asked_deg: float | None = None
    role: Role | None = None
    index: int = 0
    points: tuple[LitAcquisition, ...] = ()
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
    event: JournalEvent | None = None
    ended: str = ""
    problem: str = ""
    fault: str | None = None

    @classmethod
    def of(cls, run: Configuration | RecordedRun) -> RunView:
        """Return the view of a run before its first event, or of a recorded run after its last."""
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

    def add_entry(self, entry: JournalEntry) -> RunView:
        """Return the view after one more entry of the journal."""
        return self.add(entry.event, clock_s=entry.clock_s)

    def add(self, event: JournalEvent, *, clock_s: float) -> RunView:
        """Return the view after one more event.

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
            event=event,
            target_deg=None,
            asked_deg=None,
            problem="",
            elapsed_s=clock_s - self.started_s,
            pulses=self.pulses + _pulses(event),
            belief=getattr(event, "belief", None) or self.belief,
        )
        return _after(now, event, clock_s)

    def without_frames(self) -> RunView:
        """Return the view without the frames of its acquisitions, of which each has half a megabyte."""
        points = tuple(replace(point, sample=structs.replace(point.sample, frame=None)) for point in self.points)
        event = None if self.event is None else without_frame(self.event)
        finished = event if isinstance(event, Finished) else self.finished
        return replace(self, points=points, event=event, finished=finished)

    def cut_off(self, reason: str, *, problem: str = "") -> RunView:
        """Return the view after the last event of a run that did not report its end.

        The angle of its probe is not known.

        Parameters
        ----------
        reason
            How the run ended, for the log.
        problem
            What went wrong; empty if a person has stopped the run.
        """
        return replace(
            self,
            number=self.number + 1,
            event=None,
            ended=reason,
            problem=problem,
            phase="cut off" if problem else "stopped",
            target_deg=None,
            asked_deg=None,
        )


def _after(view: RunView, event: JournalEvent, clock_s: float) -> RunView:
    match event:
        case Started(start_deg=start_deg):
            # A search that starts again keeps no measurement, but the pulses were fired.
            begun = RunView(plan=view.plan, facts=view.facts, number=view.number, pulses=view.pulses, fault=view.fault)
            begun = replace(begun, event=event, started_s=clock_s)
            return replace(begun, start_deg=start_deg, probe_deg=start_deg, seen_deg=start_deg)
        case Asked():
            return _asked(view, event)
        case Turning(target_deg=target_deg, angle_deg=angle_deg):
            return replace(view, phase="turning", asked_deg=target_deg, seen_deg=angle_deg)
        case Swept(angle_deg=angle_deg):
            return replace(_moved(view, angle_deg), phase="measured")
        case Measured():
            return _measured(view, event)
        case Refused():
            return replace(view, phase="refused", refused=view.refused + 1)
        case Finished() | Failed() | Interrupted():
            return _ended(view, event)
        case Resuming(fault_reset=fault_reset):
            return replace(view, phase="checking", fault=None if fault_reset else view.fault)
        case Checked():
            return replace(view, phase="checking")


def _asked(view: RunView, event: Asked) -> RunView:
    view = replace(view, role=event.role, index=event.index)
    if event.role == "dark":
        return replace(view, phase="dark", dark=event.index)
    is_known = event.role == "confirmation" and not view.plan.as_published
    return replace(view, phase="moving", target_deg=event.angle_deg, known_s=view.elapsed_s if is_known else None)


def _measured(view: RunView, event: Measured) -> RunView:
    sample = event.sample
    view = replace(view, role=event.role, index=event.index, seen_deg=sample.angle_deg)
    phase: RunPhase = "measured" if sample.sweep is None else "sweeping"
    if sample.dark:
        return replace(view, phase=phase, probe_deg=sample.angle_deg)
    point = LitAcquisition(role=event.role, number=event.index, sample=sample)
    known = [each for each in (view.snr_db, _snr_db(sample)) if each is not None]
    moved = _moved(view, sample.angle_deg)
    return replace(moved, phase=phase, points=(*view.points, point), snr_db=max(known, default=None))


def _ended(view: RunView, event: Finished | Failed | Interrupted) -> RunView:
    if isinstance(event, Failed):
        return replace(view, phase="fault", finished=None, fault=str(event.error), problem=str(event.error))
    if isinstance(event, Interrupted):
        return replace(view, phase="stopped")
    # The paper's form of a method always answers, and claims nothing.
    belief = event.belief or AngleBelief(estimate=event.estimate, claims=not view.plan.as_published)
    known_s = None if event.confirmation is None else event.known_s
    return replace(view, phase="finished", finished=event, belief=belief, known_s=known_s)


def _moved(view: RunView, angle_deg: float) -> RunView:
    """Return the view with the probe read back at an angle."""
    way_deg = 0.0 if view.probe_deg is None else abs(angle_deg - view.probe_deg)
    return replace(view, probe_deg=angle_deg, seen_deg=angle_deg, travel_deg=view.travel_deg + way_deg)


def _pulses(event: JournalEvent) -> int:
    """Return the laser pulses of the frame of an event."""
    frame = event.sample.frame if isinstance(event, Measured) else getattr(event, "frame", None)
    return 0 if frame is None else frame.header.pulses


def _snr_db(sample: Sample) -> float | None:
    sigma = sample.reading.noise_sigma
    intensity = sample.reading.intensity
    return 20 * math.log10(intensity / sigma) if sigma and intensity > 0 else None
