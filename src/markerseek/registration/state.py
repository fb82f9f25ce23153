"""What is known of a registration now: that of a finished file, or of a session step by step.

A registration holds while the newest markers say that it is decided. It holds no longer when a later marker makes it
undecided, or when a marker that was measured again has moved. It holds on when the session ends, or its program dies:
nothing was measured that speaks against it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, Self

from markerseek.registration.report import KnownRegistration
from markerseek.registration.steps import Begun, Ended, MovedMarker, RecordedStep, Registered, TakenMarker

Phase = Literal["running", "stopped", "ended", "unreadable"]
"""Of a session: a program runs it; none runs it, and it has not ended; it has ended; its record cannot be read."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RegistrationState:
    """A registration as other programs are to see it now."""

    source: Path
    """The file, or the folder of the session."""
    simulated: bool
    """Whether markers and camera are simulated."""
    registration: KnownRegistration | None
    """What holds now; None: nothing."""
    said: str
    """The state in a sentence."""
    session: Phase | None
    """How the session stands; None for a finished file."""
    markers: int
    """Number of markers that were taken."""
    moved: bool = False
    """Whether a marker has moved since it was taken."""

    @classmethod
    def of_file(cls, known: KnownRegistration, path: Path) -> Self:
        """State of a finished file."""
        said = (
            f"registered: expected error at the target {1e3 * known.report.tre_m:.2f} mm, in 95 % below "
            f"{1e3 * known.report.tre95_m:.2f} mm"
        )
        return cls(
            source=path,
            simulated=known.simulated,
            registration=known,
            said=said,
            session=None,
            markers=len(known.report.points),
        )

    @classmethod
    def of_session(cls, begun: Begun, folder: Path) -> Self:
        """State of a session that has begun."""
        return cls(
            source=folder,
            simulated=begun.simulated,
            registration=None,
            said="not registered: no marker yet",
            session="running",
            markers=0,
        )

    def after(self, step: RecordedStep) -> RegistrationState:
        """State after a step of the session; `RecordError` if its transform is not rigid."""
        match step:
            case Registered():
                # A marker that has moved is still among those of a session that was continued.
                holds = step.decided and not self.moved and step.report is not None
                known = self._known(step) if holds else None
                said = self.said if self.moved else step.said
                return replace(self, session="running", registration=known, said=said)
            case MovedMarker(moved=True):
                return replace(self, session="running", registration=None, said=step.said, moved=True)
            case TakenMarker(again=None):
                return replace(self, session="running", markers=self.markers + 1)
            case Ended():
                return replace(self, session="ended", said=self.said if self.moved else step.said)
            case _:
                return replace(self, session="running")

    def _known(self, step: Registered) -> KnownRegistration:
        assert step.report is not None  # noqa: S101  asked for a registration only
        return KnownRegistration.of(step.report, source=self.source, simulated=self.simulated)

    def unreadable(self, reason: str) -> RegistrationState:
        """State once the record cannot be read: what holds is not known any more."""
        return replace(self, session="unreadable", registration=None, said=_text(reason))

    @property
    def sentence(self) -> str:
        """The state for people, with what to do if no program runs its session."""
        if self.session != "stopped":
            return self.said
        return f"{self.said}; its session was stopped: continue it, or register again"

    @property
    def known(self) -> dict[str, object]:
        """What is shown beside the transform; its errors only if the registration is valid."""
        errors = {"markers": self.markers} if self.registration is None else self.registration.errors
        return {
            "file": _text(self.source.name),
            "simulated": self.simulated,
            "decided": self.registration is not None,
            "session": self.session,
            "said": self.sentence,
            **errors,
        }


def _text(text: str) -> str:
    """Text that can be sent: the name of a file may be none."""
    return text.encode(errors="replace").decode()
