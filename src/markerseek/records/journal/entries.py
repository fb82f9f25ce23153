"""What stands in a journal beside the events of the run itself, and an entry of either kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import msgspec

from markerseek.core import ChannelFrame, Event, Reading


class Interrupted(msgspec.Struct, frozen=True, kw_only=True):
    """The run was stopped from outside and can be resumed; after a sudden death there is no such entry.

    Attributes
    ----------
    reason
        What stopped it.
    """

    reason: str


class Resuming(msgspec.Struct, frozen=True, kw_only=True):
    """A person armed the rig again; before the search goes on, one angle or two are measured again.

    Attributes
    ----------
    by
        Name of the person.
    check_deg
        That angle in degrees, the strongest so far; None where nothing has been measured yet.
    flank_deg
        A second one, on a flank of the curve; None where there is none.
    fault_reset
        Whether the run had ended with a fault, and the person reset it.
    versions
        What goes on with it, as in `Configuration`.
    """

    by: str
    check_deg: float | None
    flank_deg: float | None = None
    fault_reset: bool
    versions: dict[str, str]


class Checked(msgspec.Struct, frozen=True, kw_only=True):
    """What was heard at an angle of `Resuming`; the strongest comes first.

    Attributes
    ----------
    reading
        What was heard now.
    difference
        How it differs from what was heard before, in words; None where it does not.
    frame
        Channel data of this check; None where there are intensities only.
    """

    reading: Reading
    difference: str | None
    frame: ChannelFrame | None = None


Happening: TypeAlias = Event | Interrupted | Resuming | Checked
"""Whatever a journal holds."""


class RecordedError(Exception):
    """The error with which a recorded run ended, of which only the name and the message are known.

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
    event: Happening
    checkpoint: bytes | None
