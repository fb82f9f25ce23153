"""Reads a rig file (TOML) into the settings of a rig; keys have the names of the Python fields."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec

from markerseek.core import ConfigError
from markerseek.drivers import BenchReceiver, BenchSettings
from markerseek.files import convert_settings, in_words, known_keys, read_toml
from markerseek.sim import SimulatedSettings

_SETTINGS: dict[str, type[SimulatedSettings] | type[BenchSettings]] = {
    "simulated": SimulatedSettings,
    "bench": BenchSettings,
}

KINDS = tuple(_SETTINGS)
"""Kinds of rig that a file can describe."""


def read_rig_file(path: Path) -> SimulatedSettings | BenchSettings:
    """Settings of the rig in a file.

    ``path``: TOML file. ``kind`` names the kind of rig: ``simulated``, or ``bench`` for one of real devices. The other
    keys are those of `SimulatedSettings` or `BenchSettings`. The text ``"none"`` means None, such as no lens. A
    receiver's folder is relative to the rig file.
    """
    table = read_toml(path, what="rig file")
    if "kind" not in table:
        raise ConfigError(f'{path}: the key kind is missing; write kind = "simulated" or kind = "bench" at its top')
    # Removed here, because it selects the dataclass that knows the other keys.
    kind = table.pop("kind")
    if not isinstance(kind, str) or kind not in _SETTINGS:
        raise ConfigError(f"{path}: kind is {kind!r}, it must be one of: {', '.join(KINDS)}")
    wanted = _SETTINGS[kind]
    try:
        settings = convert_settings(known_keys(table, wanted), wanted)
    except msgspec.ValidationError as problem:
        raise ConfigError(f"{path}: {in_words(problem)}") from problem
    except ConfigError as problem:
        raise ConfigError(f"{path}: {problem}") from problem
    if isinstance(settings, BenchSettings) and isinstance(settings.receiver, BenchReceiver):
        # Relative to the file, so that the command works from any current folder.
        folder = path.parent / settings.receiver.folder
        return replace(settings, receiver=replace(settings.receiver, folder=str(folder)))
    return settings


def read_simulated(path: Path | None, *, cure: str) -> SimulatedSettings:
    """Settings of the simulated rig in a file; without one, the defaults.

    ``cure``: what helps where the file describes a rig of devices, for the message.
    """
    settings = SimulatedSettings() if path is None else read_rig_file(path)
    if not isinstance(settings, SimulatedSettings):
        raise ConfigError(f"{path}: its kind is bench; {cure}")
    return settings
