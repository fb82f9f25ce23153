"""The one fold of a session's steps: what the session decides by, and what all programs show of it.

A view is a value: each step gives the next one. A registration holds while the newest markers say that it is decided.
It holds no longer when a later marker makes it undecided. When a marker that was measured again has moved, no
registration of this session holds any more, also if the session is continued. A registration that a check refutes holds
no longer; one with another marker may. A registration holds on when the session ends, or its program dies: nothing was
measured that speaks against it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, Self, TypeAlias

from msgspec import structs

from markerseek.core import RecordError
from markerseek.registration.endoscope_motion import SeenEndoscope
from markerseek.registration.plan import USUAL_TRE_MM, SessionPlan
from markerseek.registration.report import KnownRegistration, RegistrationReport
from markerseek.registration.stations import stands_elsewhere, station_names
from markerseek.registration.steps import (
    Begun,
    Continued,
    CorrectedMarker,
    Ended,
    MovedMarker,
    RecordedStep,
    Registered,
    SpotChecked,
    SpotRefused,
    SpotSeen,
    TakenMarker,
    Waiting,
)

Phase: TypeAlias = Literal["running", "stopped", "ended", "unreadable"]
"""Of a session: a program runs it; none runs it, and it has not ended; it has ended; its record cannot be read."""

Use: TypeAlias = Literal["used", "left out", "open", "not found", "lost"]
"""How a registration uses a marker; *lost*: it is not known where the endoscope sees it now."""


class ExpectedError(NamedTuple):
    """Expected error of a registration that was accepted."""

    markers: int
    tre_m: float
    tre95_m: float


# eq=False: views are compared often, and two are equal only if they are the same object.
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SessionView:
    """A session after its steps so far, or a registration that is finished."""

    source: Path | None = None
    """Folder of the session, or the file of the finished registration; None: it is not recorded."""
    phase: Phase | None = "running"
    """How the session stands; None for a finished file."""
    begun: Begun | None = None
    """What the session registers; None before its first step, and of a finished file."""
    goal_m: float = USUAL_TRE_MM / 1e3
    """Expected TRE at which it ends."""
    target_trus_m: tuple[float, float, float] | None = None
    """Point of the expected error, in the TRUS frame; None: the usual one."""
    markers: tuple[TakenMarker, ...] = ()
    """Markers that were taken, without those that were measured again."""
    waiting: Waiting | None = None
    """What the person has to do now; None while a marker is searched, and at the end."""
    refused: SpotRefused | None = None
    """Why the last spot was not accepted; None after an accepted spot."""
    searched: SpotSeen | None = None
    """The spot whose marker is searched."""
    endoscope: SeenEndoscope | None = None
    """Whether the endoscope has moved since the markers before, as it was seen last; None: nobody looked."""
    displaced: SeenEndoscope | None = None
    """How the endoscope has moved, or may have, since the last marker; None: it stands there."""
    last: Registered | None = None
    """What the markers so far say together; None before the first marker."""
    registration: KnownRegistration | None = None
    """The registration that holds now; None: none does, and `reason` says why."""
    errors: tuple[ExpectedError, ...] = ()
    """Expected error of each registration so far."""
    measured_again: tuple[MovedMarker, ...] = ()
    """Markers that were measured again at the end."""
    checks: tuple[SpotChecked, ...] = ()
    """Spots that checked a registration of the session, also of fewer markers than it has now."""
    ended: Ended | None = None
    """How the session ended; None while it has not."""
    problem: str = ""
    """Why the record cannot be read; empty if it can."""

    @classmethod
    def of_file(cls, known: KnownRegistration, path: Path) -> Self:
        """Return the view of a finished file."""
        return cls(source=path, phase=None, registration=known)

    def after(self, step: RecordedStep) -> SessionView:
        """Return the view after one more step.

        Raises `RecordError` if the step cannot follow: a marker is missing or recorded twice, or a transform is not
        rigid.
        """
        running = replace(self, phase="running", ended=None)
        match step:
            case Begun() | Continued():
                begun = step if isinstance(step, Begun) else self.begun
                return replace(running, begun=begun, goal_m=step.goal_m, target_trus_m=step.target_trus_m)
            case Waiting():
                return replace(running, waiting=step, searched=None)
            case SpotRefused():
                return replace(running, refused=step, searched=None)
            case SpotSeen():
                return _after_spot(running, step)
            case TakenMarker() | CorrectedMarker():
                return _after_marker(running, step)
            case Registered():
                return _after_registered(running, step)
            case MovedMarker():
                return _after_measured_again(running, step)
            case SpotChecked():
                return _after_check(running, step)
            case Ended():
                return replace(self, phase="ended", ended=step, waiting=None, searched=None)

    def unreadable(self, problem: str) -> SessionView:
        """Return the view once the record cannot be read: what holds is not known any more."""
        return replace(self, phase="unreadable", registration=None, problem=_text(problem))

    def continue_plan(self, plan: SessionPlan) -> SessionPlan:
        """Return the plan of who continues the session, with its goal and target where the plan names none."""
        if self.begun is None:
            return plan
        return structs.replace(
            plan,
            tre_mm=1e3 * self.goal_m if plan.tre_mm is None else plan.tre_mm,
            target_trus_m=self.target_trus_m if plan.target_trus_m is None else plan.target_trus_m,
        )

    @property
    def simulated(self) -> bool:
        """Whether markers and camera are simulated."""
        if self.begun is not None:
            return self.begun.simulated
        return self.registration is not None and self.registration.simulated

    @property
    def next_name(self) -> str:
        """Name of the next marker."""
        return str(1 + len(self.markers))

    @property
    def moved(self) -> tuple[MovedMarker, ...]:
        """Markers that have moved since they were taken; with one, no registration of the session holds any more."""
        return tuple(each for each in self.measured_again if each.moved)

    def refutation(self, chosen: Mapping[str, int]) -> SpotChecked | None:
        """Return the last check that the registration by these candidates has failed; None if it has failed none."""
        failed = [each for each in self.checks if each.chosen == chosen and not each.check.agrees]
        return failed[-1] if failed else None

    @property
    def refuted(self) -> SpotChecked | None:
        """The last check that the registration of the markers so far has failed; None if it has failed none."""
        return None if self.last is None else self.refutation(self.last.chosen)

    @property
    def goal_reached(self) -> bool:
        """Whether a registration holds whose expected error is at most the goal."""
        return self.registration is not None and self.registration.report.tre_m <= self.goal_m

    @property
    def left_out(self) -> tuple[str, ...]:
        """Markers that do not fit the others."""
        return () if self.last is None else self.last.left_out

    @property
    def rig_s(self) -> float:
        """Time of the rig for all markers so far, without waiting for a person."""
        return sum(marker.rig_s for marker in self.markers)

    @property
    def reason(self) -> str | None:
        """Why no registration holds; None if one does."""
        if self.registration is not None:
            return None
        if self.problem:
            return self.problem
        if self.moved:
            return self.moved[-1].said
        if self.displaced is not None:
            return self.displaced.said
        if self.refuted is not None:
            return self.refuted.said
        if self.last is None:
            return "no marker was taken"
        return self.last.reason or self.last.said

    @property
    def report(self) -> RegistrationReport | None:
        """The registration from the markers so far, without its transform unless it holds; None: too few markers."""
        report = None if self.last is None else self.last.report
        if report is None or self.registration is not None:
            return report
        return structs.replace(report, registered=False, davinci_to_trus=None, reason=self.reason)

    @property
    def said(self) -> str:
        """The state in a sentence."""
        if self.problem:
            return self.problem
        if self.moved:
            return self.moved[-1].said
        if self.ended is not None:
            return self.ended.said
        if self.displaced is not None:
            return f"not registered: {self.displaced.said}"
        if self.refuted is not None:
            return f"not registered: {self.refuted.said}"
        if self.last is not None:
            return self.last.said
        if self.registration is not None:
            return f"registered: {self.registration.report.expected}"
        return "not registered: no marker yet"

    @property
    def sentence(self) -> str:
        """The state for people, with what to do if no program runs the session."""
        if self.phase != "stopped":
            return self.said
        cure = "register again" if self.moved else "continue it, or register again"
        return f"{self.said}; its session was stopped: {cure}"

    @property
    def known(self) -> dict[str, object]:
        """What other programs get beside the transform; its errors only if a registration holds."""
        errors = {"markers": len(self.markers)} if self.registration is None else self.registration.errors
        return {
            "file": "" if self.source is None else _text(self.source.name),
            "simulated": self.simulated,
            "decided": self.registration is not None,
            "session": self.phase,
            "said": self.sentence,
            **errors,
            "motion": self.motion,
        }

    @property
    def motion(self) -> dict[str, object] | None:
        """What the cameras saw move, and what was done about it, for other programs; None: nobody looked.

        Markers that were seen from another place of the endoscope are ``carried`` into its present frame, or do not
        count (``lost``).
        """
        searches = [
            {
                "marker": marker.name,
                "said": marker.scene.said,
                "known": marker.scene.is_known,
                "moved": marker.scene.moved,
            }
            for marker in self.markers
            if marker.scene is not None
        ]
        if self.endoscope is None and not searches:
            return None
        stations = station_names(self.markers)
        here = next(reversed(stations.values()), "")
        return {
            "endoscope": None
            if self.endoscope is None
            else {"state": self.endoscope.state, "said": self.endoscope.said},
            "carried": [name for name, station in stations.items() if station != here and name not in self.lost],
            "lost": list(self.lost),
            "searches": searches,
        }

    @property
    def lost(self) -> tuple[str, ...]:
        """Markers of which it is not known where the endoscope sees them now."""
        return () if self.last is None else self.last.lost

    @property
    def motions(self) -> tuple[tuple[str, str], ...]:
        """What moved during the search of a marker, or that it is not known: its name, and a sentence."""
        scenes = [(marker.name, marker.scene) for marker in self.markers if marker.scene is not None]
        return tuple((name, scene.said) for name, scene in scenes if scene.moved or not scene.is_known)

    def use_of(self, marker: TakenMarker) -> Use:
        """Return how the registration uses a marker."""
        if marker.name in self.lost:
            return "lost"
        if not marker.candidates:
            return "not found"
        if self.last is not None and marker.name in self.last.left_out:
            return "left out"
        return "open" if self.last is not None and marker.name in self.last.open else "used"


def _after_spot(view: SessionView, step: SpotSeen) -> SessionView:
    """Return the view after a spot; a registration of an endoscope that has moved since holds no longer."""
    seen = step.endoscope
    displaced = seen if stands_elsewhere(view.markers, seen) else view.displaced
    return replace(
        view,
        searched=step,
        waiting=None,
        refused=None,
        endoscope=seen,
        displaced=displaced,
        registration=view.registration if displaced is None else None,
    )


def _after_marker(view: SessionView, step: TakenMarker | CorrectedMarker) -> SessionView:
    """Return the view after a marker; one that was measured again, or checks the registration, is no marker more."""
    if isinstance(step, CorrectedMarker):
        return _after_corrected(view, step)
    if step.again is not None or step.check:
        return replace(view, searched=None)
    if step.name != view.next_name:
        raise RecordError(
            f"marker {step.name} follows where marker {view.next_name} is due: lines of the record were removed or "
            "doubled"
        )
    return replace(view, searched=None, displaced=None, markers=(*view.markers, step))


def _after_corrected(view: SessionView, step: CorrectedMarker) -> SessionView:
    """Return the view after an earlier marker was answered again."""
    if step.name not in {marker.name for marker in view.markers}:
        raise RecordError(f"marker {step.name} is corrected, which is not recorded: a line was removed")
    markers = tuple(step.of(marker) if marker.name == step.name else marker for marker in view.markers)
    return replace(view, markers=markers)


def _after_measured_again(view: SessionView, step: MovedMarker) -> SessionView:
    """Return the view after a marker that was measured again."""
    registration = None if step.moved else view.registration
    return replace(view, registration=registration, measured_again=(*view.measured_again, step))


def _after_check(view: SessionView, step: SpotChecked) -> SessionView:
    """Return the view after a spot that checked the registration."""
    if view.last is None:
        raise RecordError(f"{step.check.name} checks a registration that is not recorded: a line was removed")
    return _after_registered(replace(view, checks=(*view.checks, step)), view.last)


def _after_registered(view: SessionView, step: Registered) -> SessionView:
    """Return the view after what the markers so far say together; a registration that a check refutes does not hold."""
    unknown = step.chosen.keys() - {marker.name for marker in view.markers}
    if unknown:
        raise RecordError(f"a registration uses marker {min(unknown)}, which is not recorded: a line was removed")
    registration = None
    errors = view.errors
    report = step.report
    if step.endoscope is not None:
        # Markers that are carried hold where it stands now.
        carried = step.endoscope.state != "not known"
        view = replace(view, endoscope=step.endoscope, displaced=None if carried else step.endoscope)
    if report is not None:
        # Also of a session that is continued, which says again what its markers said before.
        report = structs.replace(report, checks=[each.check for each in view.checks if each.chosen == step.chosen])
        step = structs.replace(step, report=report)
        holds = step.decided and not view.moved and view.displaced is None and view.refutation(step.chosen) is None
        if holds:
            registration = KnownRegistration.of(report, source=view.source, simulated=view.simulated)
        if report.registered:
            error = ExpectedError(markers=len(report.points), tre_m=report.tre_m, tre95_m=report.tre95_m)
            errors = errors if errors[-1:] == (error,) else (*errors, error)
    return replace(view, last=step, registration=registration, errors=errors, searched=None)


def _text(text: str) -> str:
    """Return text that can be sent: the name of a file may be none."""
    return text.encode(errors="replace").decode()
