"""The probe of a recording: the preset for imaging its frames, and what a probe of the user's own adds to its facts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
from msgspec import structs

from markerseek.core import ConfigError, RecordError
from markerseek.files import recorded_settings
from markerseek.records.banks import DEFAULT_FORMAT, FrameBank, IntensityBank, TableFormat, read_bank
from markerseek.rigs.probe_file import chosen_probe
from markerseek.signals import PRESET_NAMES, ProbePreset, is_own, probe_preset

_SAME = 0.01
"""Largest difference between the pitch of a probe and that of a bank, as a share."""


def read_recording(
    path: Path, table: TableFormat = DEFAULT_FORMAT, *, probe: str | ProbePreset | None
) -> IntensityBank | FrameBank:
    """Return the bank at a path, read and completed as its probe says; None: the first preset. ``table``: of a CSV."""
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
