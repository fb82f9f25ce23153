"""A probe of the user's own: the keys in which it differs from a preset."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from markerseek.signals.presets import PRESET_NAMES, ProbePreset


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbeKeys:
    """Keys of a table that describes a probe for the imaging; None takes the value of the preset that it starts from.

    The attributes are those of `ProbePreset`, with the array's two beside the others.
    """

    elements: int | None = None
    pitch_m: float | None = None
    low_hz: float | None = None
    high_hz: float | None = None
    sound_speed_m_s: float | None = None
    f_number: float | None = None
    pickup_samples: int | None = None
    full_scale: int | None = None
    trigger_offset_s: float | None = None
    face_radius_m: float | None = None

    def on(self, preset: ProbePreset, *, sampling_hz: float | None = None, name: str | None = None) -> ProbePreset:
        """The preset with the values of these keys.

        ``preset``: where values come from that are None here. ``sampling_hz``: None takes the preset's. ``name``: None
        takes the preset's.
        """
        # A subclass may have keys that are none of a preset's.
        keys = {each.name: getattr(self, each.name) for each in fields(ProbeKeys)}
        keys |= {"sampling_hz": sampling_hz, "name": name}
        given = {key: value for key, value in keys.items() if value is not None}
        of_array = {key: given.pop(key) for key in ("elements", "pitch_m") if key in given}
        return replace(preset, array=replace(preset.array, **of_array), **given)


def is_own(preset: ProbePreset) -> bool:
    """Whether a probe has to be described in full, because no preset has its name."""
    return preset.name not in PRESET_NAMES
