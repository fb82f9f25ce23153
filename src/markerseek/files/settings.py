"""Reads settings, as TOML has them, into structs whose fields have the same names.

An unknown key is an error that names the nearest known one: a misspelt limit must not fall back to its default.
"""

from __future__ import annotations

import datetime as dt
import difflib
import re
import tomllib
import types
import typing
from collections.abc import Collection, Mapping, Sequence
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
    """Return the table of a TOML file.

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


def settings_from(table: object, kind: type[SettingsT], *, name: str = "") -> SettingsT:
    """Return the settings of a table of plain values, of TOML or JSON; the text ``"none"`` is the value None.

    ``kind``: class whose fields are the keys. ``name``: dotted path of the table, for messages; empty for a whole file.
    Raises `ConfigError` if a key is unknown or missing, or a value does not fit.
    """
    settings: SettingsT = setting_from(table, kind, name=name)
    return settings


def setting_from(value: object, hint: typing.Any, *, name: str) -> typing.Any:
    """Return the value of one setting as its type wants it; `ConfigError` if it does not fit.

    ``hint``: type of the setting. ``name``: dotted path of the key, for messages. Raises `TypeError` for a type that
    msgspec does not know.
    """
    value = _with_none(value)
    try:
        return msgspec.convert(value, hint)
    except msgspec.ValidationError as problem:
        refused = problem.__cause__
        if isinstance(refused, ConfigError):
            # By the settings themselves, which check their values when they are made.
            raise refused from refused.__cause__
        _, _, place = str(problem).rpartition(" - at `$")
        raise _refusal(value, hint, re.findall(r"\w+", place), name=name) from problem


def recorded_settings(text: bytes, hint: typing.Any) -> typing.Any:
    """Return settings as a record holds them, JSON; keys that only another version of markerseek knows are left out.

    Raises `msgspec.MsgspecError` if they do not fit.
    """
    values = msgspec.json.decode(text)
    while True:
        try:
            return msgspec.convert(values, hint)
        except msgspec.ValidationError as problem:
            unknown = _UNKNOWN_KEY.fullmatch(str(problem))
            part = _part_at(values, re.findall(r"\w+", unknown["place"] or "")) if unknown else None
            if unknown is None or not isinstance(part, dict) or unknown["key"] not in part:
                raise
            del part[unknown["key"]]


_UNKNOWN_KEY = re.compile(r"Object contains unknown field `(?P<key>.*?)`(?: - at `\$(?P<place>.*)`)?", re.DOTALL)
"""What msgspec says of a key that a struct does not have."""


def _part_at(value: typing.Any, place: Sequence[str]) -> object:
    """Return what stands at a place, named by keys and indices; None if there is none."""
    for step in place:
        if isinstance(value, list) and step.isdecimal() and int(step) < len(value):
            value = value[int(step)]
        elif isinstance(value, dict):
            value = value.get(step)
        else:
            return None
    return value


def _with_none(value: object) -> object:
    """Return the value with None in place of every text "none"."""
    if isinstance(value, Mapping):
        return {key: _with_none(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_with_none(each) for each in value]
    return None if value == "none" else value


def _refusal(value: object, hint: typing.Any, place: Sequence[str], *, name: str) -> ConfigError:
    """Return the error of a value that msgspec refuses; an unknown key on the way there comes first.

    ``place``: keys and indices that lead from the value to the one that does not fit.
    """
    step = place[0] if place else ""
    deeper = place[1:]
    members = typing.get_args(hint) if _is_union(hint) else (hint,)
    kind = next((each for each in members if _keys_of(each) is not None), None)
    if kind is not None and isinstance(value, Mapping):
        prefix = f"{name}." if name else ""
        for key in value:
            require_key(key, kind, prefix=prefix)
        if step in value:
            return _refusal(value[step], _hints_of(kind)[step], deeper, name=prefix + step)
        for each in msgspec.structs.fields(kind):
            if each.required and each.name not in value:
                return ConfigError(f"the key {prefix}{each.name} is missing; add it")
    row = next((each for each in members if typing.get_origin(each) in (tuple, list)), None)
    if row is not None and isinstance(value, list):
        hints = _row_hints(row, len(value))
        if len(value) != len(hints):
            return ConfigError(f"{name} has {len(value)} values, it must have {len(hints)}")
        if step.isdecimal() and int(step) < len(value):
            return _refusal(value[int(step)], hints[int(step)], deeper, name=f"{name}[{step}]")
    literal = any(typing.get_origin(each) is typing.Literal for each in members)
    found = repr(value) if literal and isinstance(value, str) else _kind_of(value)
    return ConfigError(f"{name or 'the file'} is {found}, it must be {_in_words(hint)}")


def _row_hints(row: typing.Any, count: int) -> tuple[typing.Any, ...]:
    """Return the types of a list's values; ``count`` of them where the type of the list leaves the number open."""
    hints = typing.get_args(row)
    return hints[:1] * count if typing.get_origin(row) is list or hints[-1] is Ellipsis else hints


def _is_union(hint: typing.Any) -> bool:
    return typing.get_origin(hint) in (types.UnionType, typing.Union)


def _keys_of(kind: typing.Any) -> tuple[str, ...] | None:
    """Return the keys of settings, None of a type that has none."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        config = kind.__struct_config__
        return kind.__struct_fields__ if config.tag is None else (str(config.tag_field), *kind.__struct_fields__)
    return None


def _hints_of(kind: typing.Any) -> dict[str, typing.Any]:
    """Return the type of each key of settings; the tag of a struct has one value."""
    hints = typing.get_type_hints(kind)
    if kind.__struct_config__.tag is not None:
        hints[str(kind.__struct_config__.tag_field)] = typing.Literal[kind.__struct_config__.tag]
    return hints


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
    """Return what a type allows, in words."""
    if _is_union(hint):
        return " or ".join(map(_in_words, typing.get_args(hint)))
    if typing.get_origin(hint) is typing.Literal:
        return f"one of: {', '.join(map(str, typing.get_args(hint)))}"
    return "a table" if _keys_of(hint) is not None else _KINDS.get(typing.get_origin(hint) or hint, "something else")


def require_key(key: str, kind: type, *, prefix: str = "") -> str:
    """Return the key, if the settings have a field of that name."""
    return nearest_key(key, _keys_of(kind) or (), prefix=prefix)


def nearest_key(key: str, names: Collection[str], *, prefix: str = "") -> str:
    """Return the key, if it is one of the names; else a `ConfigError` that names the nearest.

    ``prefix``: dotted path of its table, for the message, with the final dot.
    """
    if key in names:
        return key
    near = difflib.get_close_matches(key, names, n=1)
    known = f"known here: {', '.join(names)}" if names else "no further key is known here"
    hint = f"did you mean {prefix}{near[0]}?" if near else known
    raise ConfigError(f"the key {prefix}{key} is unknown; {hint}")
