"""Tables of the keys of rig and study files, made from the values that read them: unit, default, range, meaning."""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any, TypeAlias

import msgspec
from sphinx.errors import PycodeError
from sphinx.pycode import ModuleAnalyzer

from markerseek.core import ConfigError, SpotToSource, options_of
from markerseek.drivers import BenchProbe, BenchSettings, BenchSupervisor, BenchTissue
from markerseek.drivers.entry import PARTS, driver_names, entry_named
from markerseek.guard import FiringLimits, Limits
from markerseek.sim import SimulatedSettings
from markerseek.studies import Study, study_policy
from markerseek.studies.policies import OF_PLAN, OF_STUDY

UNITS = {
    "per_deg": "1/°",
    "deg_s2": "°/s²",
    "deg_per_s": "°/s",
    "deg_s": "°/s",
    "m_s": "m/s",
    "db_cm_mhz": "dB/(cm MHz)",
    "db": "dB",
    "deg": "°",
    "per_min": "1/min",
    "mm": "mm",
    "nm": "nm",
    "us": "µs",
    "hz": "Hz",
    "j": "J",
    "m": "m",
    "s": "s",
}
"""Units by the ending of a name, longer ones first."""

WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text"}


Make: TypeAlias = Callable[[Any], object]
"""Makes the whole settings with one of their tables replaced, which checks them together."""


def tables_of(
    settings: Any,
    *,
    name: str = "",
    whole: Make = lambda part: part,
    leave_out: Sequence[str] = (),
    only: Sequence[str] = (),
    by_default: bool = False,
) -> str:
    """A table in Markdown of the keys of settings, and those of their nested tables below it.

    ``settings``: with their defaults. ``leave_out``: tables that another page has. ``only``: the keys that are shown.
    ``by_default``: whether all of their values are defaults, also of keys that the table must have where it is given.
    """
    kind = type(settings)
    rows, nested = ["| key | value | default | unit | range | meaning |", "|---|---|---|---|---|---|"], []
    hints, meanings = typing.get_type_hints(kind), _meanings(kind)
    for key, needed in _fields(kind):
        if only and key not in only:
            continue
        path, value = f"{name}.{key}" if name else key, getattr(settings, key)
        allowed = [each for each in _members(hints[key]) if _is_settings(each)]
        given = _is_settings(type(value))
        if allowed and key not in leave_out:
            inside = value if given else _example(allowed[0])
            nested.append(tables_of(inside, name=path, whole=_within(settings, key, whole), by_default=given))
        default = "**required**" if needed and not by_default else "" if given else _shown(value)
        meaning = re.sub(r"\bNone\b", '`"none"`', meanings.get(key, ""))
        limits = _range(settings, key, hints[key], whole)
        cells = (f"`{key}`", _in_words(hints[key]), default, _unit(key), limits, meaning)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    heading = f"### `[{name}]`\n\n" if name else ""
    return "\n\n".join([heading + "\n".join(rows), *nested])


def _within(settings: Any, key: str, whole: Make) -> Make:
    return lambda part: whole(_replaced(settings, key, part))


def _replaced(settings: Any, key: str, value: object) -> Any:
    """The settings with another value of one key, checked as when they are made."""
    fields = {name: getattr(settings, name) for name, _ in _fields(type(settings))}
    return type(settings)(**{**fields, key: value})


def _example(kind: Any) -> Any:
    """Settings in which all that has no default is filled in."""
    hints = typing.get_type_hints(kind)
    return kind(**{key: "x" if hints[key] is str else 1.0 for key, needed in _fields(kind) if needed})


def _is_settings(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _members(hint: Any) -> list[Any]:
    """Types that a hint allows."""
    if typing.get_origin(hint) in (types.UnionType, typing.Union):
        return list(typing.get_args(hint))
    return [hint]


def _fields(kind: Any) -> list[tuple[str, bool]]:
    """Fields by name, and whether they have no default."""
    return [(each.name, each.required) for each in msgspec.structs.fields(kind)]


def _meanings(kind: type[msgspec.Struct]) -> dict[str, str]:
    """First sentence of what stands below each field, of its own class or of one that it inherits from.

    That of an option stands in its annotation.
    """
    found: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        with suppress(PycodeError):
            for (owner, key), lines in ModuleAnalyzer.for_module(each.__module__).find_attr_docs().items():
                if owner == each.__name__:
                    text = " ".join(lines).strip().replace("``", "`")
                    together = re.match(r"((?:`\w+`(?:, | and )?)+): ", text)
                    for name in re.findall(r"`(\w+)`", together[1]) if together else [key]:
                        found[name] = text
    return found | {each.name: each.help for each in options_of(kind)}


def _in_words(hint: Any) -> str:
    """What a type allows, in words."""
    words = []
    for each in _members(hint):
        if each is types.NoneType:
            words.append('`"none"`')
        elif typing.get_origin(each) is typing.Literal:
            words.append(", ".join(f'`"{value}"`' for value in typing.get_args(each)))
        elif typing.get_origin(each) in (tuple, list):
            words.append("list")
        else:
            words.append("table" if _is_settings(each) else WORDS.get(each, "table"))
    return " or ".join(dict.fromkeys(words))


def _shown(value: object) -> str:
    if value is None:
        return '`"none"`'
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, tuple):
        return f"`{list(value)}`" if len(value) < 8 else ""
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def _unit(key: str) -> str:
    return next((unit for ending, unit in UNITS.items() if key.endswith("_" + ending)), "")


def _range(settings: Any, key: str, hint: Any, whole: Make) -> str:
    """What the settings say of a number that is far too small or too large."""
    number = next((each for each in _members(hint) if each in (int, float)), None)
    if number is None:
        return ""
    said: list[str] = []
    for tried in (number(-(10**12)), number(10**12)):
        try:
            whole(_replaced(settings, key, tried))
        except ConfigError as problem:
            must = re.search(rf"\b{key} is [^,]*, it must (?:be |lie )?([^;]*)", str(problem))
            said += [must[1].strip()] if must and must[1].strip() not in said else []
    return "; ".join(said)


def simulated_rig() -> str:
    """Keys of a rig file of kind "simulated"."""
    return tables_of(SimulatedSettings())


def bench_rig() -> str:
    """Keys of a rig file of kind "bench": those of each driver, then those of the other tables."""
    parts = []
    for part in PARTS:
        for driver in driver_names(part):
            table = tables_of(_example(entry_named(part, driver).settings))
            parts.append(f'### `[{part}]` `driver = "{driver}"`\n\n{table}')
    trace = '| key | value | default | meaning |\n|---|---|---|---|\n| `trace` | text | `"none"` | ' + (
        _meanings(BenchSettings)["trace"] + " |"
    )
    parts.append(f"### Above the tables\n\n{trace}")
    tables = {
        "probe": BenchProbe(),
        "tissue": BenchTissue(),
        "spot": SpotToSource(),
        "limits": Limits(),
        "firing": FiringLimits(),
        "supervisor": BenchSupervisor(),
    }
    return "\n\n".join([*parts, *(tables_of(settings, name=name) for name, settings in tables.items())])


def study() -> str:
    """Keys of a study file."""
    policy = study_policy(method="posterior")
    whole = Study(name="study", policies=(policy,))
    own = "\n".join(tables_of(policy, only=OF_STUDY).splitlines()[2:])
    return f"{tables_of(whole, leave_out=('rig',))}\n\n{tables_of(policy.plan, name='[policies]', only=OF_PLAN)}\n{own}"
