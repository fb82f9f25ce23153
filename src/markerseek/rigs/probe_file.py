"""A probe of the user's own, from a TOML file: ``--probe FILE.toml``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
from msgspec import structs

from markerseek.core import ConfigError, RecordError, listed
from markerseek.files import read_toml, recorded_settings, settings_from
from markerseek.records.banks import DEFAULT_FORMAT, FrameBank, IntensityBank, TableFormat
from markerseek.signals import PRESET_NAMES, ProbeKeys, ProbePreset, is_own, probe_preset

NEEDED = ("elements", "pitch_m", "sampling_hz", "low_hz", "high_hz", "sound_speed_m_s")
"""Keys of a probe file that starts from no preset."""

_SAME = 0.01
"""Largest difference between the pitch of a probe and that of a bank, as a share."""


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


def read_recording(
    path: Path, table: TableFormat = DEFAULT_FORMAT, *, probe: str | ProbePreset | None
) -> IntensityBank | FrameBank:
    """Return the bank at a path, read and completed as its probe says; None: the first preset. ``table``: of a CSV."""
    # Here: the readers of all formats lengthen the start of every search.
    from markerseek.records.banks import read_bank

    return with_probe_facts(read_bank(path, table, blanked=blanked_samples(probe)), probe)


def blanked_samples(probe: str | ProbePreset | None) -> int:
    """Return the samples from the trigger on that are not imaged, of a probe; None: the first preset."""
    return chosen_probe(PRESET_NAMES[0] if probe is None else probe).pickup_samples


def with_probe_facts(bank: IntensityBank | FrameBank, probe: str | ProbePreset | None) -> IntensityBank | FrameBank:
    """Return the bank, completed with the sampling frequency and face radius of a user's own probe."""
    preset = None if probe is None else chosen_probe(probe)
    if preset is None or not is_own(preset) or isinstance(bank, IntensityBank):
        return bank
    facts = bank.facts
    return replace(
        bank,
        facts=structs.replace(
            facts,
            sampling_hz=preset.sampling_hz if facts.sampling_hz is None else facts.sampling_hz,
            face_radius_m=preset.face_radius_m if facts.face_radius_m is None else facts.face_radius_m,
        ),
    )


def preset_of(bank: IntensityBank | FrameBank, probe: str | ProbePreset | None) -> ProbePreset:
    """Return the preset for imaging a bank's frames; samples that were filled in before its first one are blanked.

    A probe of the user's own is used as it is described. In one of our presets, array, sampling and sound speed of the
    bank replace those of the preset.

    ``probe``: None: the one that the bank names, else the first of all.
    """
    preset = _preset_of(bank, probe)
    filled = round((bank.facts.first_sample_s or 0.0) * preset.sampling_hz)
    return structs.replace(preset, recorded=True, pickup_samples=max(preset.pickup_samples, filled))


def _preset_of(bank: IntensityBank | FrameBank, probe: str | ProbePreset | None) -> ProbePreset:
    facts = bank.facts
    preset = None if probe is None else chosen_probe(probe)
    if preset is not None and is_own(preset):
        _require_same(bank, preset)
        return preset
    if preset is None and facts.probe_settings is not None:
        return _recorded(facts.probe_settings)
    preset = preset or probe_preset(facts.probe or PRESET_NAMES[0])
    if facts.sampling_hz is not None:
        preset = structs.replace(preset, sampling_hz=facts.sampling_hz)
    if facts.sound_speed_m_s is not None:
        preset = structs.replace(preset, sound_speed_m_s=facts.sound_speed_m_s)
    if facts.pitch_m is not None and isinstance(bank, FrameBank):
        elements = bank.frame(0).samples.shape[0]
        preset = structs.replace(preset, array=structs.replace(preset.array, elements=elements, pitch_m=facts.pitch_m))
    return preset


def _recorded(settings: str) -> ProbePreset:
    try:
        preset: ProbePreset = recorded_settings(settings.encode(), ProbePreset)
    except (msgspec.MsgspecError, ConfigError, RecursionError) as problem:
        raise RecordError(f"the description of the bank's probe cannot be read: {problem}; name it by `probe`") from (
            problem
        )
    return preset


def _require_same(bank: IntensityBank | FrameBank, preset: ProbePreset) -> None:
    """Refuse a probe that contradicts the bank: a wrong rate or pitch shifts every depth and position."""
    for name, unit, held, given in (
        ("sampling_hz", "Hz", bank.facts.sampling_hz, preset.sampling_hz),
        ("pitch_m", "m", bank.facts.pitch_m, preset.array.pitch_m),
    ):
        if held is not None and abs(held - given) > _SAME * given:
            raise ConfigError(
                f"probe {preset.name}: {name} is {given:g} {unit}, and the recording says {held:g} {unit}; correct the "
                "probe's file"
            )
