"""A probe of the user's own: the keys in which it differs from a preset."""

from __future__ import annotations

from dataclasses import dataclass, replace

from markerseek.core import LinearArray
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

        Parameters
        ----------
        preset
            Where values come from that are None here.
        sampling_hz
            Sampling frequency in Hz; None takes the preset's.
        name
            Name of the result; None takes the preset's.

        Raises
        ------
        ConfigError
            If a value cannot be used.
        """
        array = LinearArray(
            elements=preset.array.elements if self.elements is None else self.elements,
            pitch_m=preset.array.pitch_m if self.pitch_m is None else self.pitch_m,
        )
        given = {
            "low_hz": self.low_hz,
            "high_hz": self.high_hz,
            "sound_speed_m_s": self.sound_speed_m_s,
            "f_number": self.f_number,
            "pickup_samples": self.pickup_samples,
            "full_scale": self.full_scale,
            "trigger_offset_s": self.trigger_offset_s,
            "face_radius_m": self.face_radius_m,
            "sampling_hz": sampling_hz,
            "name": name,
        }
        # replace() checks the types of keywords one by one, which a dictionary of several types cannot have.
        return replace(preset, array=array, **{key: value for key, value in given.items() if value is not None})  # type: ignore[arg-type]


def is_own(preset: ProbePreset) -> bool:
    """Whether it is a probe that has to be described in full, because its name is none of the presets'."""
    return preset.name not in PRESET_NAMES
