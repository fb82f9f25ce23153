"""Compares the bench settings of a journal with the rig file given to resume it.

A journal may come from an untrusted source: ports, limits, budgets and programs are never taken from it.
"""

from __future__ import annotations

from collections.abc import Mapping

from markerseek.core import ConfigError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import Configuration
from markerseek.rigs import fingerprint


def differences_of_benches(recorded: BenchSettings, named: BenchSettings) -> dict[str, str]:
    """Settings in the user's rig file that differ from those in the journal: a description by dotted key."""
    was, now = _by_key(recorded.table()), _by_key(named.table())
    keys = sorted(was.keys() | now.keys())
    return {key: f"{key} is {now.get(key)}, was {was.get(key)}" for key in keys if was.get(key) != now.get(key)}


def require_same_measurement(configuration: Configuration, recorded: BenchSettings, named: BenchSettings) -> list[str]:
    """Refuse a rig file whose acquisitions are not comparable with the journal's; return all other differences.

    ``named``: settings in the user's rig file. Returns differences that do not change what is measured, such as ports,
    travel limits and budgets.
    """
    found = differences_of_benches(recorded, named)
    # A port may change from day to day: it says where a device is plugged in, and not what it measures.
    refused = [text for key, text in found.items() if key.startswith(named.comparable) and not key.endswith(".port")]
    # The journal states the range twice, in the recipe and in the facts; both must be that of the file.
    if not refused and configuration.facts.search != named.limits.search:
        refused = [f"limits.search is {named.limits.search}, the journal searches {configuration.facts.search}"]
    if refused:
        was = configuration.facts.fingerprint
        raise ConfigError(
            f"the rig file does not describe the rig of the journal: {'; '.join(refused)} (fingerprint "
            f"{fingerprint(named)}, was {was}); name the rig file that the search was begun with, "
            "or begin a new search"
        )
    return list(found.values())


def _by_key(table: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    """Nested settings as a flat table with dotted keys."""
    flat: dict[str, object] = {}
    for name, value in table.items():
        flat |= _by_key(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat
