"""A study as a TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from markerseek.core import ConfigError
from markerseek.files import read_toml, settings_from
from markerseek.studies.policies import PolicySettings
from markerseek.studies.study import Study


def read_study(path: Path) -> Study:
    """Study of a TOML file.

    Its keys are the fields of `Study`. ``[vary]`` has lists under dotted keys; a list as ``acquisitions`` of a policy
    makes one policy of each number; the word ``"none"`` is the value None.
    """
    table = read_toml(path, what="study file")
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


def _policies(entry: dict[str, object]) -> list[PolicySettings]:
    """One policy for each number of acquisitions."""
    numbers = entry.get("acquisitions", "none")
    return [
        settings_from({**entry, "acquisitions": number}, PolicySettings, name="policies")
        for number in (numbers if isinstance(numbers, list) else [numbers])
    ]


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
