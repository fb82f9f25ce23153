"""Named probes, and one of the user's own: the parameters of probe and receiver that the imaging chain needs.

Element size and angular response are not among them: one-way delay-and-sum needs neither.
"""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

import msgspec
from msgspec import structs

from markerseek.core import ConfigError, LinearArray, Within, require_fields

Hertz: TypeAlias = Annotated[float, Within(1e5, 1e9, "Hz")]
"""A sampling frequency, or an edge of a band."""


class ProbePreset(msgspec.Struct, frozen=True, kw_only=True):
    """A probe, its receiver, and how its frames are imaged."""

    name: str
    """Its name on the command line."""
    array: LinearArray = LinearArray()
    sampling_hz: Hertz = 40e6
    # From air to bone, with room to spare.
    sound_speed_m_s: Annotated[float, Within(300, 7000, "m/s")] = 1540.0
    low_hz: Hertz = 5e6
    high_hz: Hertz = 9e6
    """``low_hz`` and ``high_hz``: edges of the pass band, where the amplitude is halved."""
    f_number: Annotated[float, Within(0, 1e6)] = 2.0
    """Depth over width of the receiving aperture; 0 takes all elements at every depth."""
    pickup_samples: Annotated[int, Within(0, math.inf)] = 100
    """Samples after the trigger that hold the laser's electrical pick-up and are blanked."""
    trigger_offset_s: Annotated[float, Within(-1e-3, 1e-3, "s")] = 0.0
    """Time from the trigger (sample 0) to the middle of the laser's pulse."""
    full_scale: Annotated[int, Within(1, 32767, "counts")] = 2047
    """Counts at which the converter saturates."""
    recorded: bool = False
    """Whether its frames are a recording: numbers beyond ``full_scale`` are then of another converter."""
    face_radius_m: Annotated[float | None, Within(0, 0.05, "m", open_low=True, cure="0.01 is usual")] = None
    """Distance of the array's face from the axis of rotation; None if not known. The imaging does not need it, the
    position of a marker does."""

    def __post_init__(self) -> None:
        preset = f"preset {self.name}"
        require_fields(self, preset)
        if not self.low_hz < self.high_hz <= 0.45 * self.sampling_hz:
            raise ConfigError(
                f"{preset}: the band is {self.low_hz:g} to {self.high_hz:g} Hz; it must ascend and end below "
                f"0.45 of the sampling frequency, {0.45 * self.sampling_hz:g} Hz"
            )

    @property
    def depth_step_m(self) -> float:
        """Distance between image rows in metres: whole samples, and still above twice the highest frequency."""
        stride = max(1, math.floor(self.sampling_hz / (2.2 * self.high_hz)))
        return stride * self.sound_speed_m_s / self.sampling_hz


_PRESETS = {
    each.name: each
    for each in (
        # Name and band of the paper's probe; the pitch is inferred from the array's 55 mm. Elements of two wavelengths
        # receive little from the side: f-number 2.
        ProbePreset(name="BPL9-5/55"),
        # Alpinion L3-8 as the public data set was taken; water and phantom both focus best at 1480 m/s.
        ProbePreset(
            name="L3-8",
            array=LinearArray(elements=128, pitch_m=0.30e-3),
            sound_speed_m_s=1480.0,
            low_hz=1.5e6,
            high_hz=8e6,
            f_number=1.5,
            pickup_samples=200,
        ),
    )
}

PRESET_NAMES = tuple(_PRESETS)
"""Names that `probe_preset` knows; the first is the default of the simulated rig."""


def probe_preset(name: str) -> ProbePreset:
    """Return the preset of that name."""
    try:
        return _PRESETS[name]
    except KeyError:
        raise ConfigError(f"probe {name!r} is not known; choose one of: {', '.join(PRESET_NAMES)}") from None


class ProbeKeys(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
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
        """Return the preset with the values of these keys.

        ``preset``: where values come from that are None here. ``sampling_hz``: None takes the preset's. ``name``: None
        takes the preset's.
        """
        # A subclass may have keys that are none of a preset's.
        keys = {name: getattr(self, name) for name in ProbeKeys.__struct_fields__}
        keys |= {"sampling_hz": sampling_hz, "name": name}
        given = {key: value for key, value in keys.items() if value is not None}
        of_array = {key: given.pop(key) for key in ("elements", "pitch_m") if key in given}
        return structs.replace(preset, array=structs.replace(preset.array, **of_array), **given)


def is_own(preset: ProbePreset) -> bool:
    """Return whether a probe has to be described in full, because no preset has its name."""
    return preset.name not in PRESET_NAMES
