"""Reads a rig file (TOML): the settings of a simulated rig, by the names that they have in Python."""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.core import ConfigError
from markerseek.settings_file import known_keys, read_toml
from markerseek.sim.settings import SimulatedSettings

KINDS = ("simulated",)
"""Kinds of rig that a file can describe."""


def read_rig_file(path: Path) -> SimulatedSettings:
    """Settings of the rig in a file.

    Parameters
    ----------
    path
        TOML file. ``kind`` names the kind of rig; the other keys are those of `SimulatedSettings`. The word ``"none"``
        stands for a value that is left out on purpose, such as a lens.

    Raises
    ------
    ConfigError
        If the file cannot be read, a key is unknown, or a value does not fit; the message names file, key and cure.
    """
    table = read_toml(path, what="rig file")
    kind = table.pop("kind", None)
    if kind not in KINDS:
        raise ConfigError(f"{path}: kind is {kind!r}, it must be one of: {', '.join(KINDS)}")
    try:
        return msgspec.convert(known_keys(table, SimulatedSettings), SimulatedSettings)
    except (ConfigError, msgspec.ValidationError) as problem:
        raise ConfigError(f"{path}: {problem}") from problem
