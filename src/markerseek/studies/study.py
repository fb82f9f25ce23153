"""A study: policies, simulated worlds, number of trials, and seed; read from a TOML file by `read_study`.

A world is a simulated rig with its intensity curve. ``vary`` lists settings with several values; every combination of
them is a cell of the study. The rows of its table are in a fixed order: by cell, then by trial, then by policy.

Common random numbers: what a trial draws (marker, spot, noise) depends on the study's seed, the settings of the cell
and the number of the trial, not on the policy or on other cells. Policies are compared on the same draws, and a cell
keeps its rows when others are added.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Literal, TypeAlias

import msgspec
from msgspec import structs

from markerseek._version import __version__
from markerseek.core import ConfigError
from markerseek.files import read_toml, require_key, setting_from, settings_from
from markerseek.sim import PowerCurve, SimulatedSettings, hashable_values
from markerseek.studies.policies import StudyPolicy, study_policy
from markerseek.studies.unknowns import SceneSettings

_VERSION = 1
"""Version of the form of a study."""

MAX_POLICIES = 1000
_MAX_CELLS = 10_000
_MAX_ROWS = 10**9
"""Most policies, combinations of varied settings, and rows of the table, of one study."""


Value: TypeAlias = str | float | int | bool | None
"""A setting that can be varied."""


class CurveSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Source of the intensities at the level "curves"; at the other levels they come from the acoustics."""

    family: Literal["acoustic", "gaussian", "sech", "power"] = "acoustic"
    """The acoustics of the rig, or a closed form (`markerseek.sim.curves`)."""
    fwhm_deg: float = 10.0
    """Full width at half maximum of a closed form, in degrees."""
    power: float = 1.0
    """Exponent of the tails of the closed form "power"."""
    draws: int = 4
    """Number of spots of a tissue that are drawn, each with its curve; a trial takes one of them."""
    noise_stated: bool = True
    """Whether each intensity comes with its noise and cells, after dark frames; otherwise it is as in a CSV."""

    def __post_init__(self) -> None:
        # The closed forms know their own bounds.
        PowerCurve(fwhm_deg=self.fwhm_deg, power=self.power)
        if not 1 <= self.draws <= 1000:
            raise ConfigError(f"curve: draws is {self.draws}, it must lie between 1 and 1000")


class Axis(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A setting that takes several values."""

    key: str
    """Its dotted name, as in ``rig.noise.peak_snr_db`` or ``curve.fwhm_deg``."""
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise ConfigError(f"vary: {self.key} has no values; give at least one, or leave it out")
        if len(set(self.values)) < len(self.values):
            raise ConfigError(f"vary: {self.key} names a value twice: {list(self.values)}; the cells would be the same")


class CellWorld(msgspec.Struct, frozen=True, kw_only=True):
    """All settings of one cell."""

    curve: CurveSettings
    rig: SimulatedSettings
    scene: SceneSettings = SceneSettings()


class Study(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Policies × cells × trials."""

    name: str
    policies: tuple[StudyPolicy, ...]
    seed: int = 1
    trials: int = 100
    """Searches of each policy in each cell."""
    level: Literal["curves", "frames"] = "curves"
    """From intensity curves, or from simulated channel data, which is hundreds of times slower."""
    drawn: Literal["marker", "everything", "everything-and-timing"] = "marker"
    """What is drawn in each trial besides noise: the marker's angle and place; everything that is unknown in the
    physics table (`markerseek.studies.unknowns`), which needs frames; or that and what a sweep does not know of stage
    and laser."""
    marks: tuple[int, ...] = ()
    """Numbers of acquisitions, rising, after which the answer of the search so far is recorded."""
    stay: bool = False
    """Whether to leave out the move to the answer and the confirmation there."""
    curve: CurveSettings = CurveSettings()
    """Source of the intensities at the level "curves"."""
    rig: SimulatedSettings = SimulatedSettings()
    """The simulated rig."""
    scene: SceneSettings = SceneSettings()
    """What is beside the marker; it needs frames with everything drawn, but a closed form can have a second source."""
    vary: tuple[Axis, ...] = ()
    version: int = _VERSION
    """Version of the form of a study."""

    def __post_init__(self) -> None:
        if self.version != _VERSION:
            raise ConfigError(f"study: version is {self.version}, this package reads version {_VERSION}")
        if not self.policies:
            raise ConfigError("study: there are no policies; name at least one method")
        _require_size(self)
        if len(set(self.policies)) < len(self.policies):
            raise ConfigError("study: a policy is named twice; its rows would be the same")
        # TOML has integers of 64 bits with a sign.
        if not 0 <= self.seed < 2**63:
            raise ConfigError(f"study: seed is {self.seed}, it must be a whole number from 0 to 2**63 - 1")
        keys = [axis.key for axis in self.vary]
        if len(set(keys)) < len(keys):
            raise ConfigError(f"vary: a key is named twice in {', '.join(keys)}")
        if any(later <= earlier for earlier, later in itertools.pairwise((0, *self.marks))):
            raise ConfigError(f"study: marks are {list(self.marks)}, they must be positive and rise")
        if self.level == "curves" and self.drawn != "marker":
            raise ConfigError(f'study: level "curves" cannot have drawn = "{self.drawn}"; set level = "frames"')
        if self.level == "frames" and any(key.startswith("curve.") for key in keys):
            raise ConfigError("study: curve settings have no effect at the level frames; leave them out of vary")
        # Made here: a combination that cannot be is refused when the study is read, not hours later.
        cells(self)

    @property
    def rows(self) -> int:
        """Number of rows of its table."""
        return len(cells(self)) * self.trials * len(self.policies)

    @property
    def sweeps(self) -> bool:
        """Whether one of its policies sweeps."""
        return any(policy.plan.sweep for policy in self.policies)

    @property
    def digest(self) -> str:
        """Hash of the study and of the package's version, 16 hexadecimal digits: equal for equal tables."""
        return _digest(self)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One combination of the varied settings."""

    index: int
    """Its number in the study, from 0."""
    varied: tuple[tuple[str, Value], ...]
    """Values of the varied settings, by their keys, in the order of the study."""
    world: CellWorld
    digest: int
    """Hash of the settings, part of the seed of the trials."""


@lru_cache(maxsize=32)
def _digest(study: Study) -> str:
    # With the version: another one may compute other rows.
    values = msgspec.to_builtins(study) | {"rig": hashable_values(study.rig), "scene": _scene_values(study.scene)}
    return _hashed([values, __version__]).hexdigest()[:16]


@lru_cache(maxsize=32)
def cells(study: Study) -> tuple[Cell, ...]:
    """Return the cells of a study: every combination of its varied settings, the last key changing fastest."""
    made = []
    for index, values in enumerate(itertools.product(*(axis.values for axis in study.vary))):
        world = CellWorld(curve=study.curve, rig=study.rig, scene=study.scene)
        varied = tuple(zip((axis.key for axis in study.vary), values, strict=True))
        for key, value in varied:
            world = _changed(world, key, value, prefix="vary: ")
        if world.rig.noise.bursts is not None and study.level != "frames":
            raise ConfigError('rig.noise.bursts: bursts are simulated in frames only; set level = "frames"')
        _require_scene(study, world)
        if world.rig.second.present and (study.level != "frames" or study.drawn != "marker"):
            raise ConfigError('rig.second.present: a second marker needs level = "frames" and a rig that is not drawn')
        if study.drawn != "marker":
            _require_default(world.rig)
        # Of the settings without the version and the index: a cell keeps its markers when others are added.
        digest = int.from_bytes(_hashed(_hashable(world)).digest()[:8], "big")
        made.append(Cell(index=index, varied=varied, world=world, digest=digest))
    return tuple(made)


def _hashable(world: CellWorld) -> dict[str, typing.Any]:
    """Return the settings of a world for the seed of its trials: without an empty scene, and without stated noise."""
    settings: dict[str, typing.Any] = msgspec.to_builtins(world) | {
        "rig": hashable_values(world.rig),
        "scene": _scene_values(world.scene),
    }
    if world.scene == SceneSettings():
        del settings["scene"]
    if world.curve.noise_stated:
        del settings["curve"]["noise_stated"]
    return settings


def _scene_values(scene: SceneSettings) -> dict[str, typing.Any]:
    """Return the settings of a scene for a hash, as of `hashable_values`: still tissue is newer than the hashes."""
    values: dict[str, typing.Any] = msgspec.to_builtins(scene)
    if scene.breathing is None:
        del values["breathing"]
    return values


def _require_scene(study: Study, world: CellWorld) -> None:
    """Refuse a scene that the level of the study does not draw."""
    if world.scene == SceneSettings():
        return
    if not world.rig.marker.present:
        raise ConfigError("scene: there is nothing beside a marker that is not present; leave the scene out")
    if study.drawn != "marker":
        return
    if (
        study.level == "curves"
        and world.curve.family != "acoustic"
        and world.scene == SceneSettings(second=world.scene.second)
    ):
        return
    raise ConfigError(
        'scene: a second source, clutter, repeats and breathing need level = "frames" with drawn = "everything"; the '
        "curves of a closed form can have a second source too"
    )


def _require_size(study: Study) -> None:
    """Refuse a study that could never be finished, before its cells are made."""
    if len(study.policies) > MAX_POLICIES:
        raise ConfigError(f"study: there are {len(study.policies)} policies, at most {MAX_POLICIES} are compared")
    if not 1 <= study.trials <= _MAX_ROWS:
        raise ConfigError(f"study: trials is {study.trials}, it must lie between 1 and {_MAX_ROWS:,}")
    # Counted, not made: a billion combinations would fill the memory first.
    combinations = math.prod(len(axis.values) for axis in study.vary)
    if combinations > _MAX_CELLS:
        raise ConfigError(
            f"vary: the values make {combinations} combinations, at most {_MAX_CELLS} are computed; vary fewer "
            "settings, or split the study"
        )
    rows = combinations * study.trials * len(study.policies)
    if rows > _MAX_ROWS:
        raise ConfigError(f"study: its table has {rows:,} rows, at most {_MAX_ROWS:,} are computed; take fewer trials")


def _require_default(rig: SimulatedSettings) -> None:
    """Refuse settings that would have no effect because they are drawn."""
    drawn = (
        "probe",
        "laser.pulse_s",
        "laser.pulses",
        "marker.radius_m",
        "marker.source_radius_m",
        "receiver.trigger_offset_s",
    )
    for key in drawn:
        setting = attrgetter(key)
        if setting(rig) != setting(SimulatedSettings()):
            raise ConfigError(f'rig.{key} is drawn in each trial because drawn = "everything"; leave it out')


T = typing.TypeVar("T", bound=msgspec.Struct)


def _changed(settings: T, key: str, value: Value, *, prefix: str) -> T:
    """Return the settings with one of them set; the value is checked against its type.

    ``prefix``: what stands before the key in messages.
    """
    name, _, rest = key.partition(".")
    require_key(name, type(settings), prefix=prefix)
    part = getattr(settings, name)
    if not rest:
        part = setting_from(value, typing.get_type_hints(type(settings))[name], name=prefix + name)
    elif isinstance(part, msgspec.Struct):
        part = _changed(part, rest, value, prefix=f"{prefix}{name}.")
    else:
        raise ConfigError(f"{prefix}{key}: {name} has no settings of its own")
    return structs.replace(settings, **{name: part})


def _hashed(value: object) -> hashlib._Hash:
    # Keys sorted: the order of fields in a class must not change the hash, and with it the markers.
    return hashlib.sha256(msgspec.json.encode(value, order="deterministic"))


def read_study(path: Path) -> Study:
    """Return the study of a TOML file.

    Its keys are the fields of `Study`. ``[vary]`` has lists under dotted keys; a list as ``acquisitions`` of a policy
    makes one policy of each number; the word ``"none"`` is the value None.
    """
    table = read_toml(path, what="study file")
    if "kind" in table and "policies" not in table:
        raise ConfigError(
            f"{path}: it has a kind and no policies, so that it is a rig file; search on it: `find_marker()`"
        )
    try:
        policies = [expanded for entry in _tables(table.pop("policies", [])) for expanded in _policies(entry)]
        vary = [{"key": key, "values": values} for key, values in _flat(table.pop("vary", {}))]
        return settings_from({"name": path.stem, **table, "policies": policies, "vary": vary}, Study)
    except ConfigError as problem:
        raise ConfigError(f"{path}: {problem}") from problem


def _tables(entries: object) -> list[dict[str, object]]:
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise ConfigError("policies must be tables, each headed [[policies]]")
    return entries


def _policies(entry: dict[str, object]) -> list[StudyPolicy]:
    """Return one policy for each number of acquisitions."""
    numbers = entry.get("acquisitions", "none")
    if numbers == []:
        raise ConfigError(f"policies: acquisitions of {entry.get('method')} is an empty list; give at least one")
    return [
        study_policy(**{**entry, "acquisitions": number})
        for number in (numbers if isinstance(numbers, list) else [numbers])
    ]


def _flat(table: object, prefix: str = "") -> list[tuple[str, list[object]]]:
    """Return the dotted keys of nested tables, with their lists."""
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
