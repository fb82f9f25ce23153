"""A study as a TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import msgspec

from markerseek.core import ConfigError
from markerseek.files import in_words, known_keys, read_toml
from markerseek.studies.policies import PolicySettings
from markerseek.studies.study import Study


def read_study(path: Path) -> Study:
    """Study of a TOML file.

    Its keys are the fields of `Study`. ``[vary]`` has lists under dotted keys; a list as ``acquisitions`` of a policy
    makes one policy of each number; the word ``"none"`` is the value None.
    """
    table = read_toml(path, what="study file")
    try:
        # The check of keys does not look into lists of tables: each policy is checked by itself.
        policies = [expanded for entry in _tables(table.pop("policies", [])) for expanded in _policies(entry)]
        vary = [{"key": key, "values": values} for key, values in _flat(table.pop("vary", {}))]
        settings = known_keys(table, Study)
        return msgspec.convert({"name": path.stem, **settings, "policies": policies, "vary": vary}, Study)
    except msgspec.ValidationError as problem:
        raise ConfigError(f"{path}: {in_words(problem)}") from problem
    except ConfigError as problem:
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
