"""The type of an assembled rig (devices, scanner, facts), its fingerprint, its recipe in a journal, and its rig file.

A rig file (TOML) becomes the settings of a rig; its keys have the names of the Python fields.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Protocol, TypeAlias

import msgspec
from msgspec.structs import replace

from markerseek._closing import Closing
from markerseek.contract import RuleCheck
from markerseek.core import ByHand, ConfigError, Laser, Receiver, RecordError, RigFacts, RunPlan, SpotToSource, Stage
from markerseek.drivers import BenchSettings, bench_settings_from
from markerseek.files import quoted, read_toml, settings_from
from markerseek.guard import Limits
from markerseek.records.banks import DEFAULT_FORMAT, FrameBank, IntensityBank, TableFormat
from markerseek.rigs.probe_file import probe_facts
from markerseek.scan import Scanner
from markerseek.signals import ImageReader, ProbePreset
from markerseek.sim import SimulatedSettings, hashable_values


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
    recipe: Recipe | None = None
    """Arguments to make the same rig again; None if unknown."""
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


def fingerprint(of: SimulatedSettings | BenchSettings | IntensityBank | FrameBank) -> str:
    """Return the first half of the SHA-256 of the settings, or of the metadata of a recording, as JSON.

    Frames are not included. Unknown metadata are left out, so that the fingerprint does not change when a later version
    adds a field.
    """
    if isinstance(of, SimulatedSettings):
        plain = hashable_values(of)
    elif isinstance(of, BenchSettings):
        plain = of.table()
        # Fingerprints of rigs are older than this key.
        if of.spot == SpotToSource():
            del plain["spot"]
    else:
        facts = msgspec.to_builtins(of.facts)
        known = {name: value for name, value in facts.items() if value is not None}
        plain = {"angles_deg": of.angles_deg, "intensities": of.intensities, "facts": known}
    # 128 bits exclude a coincidence, and fit into one line of a table.
    return hashlib.sha256(msgspec.json.encode(plain)).hexdigest()[:32]


class SimulatedRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="simulated"):
    """Arguments of `markerseek.rigs.simulated`."""

    seed: int
    settings: SimulatedSettings
    pace: float

    def __post_init__(self) -> None:
        if not self.seed >= 0:
            raise ConfigError(f"seed is {self.seed}, it must be 0 or a positive whole number")


class ReplayedRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="replayed"):
    """Arguments of `markerseek.rigs.replayed`; the path is absolute."""

    path: str
    probe: str | ProbePreset | None
    reference_deg: float | None
    between: Literal["nearest", "interpolated"]
    table: TableFormat = DEFAULT_FORMAT


class BenchRecipe(msgspec.Struct, frozen=True, kw_only=True, tag="bench"):
    """Arguments of `markerseek.rigs.bench_rig.bench`, as the tables of its rig file."""

    # Plain values: the drivers that they name are looked up when they are compared with a rig file.
    tables: dict[str, Any] = msgspec.field(name="settings")

    @classmethod
    def of(cls, settings: BenchSettings) -> BenchRecipe:
        """Return the recipe with these settings."""
        return cls(tables=settings.table())

    @property
    def settings(self) -> BenchSettings:
        """The settings; `RecordError` if the tables hold none."""
        try:
            return bench_settings_from(self.tables)
        except (ConfigError, RecursionError) as problem:
            raise RecordError(f"the journal's rig cannot be read: {problem}") from problem


Recipe: TypeAlias = SimulatedRecipe | ReplayedRecipe | BenchRecipe
"""Recipe of any kind of rig."""


_KINDS = ("simulated", "bench")
"""Kinds of rig that a file can describe."""


def read_rig_file(path: Path) -> SimulatedSettings | BenchSettings:
    """Return the settings of the rig in a file.

    ``path``: TOML file. ``kind`` names the kind of rig: ``simulated``, or ``bench`` for one of real devices. The other
    keys are those of `SimulatedSettings` or `BenchSettings`. The text ``"none"`` means None, for example no lens. A
    receiver's folder is relative to the rig file, and the module of a foreign driver is looked for beside it and
    imported: a rig file can run code.
    """
    table = read_toml(path, what="rig file")
    if "policies" in table:
        raise ConfigError(f"{path}: it has policies, so it is a study file; run it: `run_study({quoted(path)})`")
    if "kind" not in table:
        raise ConfigError(f'{path}: the key kind is missing; write kind = "simulated" or kind = "bench" at its top')
    # Removed here, because it selects the settings that know the other keys.
    kind = table.pop("kind")
    if kind not in _KINDS:
        raise ConfigError(f"{path}: kind is {kind!r}, it must be one of: {', '.join(_KINDS)}")
    try:
        if kind == "simulated":
            return settings_from(table, SimulatedSettings)
        return bench_settings_from(table, beside=str(path.parent.absolute()))
    except ConfigError as problem:
        raise ConfigError(f"{path}: {problem}") from problem


def read_simulated(path: Path | None, *, cure: str) -> SimulatedSettings:
    """Return the settings of the simulated rig in a file; the defaults without a file.

    ``cure``: advice for the message if the file describes a rig of real devices.
    """
    settings = SimulatedSettings() if path is None else read_rig_file(path)
    if not isinstance(settings, SimulatedSettings):
        raise ConfigError(f"{path}: its kind is bench; {cure}")
    return settings
