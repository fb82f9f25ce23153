"""Events that only a journal has (interrupted, resuming, checked), and an entry of a journal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from markerseek.core import BModeFrame, ChannelFrame, Event, Reading, RFFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Interrupted:
    """The run was stopped from outside and can be resumed; after a sudden death there is no such entry.

    Attributes
    ----------
    reason
        What stopped it.
    """

    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Resuming:
    """A person armed the rig again; before the search continues, one angle or two are measured again.

    Attributes
    ----------
    by
        Name of the person.
    check_deg
        The first of these angles in degrees, the strongest so far; None where nothing has been measured yet.
    flank_deg
        The second, on a flank of the curve; None where there is none.
    fault_reset
        Whether the run had ended with a fault, and the person reset it.
    versions
        Versions of the program that continues, as in `Configuration`.
    """

    by: str
    check_deg: float | None
    flank_deg: float | None = None
    fault_reset: bool
    versions: dict[str, str]


@dataclass(frozen=True, slots=True, kw_only=True)
class Checked:
    """What was measured at an angle of `Resuming`; the strongest comes first.

    Attributes
    ----------
    reading
        The new reading.
    difference
        How it differs from the earlier one, in words; None where it does not.
    frame
        Data of this check; None where there are intensities only.
    """

    reading: Reading
    difference: str | None
    frame: ChannelFrame | RFFrame | BModeFrame | None = None


JournalEvent: TypeAlias = Event | Interrupted | Resuming | Checked
"""Every kind of event that a journal holds."""


class RecordedError(Exception):
    """The error that ended a recorded run, of which only the name and the message are known.

    Attributes
    ----------
    kind
        Name of its class.
    """

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One committed row.

    Attributes
    ----------
    number
        Counted from 1.
    written
        When it was committed, UTC, ISO 8601.
    clock_s
        The rig's clock then, in seconds.
    event
        What happened.
    checkpoint
        State of the simulated world after it; None where there is none, as with any real rig.
    """

    number: int
    written: str
    clock_s: float
    event: JournalEvent
    checkpoint: bytes | None
