"""The type of an assembled rig (devices, scanner, facts), and the fingerprint of its settings."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Protocol, Self

import msgspec

from markerseek.core import ByHand, Laser, Receiver, RigFacts, RunPlan, Stage
from markerseek.drivers import BenchSettings
from markerseek.guard import Limits
from markerseek.records.banks import FrameBank, IntensityBank
from markerseek.rigs.probe_file import probe_facts
from markerseek.rigs.recipe import Recipe
from markerseek.scan import Scanner
from markerseek.signals import AnyImageReader
from markerseek.sim import SimulatedSettings, hashable_values
from markerseek.testing import RuleCheck
from markerseek.vision import TipSettings


class Checkpointed(Protocol):
    """A simulated world whose state can be saved and restored."""

    def checkpoint(self) -> bytes:
        """State now, as JSON."""

    def restore(self, checkpoint: bytes) -> None:
        """Restore a state."""


class Devices(Protocol):
    """Open lines to real devices."""

    def arm(self) -> None:
        """Enable commands."""

    def close(self) -> None:
        """Close them; allowed twice."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rig:
    """An assembled rig."""

    facts: RigFacts
    """What is known of it."""
    stage: Stage
    laser: Laser
    receiver: Receiver
    scanner: Scanner
    imaging: AnyImageReader | None
    """Imaging chain of its channel data or RF lines; None where there are intensities only, or B-mode images."""
    dark_frames: int
    """Number of dark frames at the start of a search; 0 if the rig cannot take any."""
    angles_deg: tuple[float, ...] | None = None
    """Angles that can be measured, each with one result, in degrees: those of a recording; None if any can."""
    by_hand: ByHand | None = None
    """How a person turns its probe; None where a motor does."""
    closing_dark: bool = False
    """Whether a search should end with a dark frame, as `markerseek.scan.run` says: on rigs of devices."""
    tip: TipSettings | None = None
    """How its B-mode images are read; None where it gives other frames."""
    recipe: Recipe | None = None
    """Arguments to make the same rig again; None if unknown."""
    world: Checkpointed | None = None
    """Simulated world or replayed recording, whose state a journal stores with each commit; None for real devices."""
    devices: Devices | None = None
    """The lines to real devices; None where no hardware is involved."""
    bench: BenchSettings | None = None
    """Settings of a rig of devices, as its rig file has them; None of any other rig."""
    checks: Mapping[str, tuple[RuleCheck, ...]] = field(default_factory=dict)
    """Rules that foreign drivers were tried by when they were opened, by part and driver."""

    def __repr__(self) -> str:
        """What it is, in a line: devices and world would fill a page, and tell where a simulated marker is."""
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    @property
    def limits(self) -> Limits:
        """Limits of search and travel."""
        return self.scanner.limits

    @property
    def simulated(self) -> bool:
        """Whether no hardware is involved."""
        return self.facts.kind == "simulated"


def with_probe(facts: RigFacts, imaging: AnyImageReader | None) -> RigFacts:
    """The facts with those of the probe from an imaging chain; unchanged where there are intensities only."""
    return facts if imaging is None else replace(facts, **probe_facts(imaging.preset))


def fingerprint(of: SimulatedSettings | BenchSettings | IntensityBank | FrameBank) -> str:
    """First half of the SHA-256 of the settings, or of the metadata of a recording, as JSON.

    Frames are not included. Unknown metadata are left out, so that the fingerprint does not change when a later version
    adds a field.
    """
    plain: object = hashable_values(of) if isinstance(of, SimulatedSettings) else of
    if isinstance(of, BenchSettings):
        plain = of.table()
    if isinstance(of, IntensityBank | FrameBank):
        facts = msgspec.to_builtins(of.facts)
        known = {name: value for name, value in facts.items() if value is not None}
        plain = {"angles_deg": of.angles_deg, "intensities": of.intensities, "facts": known}
    # 128 bits exclude a coincidence, and fit into one line of a table.
    return hashlib.sha256(msgspec.json.encode(plain)).hexdigest()[:32]
