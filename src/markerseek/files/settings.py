"""Reads settings, as TOML has them, into dataclasses and structs whose fields have the same names.

An unknown key is an error that names the nearest known one: a misspelt limit must not fall back to its default.
"""

from __future__ import annotations

import dataclasses
import datetime as dt
import difflib
import tomllib
import types
import typing
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import msgspec

from markerseek.core import ConfigError, RecordError
from markerseek.files.inputs import MIB
from markerseek.files.text import read_text

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
        text = read_text(path, most_bytes=_MAX_BYTES, what=f"a {what}", cure="name one in TOML, in UTF-8")
        text = text.replace("\r\n", "\n")
        _require_short_lines(text)
        table = tomllib.loads(text)
        _require_plain(table)
    except RecordError as problem:
        raise ConfigError(str(problem)) from problem
    except RecursionError as problem:
        raise ConfigError(f"{path}: the {what} nests lists or tables too deeply to be read") from problem
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


SettingsT = typing.TypeVar("SettingsT")

Choose: typing.TypeAlias = Callable[[str, Mapping[str, object]], type | None]
"""Chooses the settings of a table by its name and keys; None leaves them to the type of the field."""


def settings_from(
    table: object, kind: type[SettingsT], *, name: str = "", choose: Choose = lambda _name, _table: None
) -> SettingsT:
    """Settings from a table of plain values, of TOML or JSON; the text ``"none"`` is the value None.

    ``kind``: dataclass or struct whose fields are the keys. ``name``: dotted path of the table, for messages; empty for
    a whole file. ``choose``: names the type of a nested table whose field allows several. Raises `ConfigError` if a key
    is unknown or missing, or a value does not fit.
    """
    if not isinstance(table, Mapping):
        raise ConfigError(f"{name or 'the file'} is {_kind_of(table)}, it must be a table")
    hints, required = typing.get_type_hints(kind), _fields(kind) or {}
    prefix = f"{name}." if name else ""
    values: dict[str, object] = {}
    for key, value in table.items():
        require_key(key, kind, prefix=prefix)
        chosen = choose(prefix + key, value) if isinstance(value, Mapping) else None
        values[key] = setting_from(value, chosen or hints[key], name=prefix + key, choose=choose)
    for key, needed in required.items():
        if needed and key not in values:
            raise ConfigError(f"the key {prefix}{key} is missing; add it")
    return kind(**values)


def setting_from(
    value: object, hint: typing.Any, *, name: str, choose: Choose = lambda _name, _table: None
) -> typing.Any:
    """The value of one setting as its type wants it; `ConfigError` if it does not fit.

    ``hint``: type of the setting. ``name``: dotted path of the key, for messages.
    """
    value = None if value == "none" else value
    if typing.get_origin(hint) is typing.Literal:
        if value not in typing.get_args(hint):
            raise ConfigError(f"{name} is {value!r}, it must be one of: {', '.join(map(str, typing.get_args(hint)))}")
        return value
    if _is_union(hint):
        return _one_of(value, typing.get_args(hint), name=name, choose=choose)
    if _fields(hint) is not None:
        return value if isinstance(value, hint) else settings_from(value, hint, name=name, choose=choose)
    if isinstance(value, list) and typing.get_origin(hint) is tuple:
        return _each(value, typing.get_args(hint), name=name, choose=choose)
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as problem:
        raise ConfigError(f"{name} is {_kind_of(value)}, it must be {_in_words(hint)}") from problem


def _one_of(value: object, hints: tuple[typing.Any, ...], *, name: str, choose: Choose) -> object:
    """The value as one of several types: a table as settings, a list as a tuple, and None only where it is allowed."""
    if value is None and types.NoneType in hints:
        return None
    fitting = [hint for hint in hints if _holds(hint, value)]
    if not fitting:
        raise ConfigError(f"{name} is {_kind_of(value)}, it must be {' or '.join(map(_in_words, hints))}")
    # A whole number fits a float too, and would become one: the type that the value has comes first.
    chosen = next((hint for hint in fitting if hint is type(value)), fitting[0])
    return setting_from(value, chosen, name=name, choose=choose)


def _holds(hint: typing.Any, value: object) -> bool:
    if isinstance(value, Mapping):
        return _fields(hint) is not None or typing.get_origin(hint) is dict
    if isinstance(value, list):
        return typing.get_origin(hint) in (tuple, list)
    if typing.get_origin(hint) is typing.Literal:
        return value in typing.get_args(hint)
    try:
        msgspec.convert(value, hint)
    except (msgspec.ValidationError, TypeError):
        return False
    return True


def _each(value: list[object], hints: tuple[typing.Any, ...], *, name: str, choose: Choose) -> tuple[object, ...]:
    """A list as a tuple of the same type each, or of as many as there are types."""
    if hints[-1] is Ellipsis:
        hints = hints[:1] * len(value)
    if len(value) != len(hints):
        raise ConfigError(f"{name} has {len(value)} values, it must have {len(hints)}")
    pairs = zip(value, hints, strict=True)
    return tuple(
        setting_from(each, hint, name=f"{name}[{index}]", choose=choose) for index, (each, hint) in enumerate(pairs)
    )


def _is_union(hint: typing.Any) -> bool:
    return typing.get_origin(hint) in (types.UnionType, typing.Union)


def _fields(kind: typing.Any) -> dict[str, bool] | None:
    """Fields of settings by name, and whether they are required; None of a type that has none."""
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return {
            each.name: each.default is dataclasses.MISSING and each.default_factory is dataclasses.MISSING
            for each in dataclasses.fields(kind)
        }
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return {each.name: each.required for each in msgspec.structs.fields(kind)}
    return None


_KINDS: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    str: "text",
    list: "a list",
    tuple: "a list",
    dict: "a table",
    types.NoneType: '"none"',
    dt.datetime: "a date",
    dt.date: "a date",
    dt.time: "a time of day",
}
"""Types of TOML in words."""


def _kind_of(value: object) -> str:
    return _KINDS.get(type(value), type(value).__name__)


def _in_words(hint: typing.Any) -> str:
    """What a type allows, in words."""
    if _is_union(hint):
        return " or ".join(map(_in_words, typing.get_args(hint)))
    if typing.get_origin(hint) is typing.Literal:
        return "one of " + ", ".join(map(repr, typing.get_args(hint)))
    return "a table" if _fields(hint) is not None else _KINDS.get(typing.get_origin(hint) or hint, "something else")


def require_key(key: str, kind: type, *, prefix: str = "") -> str:
    """The key, if the settings have a field of that name."""
    return nearest_key(key, _fields(kind) or (), prefix=prefix)


def nearest_key(key: str, names: Collection[str], *, prefix: str = "") -> str:
    """The key, if it is one of the names; else a `ConfigError` that names the nearest.

    ``prefix``: dotted path of its table, for the message, with the final dot.
    """
    if key in names:
        return key
    near = difflib.get_close_matches(key, names, n=1)
    hint = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(names)}"
    raise ConfigError(f"the key {prefix}{key} is unknown; {hint}")
