"""A study: which policies search in which worlds, how often, and from which seed. Frozen, and read from TOML.

A world is a simulated rig with its intensity curve. ``vary`` lists settings that take several values; every combination
of them is a cell of the study. Row k of a study's table is fixed by the study alone: cell by cell, in a cell trial by
trial, in a trial policy by policy.

Common random numbers: what a trial draws (marker, spot, noise) depends on the study's seed, the settings of the cell
and the number of the trial, and never on the policy or on the other cells. Policies are compared on the same worlds,
and a cell keeps its rows when others are added.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import math
import typing
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Literal, TypeAlias

import msgspec

from markerseek._version import __version__
from markerseek.core import ConfigError
from markerseek.search import method_named
from markerseek.settings_file import known_keys, read_toml, require_key
from markerseek.sim import SimulatedSettings

VERSION = 1
"""Version of the form of a study."""

Value: TypeAlias = str | float | int | bool | None
"""A setting that can be varied."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicySettings:
    """One way to search, as for `markerseek.search.build`.

    Attributes
    ----------
    method
        Name of the method.
    acquisitions
        Most acquisitions; None: the method's own.
    as_published
        The paper's form, which always answers.
    early_end
        Whether a weighted average may end before its last angle.
    """

    method: str
    acquisitions: int | None = None
    as_published: bool = False
    early_end: bool = True

    def __post_init__(self) -> None:
        least = method_named(self.method).least
        if self.acquisitions is not None and not self.acquisitions >= least:
            raise ConfigError(f"{self.method}: acquisitions is {self.acquisitions}, at least {least} are needed")

    @property
    def most(self) -> int:
        """Most acquisitions that it makes."""
        return self.acquisitions or method_named(self.method).acquisitions

    def __str__(self) -> str:
        form = " as published" if self.as_published else ""
        end = "" if self.early_end or self.method != "weighted-average" else ", no early end"
        return f"{self.method}{form}, {self.most}{end}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSettings:
    """Where the intensities of the level "curves" come from; at the level "frames" only the acoustics count.

    Attributes
    ----------
    family
        From the acoustics of the rig, or a closed form (`markerseek.sim.curves`).
    fwhm_deg, power
        Full width at half maximum in degrees and exponent of the tails, for the closed forms.
    draws
        Number of spots of a tissue that are drawn and whose curves are computed; a trial takes one of them.
    """

    family: Literal["acoustic", "gaussian", "sech", "power"] = "acoustic"
    fwhm_deg: float = 10.0
    power: float = 1.0
    draws: int = 4

    def __post_init__(self) -> None:
        for name in ("fwhm_deg", "power"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"curve: {name} is {getattr(self, name)}, it must be positive and finite")
        if not 1 <= self.draws <= 1000:
            raise ConfigError(f"curve: draws is {self.draws}, it must lie between 1 and 1000")


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A setting that takes several values.

    Attributes
    ----------
    key
        Its name with the parts in front, as in ``rig.noise.peak_snr_db`` or ``curve.fwhm_deg``.
    values
        The values.
    """

    key: str
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise ConfigError(f"vary: {self.key} has no values; give at least one, or leave it out")
        if len(set(self.values)) < len(self.values):
            raise ConfigError(f"vary: {self.key} names a value twice: {list(self.values)}; the cells would be the same")


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Everything that one cell's searches have in common."""

    curve: CurveSettings
    rig: SimulatedSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Study:
    """Policies × cells × trials.

    Attributes
    ----------
    name
        What it is called.
    policies
        Who searches.
    seed
        Seed of everything that is drawn.
    trials
        Searches of each policy in each cell.
    level
        From intensity curves, or from simulated channel data (hundreds of times slower).
    stay
        Whether the move to the answer and the confirmation there are left out.
    curve, rig
        Settings of the world.
    vary
        Those that take several values.
    version
        Version of the form of a study.
    """

    name: str
    policies: tuple[PolicySettings, ...]
    seed: int = 1
    trials: int = 100
    level: Literal["curves", "frames"] = "curves"
    stay: bool = False
    curve: CurveSettings = field(default_factory=CurveSettings)
    rig: SimulatedSettings = field(default_factory=SimulatedSettings)
    vary: tuple[Axis, ...] = ()
    version: int = VERSION

    def __post_init__(self) -> None:
        if self.version != VERSION:
            raise ConfigError(f"study: version is {self.version}, this package reads version {VERSION}")
        if not self.policies:
            raise ConfigError("study: there are no policies; name at least one method")
        if len(set(self.policies)) < len(self.policies):
            raise ConfigError("study: a policy is named twice; its rows would be the same")
        if not 1 <= self.trials <= 10**9:
            raise ConfigError(f"study: trials is {self.trials}, it must lie between 1 and 1,000,000,000")
        if not 0 <= self.seed < 2**63:
            raise ConfigError(f"study: seed is {self.seed}, it must be a whole number from 0 to 2**63 - 1")
        keys = [axis.key for axis in self.vary]
        if len(set(keys)) < len(keys):
            raise ConfigError(f"vary: a key is named twice in {', '.join(keys)}")
        if self.level == "frames" and any(key.startswith("curve.") for key in keys):
            raise ConfigError("study: curve settings do nothing at the level of frames; leave them out of vary")
        cells(self)

    @property
    def rows(self) -> int:
        """Number of rows of its table."""
        return len(cells(self)) * self.trials * len(self.policies)

    @property
    def digest(self) -> str:
        """Hash of the study and of the package's version, 16 hexadecimal digits: equal for equal tables."""
        return _digest(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One combination of the varied settings.

    Attributes
    ----------
    index
        Its number in the study, from 0.
    varied
        Values of the varied settings, by their keys, in the order of the study.
    world
        All settings.
    digest
        Number made of the settings alone, from which the trials' random numbers come.
    """

    index: int
    varied: tuple[tuple[str, Value], ...]
    world: World
    digest: int


@lru_cache(maxsize=32)
def _digest(study: Study) -> str:
    return _hashed([msgspec.to_builtins(study), __version__]).hexdigest()[:16]


@lru_cache(maxsize=32)
def cells(study: Study) -> tuple[Cell, ...]:
    """Cells of a study: every combination of its varied settings, the last key changing fastest.

    Raises
    ------
    ConfigError
        If a key is unknown, a value does not fit, or a combination cannot be.
    """
    made = []
    for index, values in enumerate(itertools.product(*(axis.values for axis in study.vary))):
        world = World(curve=study.curve, rig=study.rig)
        varied = tuple(zip((axis.key for axis in study.vary), values, strict=True))
        for key, value in varied:
            world = _changed(world, key.split("."), value, whole=key)
        if world.rig.noise.bursts is not None and study.level == "curves":
            raise ConfigError('rig.noise.bursts: bursts are simulated in frames only; set level = "frames"')
        digest = int.from_bytes(_hashed(msgspec.to_builtins(world)).digest()[:8], "big")
        made.append(Cell(index=index, varied=varied, world=world, digest=digest))
    return tuple(made)


def read_study(path: Path) -> Study:
    """Study of a TOML file.

    Its keys are the fields of `Study`. In ``[vary]`` stand lists, by dotted keys; ``acquisitions`` of a policy may be a
    list, which stands for as many policies; the word ``"none"`` stands for a value left out on purpose.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    ConfigError
        If the file cannot be read, a key is unknown, or a value does not fit; the message names file, key and cure.
    """
    table = read_toml(path, what="study file")
    try:
        # lists of tables are not dataclasses to the check of keys: each is checked on its own
        policies = [expanded for entry in _tables(table.pop("policies", [])) for expanded in _policies(entry)]
        vary = [{"key": key, "values": values} for key, values in _flat(table.pop("vary", {}))]
        settings = known_keys(table, Study)
        return msgspec.convert({"name": path.stem, **settings, "policies": policies, "vary": vary}, Study)
    except (ConfigError, msgspec.ValidationError) as problem:
        raise ConfigError(f"{path}: {problem}") from problem


def _tables(entries: object) -> list[dict[str, object]]:
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ConfigError("policies must be tables, each headed [[policies]]")
    return entries


def _policies(entry: dict[str, object]) -> list[dict[str, object]]:
    """One table of a policy for each number of acquisitions."""
    known = known_keys(entry, PolicySettings, prefix="policies.")
    numbers = known.get("acquisitions")
    return [{**known, "acquisitions": number} for number in (numbers if isinstance(numbers, list) else [numbers])]


def _flat(table: object, prefix: str = "") -> list[tuple[str, list[object]]]:
    """Dotted keys of nested tables, with their lists."""
    if not isinstance(table, Mapping):
        raise ConfigError("vary must be a table of lists, headed [vary]")
    found: list[tuple[str, list[object]]] = []
    for key, value in table.items():
        if isinstance(value, Mapping):
            found += _flat(value, f"{prefix}{key}.")
        elif isinstance(value, list):
            found.append((f"{prefix}{key}", [None if entry == "none" else entry for entry in value]))
        else:
            raise ConfigError(f"vary: {prefix}{key} is {value!r}, a list of values is needed")
    return found


T = typing.TypeVar("T")


def _changed(settings: T, path: Sequence[str], value: Value, *, whole: str) -> T:
    """The settings with one of them set; the value is checked against its type."""
    name = require_key(path[0], type(settings), prefix="vary: " + whole[: -len(".".join(path))])
    part = getattr(settings, name)
    if len(path) > 1:
        if not dataclasses.is_dataclass(part):
            raise ConfigError(f"vary: {whole}: {name} has no settings of its own")
        return dataclasses.replace(settings, **{name: _changed(part, path[1:], value, whole=whole)})  # type: ignore[type-var]
    try:
        fitting = msgspec.convert(value, typing.get_type_hints(type(settings))[name])
    except msgspec.ValidationError as problem:
        raise ConfigError(f"vary: {whole} is {value!r}: {problem}") from problem
    return dataclasses.replace(settings, **{name: fitting})  # type: ignore[type-var]


def _hashed(value: object) -> hashlib._Hash:
    return hashlib.sha256(msgspec.json.encode(value, order="deterministic"))
