"""Compares the bench of a journal with the rig file that is named to resume it.

A journal is a file like any other and may come from anywhere: it does not choose ports, limits, budgets or programs.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from markerseek.core import ConfigError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import Configuration
from markerseek.rigs import fingerprint

SAME = (
    "stage.driver",
    "stage.zero_deg",
    "stage.direction",
    "stage.approach_from",
    "laser.pulses",
    "receiver.driver",
    "receiver.sampling_hz",
    "probe.",
    "limits.search.",
)
"""Keys on which angles and intensities depend: acquisitions before and after a change could not be compared."""


def differences_of_benches(recorded: BenchSettings, named: BenchSettings) -> dict[str, str]:
    """Keys whose values differ, each with both values in words.

    Parameters
    ----------
    recorded
        Settings in the journal.
    named
        Settings in the rig file that a person named.
    """
    was, now = _by_key(msgspec.to_builtins(recorded)), _by_key(msgspec.to_builtins(named))
    keys = sorted(was.keys() | now.keys())
    return {key: f"{key} is {now.get(key)}, was {was.get(key)}" for key in keys if was.get(key) != now.get(key)}


def require_same_measurement(configuration: Configuration, recorded: BenchSettings, named: BenchSettings) -> list[str]:
    """Refuse a rig file whose acquisitions cannot be compared with those of the journal; name all other differences.

    Parameters
    ----------
    configuration
        The journal's configuration.
    recorded
        Settings in the journal.
    named
        Settings in the rig file that a person named.

    Returns
    -------
    list of str
        Differences that do not change what is measured, such as ports, limits of travel and budgets, in words.

    Raises
    ------
    ConfigError
        If a key of `SAME` differs, or the journal searches another range than the rig file.
    """
    found = differences_of_benches(recorded, named)
    refused = [said for key, said in found.items() if key.startswith(SAME)]
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
    """Values by dotted key, as a rig file names them."""
    flat: dict[str, object] = {}
    for name, value in table.items():
        flat |= _by_key(value, f"{prefix}{name}.") if isinstance(value, dict) else {prefix + name: value}
    return flat
