"""Reads a rig file (TOML): the settings of a simulated rig, by the names that they have in Python.

A key that no setting has is refused, with the nearest one that exists: a misspelt limit must not become a default.
"""

from __future__ import annotations

import dataclasses
import difflib
import tomllib
import types
import typing
from pathlib import Path

import msgspec

from markerseek.core import ConfigError
from markerseek.sim.settings import SimulatedSettings

KINDS = ("simulated",)
"""Kinds of rig that a file can describe."""


def read_rig_file(path: Path) -> SimulatedSettings:
    """Settings of the rig in a file.

    Parameters
    ----------
    path
        TOML file. ``kind`` names the kind of rig; the other keys are those of `SimulatedSettings`. The word ``"none"``
        stands for a value that is left out on purpose, such as a lens.

    Raises
    ------
    ConfigError
        If the file cannot be read, a key is unknown, or a value does not fit; the message names file, key and cure.
    """
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as problem:
        raise ConfigError(f"{path}: the rig file cannot be read: {problem.strerror}") from problem
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise ConfigError(f"{path}: the rig file is not valid TOML: {problem}") from problem
    kind = table.pop("kind", None)
    if kind not in KINDS:
        raise ConfigError(f"{path}: kind is {kind!r}, it must be one of: {', '.join(KINDS)}")
    try:
        settings = _known_keys(table, SimulatedSettings, prefix="")
        return msgspec.convert(settings, SimulatedSettings)
    except (ConfigError, msgspec.ValidationError) as problem:
        raise ConfigError(f"{path}: {problem}") from problem


def _known_keys(table: dict[str, object], settings: type, *, prefix: str) -> dict[str, object]:
    """The table with ``"none"`` made None, once each of its keys is known to be a field of the settings."""
    hints = typing.get_type_hints(settings)
    names = [field.name for field in dataclasses.fields(settings)]
    known: dict[str, object] = {}
    for key, value in table.items():
        if key not in names:
            near = difflib.get_close_matches(key, names, n=1)
            hint = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(names)}"
            raise ConfigError(f"the key {prefix}{key} is unknown; {hint}")
        part = _dataclass_in(hints[key])
        if isinstance(value, dict) and part is not None:
            known[key] = _known_keys(value, part, prefix=f"{prefix}{key}.")
        else:
            known[key] = None if value == "none" else value
    return known


def _dataclass_in(hint: object) -> type | None:
    """The dataclass that a type hint allows, if any."""
    choices = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    return next((kind for kind in choices if isinstance(kind, type) and dataclasses.is_dataclass(kind)), None)
