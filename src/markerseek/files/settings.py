"""Reads TOML settings into dataclasses whose fields have the same names; used for rig files and studies.

An unknown key is an error that names the nearest known one: a misspelt limit must not fall back to its default.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import tomllib
import types
import typing
from pathlib import Path

import msgspec

from markerseek.core import ConfigError, RecordError
from markerseek.files.inputs import MIB, read_input

_MAX_BYTES = MIB // 4
"""Largest settings file; the longest of the examples has 5 KB."""

_MAX_COLUMNS = 4096
"""Longest line of a settings file: Python's parser takes time with the square of the dots in a key."""

_MAX_DEPTH = 16
"""Deepest nesting of lists and tables; settings need 4."""


def read_toml(path: Path, *, what: str) -> dict[str, object]:
    """Table of a TOML file.

    ``what``: kind of file, for the message: "rig file".
    """
    try:
        text = read_input(path, most_bytes=_MAX_BYTES).decode("utf-8").replace("\r\n", "\n")
        _require_short_lines(text)
        table = tomllib.loads(text)
        _require_plain(table)
    except RecordError as problem:
        raise ConfigError(str(problem)) from problem
    except OSError as problem:
        raise ConfigError(
            f"{path}: the {what} cannot be read: {problem.strerror or problem}; check the name"
        ) from problem
    except RecursionError as problem:
        raise ConfigError(f"{path}: the {what} nests lists or tables too deeply to be read") from problem
    except UnicodeDecodeError as problem:
        raise ConfigError(
            f"{path}: the {what} is not text in UTF-8 (byte {problem.start + 1}); save it as TOML in UTF-8"
        ) from problem
    except tomllib.TOMLDecodeError as problem:
        raise ConfigError(f"{path}: the {what} is not valid TOML: {problem}") from problem
    # From the checks below, and from Python's int() for a number with too many digits.
    except ValueError as problem:
        raise ConfigError(f"{path}: the {what} cannot be read: {problem}") from problem
    return table


def _require_short_lines(text: str) -> None:
    longest = max(map(len, text.split("\n")))
    if longest > _MAX_COLUMNS:
        raise ValueError(f"a line has {longest} characters, at most {_MAX_COLUMNS} are read; break it into several")


def _require_plain(value: object, *, depth: int = 0) -> None:
    """Refuse deep nesting and huge integers, on which later checks and messages would fail."""
    if depth > _MAX_DEPTH:
        raise ValueError(f"lists or tables are nested more than {_MAX_DEPTH} deep")
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            _require_plain(part, depth=depth + 1)
    elif isinstance(value, int) and not -(2**63) <= value < 2**63:
        raise ValueError("a whole number has more than 64 bits")


def known_keys(table: dict[str, object], settings: type, *, prefix: str = "") -> dict[str, object]:
    """The table with ``"none"`` replaced by None; every key must be a field of the settings.

    ``settings``: dataclass whose fields are the keys allowed; fields that are dataclasses themselves are checked
    likewise. ``prefix``: dotted path of the table, for the message, with the final dot.
    """
    hints = typing.get_type_hints(settings)
    known: dict[str, object] = {}
    for key, value in table.items():
        part = _dataclass_in(hints[require_key(key, settings, prefix=prefix)], value, name=prefix + key)
        if isinstance(value, dict) and part is not None:
            known[key] = known_keys(value, part, prefix=f"{prefix}{key}.")
        else:
            known[key] = None if value == "none" else value
            require_choice(known[key], hints[key], name=prefix + key)
    return known


_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
    "null": '"none"',
    "datetime": "a date",
    "date": "a date",
    "time": "a time of day",
}
"""Types as msgspec names them, and as people do."""

_PLACE = re.compile(r" - at `(?:key in )?\$\.?(.*)`$", re.DOTALL)
_WRONG_TYPE = re.compile(r"Expected `([^`]*)`, got `([^`]*)`$")
_MISSING = re.compile(r"Object missing required field `([^`]*)`$")


def in_words(problem: msgspec.ValidationError, *, name: str = "") -> str:
    """Message of a setting that does not fit, in words instead of msgspec's.

    ``name``: name of what was converted; empty where that is the whole file.
    """
    text = str(problem)
    place = _PLACE.search(text)
    if place is not None:
        text = text[: place.start()]
        name = f"{name}.{place[1]}" if name and place[1] else name or place[1]
    if wrong := _WRONG_TYPE.match(text):
        wanted, got = (" or ".join(_TYPES.get(each, each) for each in names.split(" | ")) for names in wrong.groups())
        return f"{name or 'the file'} is {got}, it must be {wanted}"
    if missing := _MISSING.match(text):
        return f"the key {name + '.' if name else ''}{missing[1]} is missing; add it"
    # The settings' own checks name the key.
    return text


def require_choice(value: object, hint: object, *, name: str) -> None:
    """Refuse a value that a ``Literal`` does not list; other types are not checked."""
    if typing.get_origin(hint) is typing.Literal and value not in typing.get_args(hint):
        raise ConfigError(f"{name} is {value!r}, it must be one of: {', '.join(map(str, typing.get_args(hint)))}")


def require_key(key: str, settings: type, *, prefix: str = "") -> str:
    """The key, if the settings have a field of that name."""
    names = [field.name for field in dataclasses.fields(settings)]
    if key in names:
        return key
    near = difflib.get_close_matches(key, names, n=1)
    hint = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(names)}"
    raise ConfigError(f"the key {prefix}{key} is unknown; {hint}")


def convert_settings(table: object, settings: type[_Settings]) -> _Settings:
    """Settings from a table of plain values.

    ``table``: from `known_keys`, or from JSON. ``settings``: dataclass of them; of a field with several dataclasses,
    the ``driver`` of its table names the one. Raises `msgspec.ValidationError` if a value does not fit, or a key is
    missing.
    """
    if not isinstance(table, dict):
        raise msgspec.ValidationError(f"Expected `object`, got `{type(table).__name__}`")
    hints = typing.get_type_hints(settings)
    parts: list[typing.Any] = []
    for field in dataclasses.fields(settings):  # type: ignore[arg-type]
        chosen = _dataclass_in(hints[field.name], table.get(field.name), name=field.name) or hints[field.name]
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        parts.append((field.name, chosen) if required else (field.name, chosen | msgspec.UnsetType, msgspec.UNSET))
    # msgspec knows no union of dataclasses: it converts to a struct in which the choices are made.
    held = msgspec.convert(table, msgspec.defstruct(settings.__name__, parts, kw_only=True))
    given = {name: getattr(held, name) for name in held.__struct_fields__}
    return settings(**{name: value for name, value in given.items() if value is not msgspec.UNSET})


_Settings = typing.TypeVar("_Settings")


def _dataclass_in(hint: object, value: object, *, name: str) -> type | None:
    """The dataclass that a type hint allows, if any; of several, the first that has the driver of this table."""
    choices = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    kinds = [kind for kind in choices if isinstance(kind, type) and dataclasses.is_dataclass(kind)]
    if len(kinds) < 2 or not isinstance(value, dict) or "driver" not in value:
        return kinds[0] if kinds else None
    drivers = {name: kind for kind in kinds for name in typing.get_args(typing.get_type_hints(kind)["driver"])}
    if value["driver"] not in drivers:
        raise ConfigError(f"{name}.driver is {value['driver']!r}, it must be one of: {', '.join(drivers)}")
    return drivers[value["driver"]]
