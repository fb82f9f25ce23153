"""What a journal holds: the configuration of a run, then its entries; and the events that only a journal has."""

from __future__ import annotations

import platform
from dataclasses import dataclass
from typing import TypeAlias

import msgspec
import numpy as np
import scipy

from markerseek._version import __version__
from markerseek.core import ChannelFrame, Event, Reading, RigFacts, SearchPlan


def versions() -> dict[str, str]:
    """Versions of the libraries on which the last bit of a result depends."""
    return {
        "markerseek": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "machine": platform.machine(),
    }


class Configuration(msgspec.Struct, frozen=True, kw_only=True):
    """Search and rig of a run."""

    plan: SearchPlan
    """What was asked of the search."""
    facts: RigFacts
    """What was known of the rig."""
    # Raw JSON, not decoded here: records may not import the settings of rigs and drivers.
    recipe: msgspec.Raw
    """All settings of the rig, as JSON; null for a rig that was not assembled from settings."""
    imaging: msgspec.Raw = msgspec.Raw(b"null")
    """Preset of the rig's imaging chain, as JSON; null where there are intensities only."""
    bank: msgspec.Raw = msgspec.Raw(b"null")
    """Facts of the bank that a scan becomes, as JSON; null for a search."""
    versions: dict[str, str] = msgspec.field(default_factory=versions)

    def flat(self) -> dict[str, object]:
        """Plan and facts as one flat table for JSON output; ``rig`` is the kind of the rig."""
        plan: dict[str, object] = msgspec.to_builtins(self.plan)
        facts: dict[str, object] = msgspec.to_builtins(self.facts)
        # Beside the keys of the plan, "kind" alone would not say of what.
        facts["rig"] = facts.pop("kind")
        return plan | facts | {"recipe": self.recipe, "imaging": self.imaging, "versions": self.versions}


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
