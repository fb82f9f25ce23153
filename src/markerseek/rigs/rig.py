"""The type of an assembled rig: its devices, its scanner and its facts."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import msgspec
from msgspec.structs import replace

from markerseek._closing import Closing
from markerseek.core import ByHand, Laser, Receiver, RigFacts, RunPlan, SpotToSource, Stage
from markerseek.guard import Limits
from markerseek.rigs.probe_file import probe_facts
from markerseek.scan import Scanner
from markerseek.signals import ImageReader

if TYPE_CHECKING:
    # Not at run time: a simulated rig has no drivers and no recording.
    from markerseek.contract import RuleCheck
    from markerseek.drivers import BenchSettings


class Devices(Protocol):
    """Open lines to real devices."""

    def arm(self) -> None:
        """Enable commands."""

    def close(self) -> None:
        """Close them; allowed twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig(Closing):
    """An assembled rig."""

    facts: RigFacts
    """What is known of it."""
    stage: Stage
    laser: Laser
    receiver: Receiver
    scanner: Scanner
    imaging: ImageReader | None
    """Imaging chain of its channel data; None if there are intensities only."""
    spot: SpotToSource = field(default_factory=SpotToSource)
    """Where the light of a visible spot is absorbed, for a registration."""
    dark_frames: int
    """Number of dark frames at the start of a search; 0 if the rig cannot take any."""
    angles_deg: tuple[float, ...] | None = None
    """Angles that can be measured, each with one result, in degrees: those of a recording; None if any can."""
    by_hand: ByHand | None = None
    """How a person turns its probe; None if a motor does."""
    closing_dark: bool = False
    """Whether a search should end with a dark frame, as `markerseek.scan.run` says: on rigs of devices."""
    recipe: msgspec.Struct | None = None
    """Arguments to make the same rig again, a `markerseek.rigs.Recipe`; None if unknown."""
    devices: Devices | None = None
    """The lines to real devices; None if no hardware is involved."""
    bench: BenchSettings | None = None
    """Settings of a rig of devices, as its rig file has them; None of any other rig."""
    checks: Mapping[str, tuple[RuleCheck, ...]] = field(default_factory=dict)
    """Rules that foreign drivers were tried by when they were opened, by part and driver."""
    stage_since: str = ""
    """Since when its stage has always stood where it was left, UTC; empty: nobody keeps it."""
    notes: tuple[str, ...] = ()
    """What was assumed, changed or left out when a recording was read, in sentences."""

    def __repr__(self) -> str:
        """Return the rig in a line: devices and world would fill a page, and show where a simulated marker is."""
        return f"<{self.facts.kind} rig: {self.facts.description}, {self.limits.search}>"

    @property
    def run_plan(self) -> RunPlan:
        """How a search begins and ends on it: with the dark frames that it can take and needs."""
        # A recording holds no second acquisition at an angle, which could confirm the first.
        return RunPlan(dark_frames=self.dark_frames, closing_dark=self.closing_dark, stay=self.angles_deg is not None)

    def arm(self, *, by: str) -> None:
        """Allow it to move and fire, in the name of a person who is present; a fault must be reset first."""
        self.scanner.guard.arm(by=by)
        if self.devices is not None:
            self.devices.arm()

    def close(self) -> None:
        """Release its devices; allowed twice."""
        if self.devices is not None:
            self.devices.close()

    @property
    def limits(self) -> Limits:
        """Limits of search and travel."""
        return self.scanner.limits

    @property
    def simulated(self) -> bool:
        """Whether no hardware is involved."""
        return self.facts.kind == "simulated"


def with_probe(facts: RigFacts, imaging: ImageReader | None) -> RigFacts:
    """Return the facts with those of the probe from an imaging chain; unchanged where there are intensities only."""
    return facts if imaging is None else replace(facts, **probe_facts(imaging.preset))


def fingerprint_of(values: object) -> str:
    """Return the fingerprint of a rig: the first half of the SHA-256 of what describes it, as JSON."""
    # 128 bits exclude a coincidence, and fit into one line of a table.
    return hashlib.sha256(msgspec.json.encode(values)).hexdigest()[:32]
