"""A probe of the user's own, from a TOML file, and what facts state of a probe."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from markerseek.core import ConfigError, listed
from markerseek.files import read_toml, settings_from
from markerseek.signals import PRESET_NAMES, ProbeKeys, ProbePreset, is_own, probe_preset

NEEDED = ("elements", "pitch_m", "sampling_hz", "low_hz", "high_hz", "sound_speed_m_s")
"""Keys of a probe file that starts from no preset."""


class _ProbeFile(ProbeKeys, frozen=True, kw_only=True):
    """Keys of a probe file: those of `ProbeKeys`, the preset to start from, and the sampling frequency."""

    preset: str | None = None
    sampling_hz: float | None = None


def read_probe_file(path: Path) -> ProbePreset:
    """Return the probe that a TOML file describes; it is named after the file.

    ``path``: its keys are those of `ProbeKeys`, ``sampling_hz`` and ``preset``. Without a ``preset`` the keys of
    `NEEDED` must be there.
    """
    table = read_toml(path, what="probe file")
    try:
        keys = settings_from(table, _ProbeFile)
        return keys.on(_start(keys), sampling_hz=keys.sampling_hz, name=path.name)
    except ConfigError as problem:
        raise ConfigError(f"{path}: {problem}") from problem


def _start(keys: _ProbeFile) -> ProbePreset:
    """Return the preset that a probe file starts from.

    Without one, every key that differs between probes must be given.
    """
    missing = [name for name in NEEDED if getattr(keys, name) is None]
    if keys.preset is None and missing:
        keys_text = f"the key {missing[0]} is missing; add it"
        if len(missing) > 1:
            keys_text = f"the keys {listed(missing)} are missing; add them"
        raise ConfigError(f'{keys_text}, or name the preset that the probe differs from: preset = "{PRESET_NAMES[0]}"')
    return probe_preset(keys.preset or PRESET_NAMES[0])


def chosen_probe(probe: str | ProbePreset) -> ProbePreset:
    """Return the preset by its name or from a TOML file; a preset comes back as it is."""
    if not isinstance(probe, str):
        return probe
    return read_probe_file(Path(probe)) if probe.lower().endswith(".toml") else probe_preset(probe)


def probe_facts(preset: ProbePreset) -> dict[str, Any]:
    """Return what `RigFacts` and `BankFacts` state of a probe; one of the user's own is described in full, as JSON."""
    return {
        "probe": preset.name,
        "probe_settings": msgspec.json.encode(preset).decode() if is_own(preset) else None,
        "sampling_hz": preset.sampling_hz,
        "sound_speed_m_s": preset.sound_speed_m_s,
        "pitch_m": preset.array.pitch_m,
    }
