"""Reads settings, as TOML has them, into dataclasses and structs whose fields have the same names.

An unknown key is an error that names the nearest known one: a misspelt limit must not fall back to its default.
"""

from __future__ import annotations

import contextlib
import dataclasses
import datetime as dt
import difflib
import re
import tomllib
import types
import typing
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import msgspec

from markerseek.core import ConfigError, RecordError
from markerseek.files.inputs import MIB, read_text

_MAX_BYTES = MIB // 4
"""Largest settings file; the longest of the examples has 5 KB."""

_MOST_PARTS = 32
"""Most parts of a dotted key; tomllib's time and memory grow with their square."""

# Possessive, so that no text takes longer than its length.
_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![\w-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_MOST_PARTS}}}")


def read_toml(path: Path, *, what: str) -> dict[str, object]:
    """Table of a TOML file.

    ``what``: kind of file, for the message: "rig file".
    """
    try:
        text = read_text(path, most_bytes=_MAX_BYTES, what=f"a {what}", cure="name one in TOML, in UTF-8")
    except RecordError as problem:
        raise ConfigError(str(problem)) from problem
    if _LONG_KEY.search(text):
        raise ConfigError(f"{path}: the {what} has a key of more than {_MOST_PARTS} parts, two or three are usual")
    try:
        return tomllib.loads(text.replace("\r\n", "\n"))
    except RecursionError as problem:
        raise ConfigError(f"{path}: the {what} nests lists or tables too deeply to be read") from problem
    except tomllib.TOMLDecodeError as problem:
        raise ConfigError(f"{path}: the {what} is not valid TOML: {problem}") from problem
    # Of Python's int(), for a number with too many digits.
    except ValueError as problem:
        raise ConfigError(f"{path}: the {what} cannot be read: {problem}") from problem


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
    members = typing.get_args(hint) if _is_union(hint) else (hint,)
    tables = tuple(each for each in members if _fields(each) is not None)
    if tables and isinstance(value, tables):
        return value
    if tables and isinstance(value, Mapping):
        return settings_from(value, tables[0], name=name, choose=choose)
    lists = [each for each in members if typing.get_origin(each) is tuple]
    if lists and isinstance(value, list):
        return _each(value, typing.get_args(lists[0]), name=name, choose=choose)
    for each in sorted(members, key=lambda kind: kind is not type(value)):
        # One by one, as a whole number fits a float too: the type that the value has comes first.
        with contextlib.suppress(msgspec.ValidationError, TypeError):
            return msgspec.convert(value, each)
    literal = any(typing.get_origin(each) is typing.Literal for each in members)
    found = repr(value) if literal and isinstance(value, str) else _kind_of(value)
    raise ConfigError(f"{name} is {found}, it must be {_in_words(hint)}")


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
        return f"one of: {', '.join(map(str, typing.get_args(hint)))}"
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
