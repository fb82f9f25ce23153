"""Events that only a journal has (interrupted, resuming, checked), and an entry of a journal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from markerseek.core import ChannelFrame, Event, Reading


@dataclass(frozen=True, slots=True, kw_only=True)
class Interrupted:
    """The run was stopped from outside and can be resumed; after a sudden death there is no such entry."""

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Resuming:
    """A person armed the rig again; before the search continues, its strongest angle is measured again."""

    by: str
    check_deg: float | None
    """This angle; None if nothing has been measured yet."""
    fault_reset: bool
    """Whether the run had ended with a fault, and the person reset it."""
    versions: dict[str, str]
    """Versions of the program that continues, as in `Configuration`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """What was measured at the angle of `Resuming`."""

    reading: Reading
    difference: str | None
    """How the reading differs from the earlier one, in words, so that the search begins again; None if it does not."""
    frame: ChannelFrame | None = None
    """None if there are intensities only."""


JournalEvent: TypeAlias = Event | Interrupted | Resuming | Checked
"""Every kind of event that a journal holds."""


class RecordedError(Exception):
    """The error that ended a recorded run; only its name and message are known."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One committed event."""

    number: int
    """Counted from 1."""
    written: str
    """When it was committed, UTC, ISO 8601."""
    clock_s: float
    """The rig's clock then."""
    event: JournalEvent
