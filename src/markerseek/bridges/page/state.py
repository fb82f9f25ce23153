"""What the page shows, made from the events of a run: pure, one frozen `Snapshot` after each event."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from markerseek.core import (
    Ambiguous,
    AngleBelief,
    Asked,
    Failed,
    Finished,
    Measured,
    NotFound,
    Refused,
    RigKind,
    Role,
    Sample,
    Started,
    Swept,
    Turning,
    counted,
)
from markerseek.records import answer_name
from markerseek.records.journal import Checked, Configuration, Interrupted, JournalEvent, Resuming

Phase: TypeAlias = Literal[
    "ready",
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
"""What the rig does, as far as its events say; a run is cut off that ended by itself without saying why."""


STOPPED = "stopped: the laser is disarmed, and the probe stays where it was"
"""How a run ended that a person, or the page, has stopped."""

FAULT_END = "the laser was told to disarm, and the stage to stop"
"""What laser and stage did at a fault."""

SUPERVISED_END = "its supervisor disarms the laser and stops the stage"
"""What they do where the search was killed, and could not see to them itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One acquisition with light: its role, number within that role, angle reached in degrees, and intensity."""

    role: Role
    number: int
    angle_deg: float
    intensity: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Snapshot:
    """The state of a run after one event."""

    number: int = 0
    """Number of the event, counted from 1; 0 before the first."""
    rig: RigKind
    """Kind of the rig: whatever is simulated is called so."""
    phase: Phase = "ready"
    start_deg: float | None = None
    """Angle of the probe when the run began, in degrees; None before."""
    probe_deg: float | None = None
    """Last angle of the probe that was read back; None before the first."""
    target_deg: float | None = None
    """Angle to which the stage was sent and which is not read back yet; None when nothing moves."""
    asked_deg: float | None = None
    """Angle to which a person is asked to turn the probe; None while nobody is."""
    points: tuple[Point, ...] = ()
    """Acquisitions with light, in order."""
    belief: AngleBelief | None = None
    """What the policy believed when it last asked; None before the first acquisition with light."""
    travel_deg: float = 0.0
    elapsed_s: float = 0.0
    """``travel_deg`` and ``elapsed_s``: rotation in degrees, and time on the rig's clock in seconds, since the
    start."""
    snr_db: float | None = None
    """Largest intensity over the noise; None where the noise is not known."""
    pulses: int = 0
    refused: int = 0
    """``pulses`` and ``refused``: laser pulses that were fired for the frames so far, and acquisitions that were
    refused."""
    line: str = ""
    """One line of the log on this event."""
    problem: str = ""
    """What went wrong, with its cure, where a fault ended the run; empty elsewhere."""

    @property
    def acquisitions(self) -> int:
        """Acquisitions that the search asked for; the confirmation does not count."""
        return sum(point.role == "search" for point in self.points)

    @property
    def floor_level(self) -> float | None:
        """Level of the noise floor, in the unit of the intensities; None where it is not known."""
        floor = self.belief.estimate.floor if self.belief else None
        return None if floor is None else floor.level

    @property
    def over(self) -> bool:
        """Whether the run has ended in any way."""
        return self.phase in {"finished", "fault", "stopped", "cut off"}


class SnapshotBuilder:
    """Makes a snapshot of a run after each of its events.

    ``configuration``: plan of the search and facts of the rig.
    """

    def __init__(self, configuration: Configuration) -> None:
        self._as_published = configuration.plan.as_published
        self._started_s = 0.0
        self.snapshot = Snapshot(rig=configuration.facts.kind)

    def add(self, event: JournalEvent, *, clock_s: float) -> Snapshot:
        """State after one more event.

        ``clock_s``: the rig's clock when it was committed.
        """
        if isinstance(event, Started):
            self._started_s = clock_s
        now = replace(
            self.snapshot,
            number=self.snapshot.number + 1,
            asked_deg=None,
            problem="",
            elapsed_s=clock_s - self._started_s,
            pulses=self.snapshot.pulses + _pulses(event),
            belief=getattr(event, "belief", None) or self.snapshot.belief,
        )
        after = self._after(event, now)
        self.snapshot = replace(after, line=with_minus(after.line))
        return self.snapshot

    def _after(self, event: JournalEvent, now: Snapshot) -> Snapshot:
        match event:
            case Started(start_deg=start_deg, limits=limits):
                line = f"started at {start_deg:.2f}°, {limits}"
                # A search that begins anew keeps nothing of what was measured before.
                begun = replace(now, points=(), belief=None, refused=0, travel_deg=0.0)
                return replace(begun, phase="ready", start_deg=start_deg, probe_deg=start_deg, line=line)
            case Asked() | Turning() | Swept():
                return self._turning(event, now)
            case Measured():
                return self._measured(event, now)
            case Refused(angle_deg=angle_deg, reason=reason):
                return replace(
                    now, phase="refused", refused=now.refused + 1, line=f"refused at {angle_deg:.2f}°: {reason}"
                )
            case Finished(estimate=estimate):
                # The paper's form of a method always answers, and claims nothing.
                name = "angle, not claimed" if self._as_published else answer_name(estimate)
                belief = AngleBelief(estimate=estimate, claims=not self._as_published)
                line = ": ".join(filter(None, (name, angle_text(belief))))
                return replace(now, phase="finished", target_deg=None, line=line)
            case Failed(error=error):
                line = f"fault: {error}; {FAULT_END}"
                return replace(now, phase="fault", target_deg=None, line=line, problem=with_minus(str(error)))
            case Interrupted():
                return replace(now, phase="stopped", target_deg=None, line=STOPPED)
            case Resuming(by=by):
                return replace(
                    now,
                    phase="checking",
                    line=f"armed by {by}" + ("; measures the strongest angle again" if now.points else ""),
                )
            case Checked(difference=difference):
                return replace(now, phase="checking", line=f"checked: {difference or 'unchanged'}")

    def _turning(self, event: Asked | Turning | Swept, now: Snapshot) -> Snapshot:
        if isinstance(event, Turning):
            read = "type the angle reached" if event.angle_deg is None else f"it is at {event.angle_deg:.1f}°"
            line = f"turn the probe to {event.target_deg:.1f}°: {read}"
            return replace(now, phase="turning", target_deg=None, asked_deg=event.target_deg, line=line)
        if isinstance(event, Swept):
            line = f"the sweep is over after {counted(event.pulses, 'pulse')}, the probe is at {event.angle_deg:.2f}°"
            travel_deg = now.travel_deg + self._moved_deg(event.angle_deg)
            return replace(
                now, phase="measured", target_deg=None, probe_deg=event.angle_deg, travel_deg=travel_deg, line=line
            )
        where = "" if event.role == "dark" else f" at {event.angle_deg:.2f}°"
        swept = f"sweeps to {event.angle_deg:.2f}°"
        line = f"{self._name(event.role, event.index)}{where}" if event.sweep is None else swept
        return replace(now, phase="moving", target_deg=event.angle_deg, line=line)

    def cut_off(self, reason: str, *, problem: str = "") -> Snapshot:
        """State after the last event of a run that gave no end: where its probe is now is not known.

        ``problem``: what went wrong; empty where a person has stopped it.
        """
        last = self.snapshot
        phase: Phase = "cut off" if problem else "stopped"
        self.snapshot = replace(
            last,
            number=last.number + 1,
            phase=phase,
            target_deg=None,
            asked_deg=None,
            line=with_minus(reason),
            problem=with_minus(problem),
        )
        return self.snapshot

    def _name(self, role: Role, index: int) -> str:
        """Name of an acquisition."""
        if role == "confirmation" and self._as_published:
            return "acquisition at the answer"
        return f"{_ROLES[role]} {index}"

    def _moved_deg(self, angle_deg: float) -> float:
        """How far an angle is from where the probe was, in degrees."""
        return abs(angle_deg - (self.snapshot.probe_deg or 0.0))

    def _measured(self, event: Measured, now: Snapshot) -> Snapshot:
        sample = event.sample
        name = self._name(event.role, event.index)
        line = f"{name}: {sample.angle_deg:.2f}°, intensity {sample.reading.intensity:.4g}"
        phase: Phase = "measured" if sample.sweep is None else "sweeping"
        now = replace(now, phase=phase, target_deg=None, probe_deg=sample.angle_deg, line=line)
        if sample.dark:
            return now
        point = Point(
            role=event.role, number=event.index, angle_deg=sample.angle_deg, intensity=sample.reading.intensity
        )
        return replace(
            now,
            points=(*now.points, point),
            travel_deg=now.travel_deg + self._moved_deg(sample.angle_deg),
            snr_db=_larger(now.snr_db, _snr_db(sample)),
        )


def angle_text(belief: AngleBelief) -> str:
    """The angle that an answer names, or the angles, as precisely as it is known.

    Empty where nothing was detected, because the angle is then that of the noise.
    """
    estimate = belief.estimate
    if isinstance(estimate, NotFound):
        return ""
    if isinstance(estimate, Ambiguous):
        return with_minus(" or ".join(f"{each:.1f}°" for each in estimate.modes_deg))
    digits = 3 if belief.sigma_deg is None else digits_of(belief.sigma_deg)
    return with_minus(f"{estimate.mean_deg:z.{digits}f}°")


def digits_of(sigma_deg: float) -> int:
    """Digits behind the point that show two significant ones of a standard deviation."""
    # Rounded first: 0.0996 is 0.10 and not 0.100.
    return 3 if sigma_deg <= 0 else max(0, 1 - math.floor(math.log10(float(f"{sigma_deg:.1e}"))))


def with_minus(text: str) -> str:
    """A text whose negative numbers have a minus sign instead of a hyphen."""
    return re.sub(r"(?<![\w.])-(?=\d)", "−", text)


_ROLES: dict[Role, str] = {"dark": "dark frame", "search": "acquisition", "confirmation": "confirmation"}


def _pulses(event: JournalEvent) -> int:
    """Laser pulses of the frame of an event."""
    frame = event.sample.frame if isinstance(event, Measured) else getattr(event, "frame", None)
    return 0 if frame is None else frame.header.pulses


def _snr_db(sample: Sample) -> float | None:
    sigma, intensity = sample.reading.noise_sigma, sample.reading.intensity
    return 20 * math.log10(intensity / sigma) if sigma and intensity > 0 else None


def _larger(one: float | None, other: float | None) -> float | None:
    known = [value for value in (one, other) if value is not None]
    return max(known, default=None)
