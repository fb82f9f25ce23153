"""Rig files (TOML): their keys have the names of the fields of a rig's settings."""

from __future__ import annotations

from pathlib import Path

from markerseek.core import ConfigError
from markerseek.drivers import BenchSettings, bench_settings_from
from markerseek.files import quoted, read_toml, settings_from
from markerseek.sim import SimulatedSettings

_KINDS = ("simulated", "bench")
"""Kinds of rig that a file can describe."""


def read_rig_file(path: Path) -> SimulatedSettings | BenchSettings:
    """Return the settings of the rig in a file.

    ``path``: TOML file. ``kind`` names the kind of rig: ``simulated``, or ``bench`` for one of real devices. The other
    keys are those of `SimulatedSettings` or `BenchSettings`. The text ``"none"`` means None, for example no lens. A
    receiver's folder is relative to the rig file, and the module of a foreign driver is looked for beside it and
    imported: a rig file can run code.
    """
    table = read_toml(path, what="rig file")
    if "policies" in table:
        raise ConfigError(f"{path}: it has policies, so it is a study file; run it: `run_study({quoted(path)})`")
    if "kind" not in table:
        raise ConfigError(f'{path}: the key kind is missing; write kind = "simulated" or kind = "bench" at its top')
    # Removed here, because it selects the settings that know the other keys.
    kind = table.pop("kind")
    if kind not in _KINDS:
        raise ConfigError(f"{path}: kind is {kind!r}, it must be one of: {', '.join(_KINDS)}")
    try:
        if kind == "simulated":
            return settings_from(table, SimulatedSettings)
        return bench_settings_from(table, beside=str(path.parent.absolute()))
    except ConfigError as problem:
        raise ConfigError(f"{path}: {problem}") from problem


def read_simulated(path: Path | None, *, cure: str) -> SimulatedSettings:
    """Return the settings of the simulated rig in a file; the defaults without a file.

    ``cure``: advice for the message if the file describes a rig of real devices.
    """
    settings = SimulatedSettings() if path is None else read_rig_file(path)
    if not isinstance(settings, SimulatedSettings):
        raise ConfigError(f"{path}: its kind is bench; {cure}")
    return settings
