"""Named probes: the parameters of probe and receiver that the imaging chain needs.

Element size and angular response are not among them: one-way delay-and-sum needs neither.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from markerseek.core import ConfigError, LinearArray, require_range

SAMPLING_HZ = (1e5, 1e9)
"""Slowest and fastest sampling, and lowest and highest edge of a band, in Hz."""

SOUND_SPEED_M_S = (300.0, 7000.0)
"""Slowest and fastest speed of sound in m/s, of air and of bone with room to spare; as in `markerseek.acoustics`."""

MAX_FACE_RADIUS_M = 0.05
"""Largest distance of an array's face from the axis of rotation in metres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProbePreset:
    """A probe, its receiver, and how its frames are imaged."""

    name: str
    """Its name on the command line."""
    array: LinearArray = field(default_factory=LinearArray)
    sampling_hz: float = 40e6
    sound_speed_m_s: float = 1540.0
    low_hz: float = 5e6
    high_hz: float = 9e6
    """``low_hz`` and ``high_hz``: edges of the pass band, where the amplitude is halved."""
    f_number: float = 2.0
    """Depth over width of the receiving aperture; 0 takes all elements at every depth."""
    pickup_samples: int = 100
    """Samples after the trigger that hold the laser's electrical pick-up and are blanked."""
    trigger_offset_s: float = 0.0
    """Time from the trigger (sample 0) to the middle of the laser's pulse."""
    full_scale: int = 2047
    """Counts at which the converter saturates."""
    recorded: bool = False
    """Whether its frames are a recording: numbers beyond ``full_scale`` are then of another converter."""
    face_radius_m: float | None = None
    """Distance of the array's face from the axis of rotation; None if not known. The imaging does not need it, the
    position of a marker does."""

    def __post_init__(self) -> None:
        preset = f"preset {self.name}"
        for name, (low, high), unit in (
            ("sampling_hz", SAMPLING_HZ, "Hz"),
            ("sound_speed_m_s", SOUND_SPEED_M_S, "m/s"),
            ("low_hz", SAMPLING_HZ, "Hz"),
            ("high_hz", SAMPLING_HZ, "Hz"),
            ("trigger_offset_s", (-1e-3, 1e-3), "s"),
            ("pickup_samples", (0, math.inf), ""),
            ("full_scale", (1, 32767), "counts"),
        ):
            require_range(f"{preset}: {name}", getattr(self, name), low=low, high=high, unit=unit)
        if not self.low_hz < self.high_hz <= 0.45 * self.sampling_hz:
            raise ConfigError(
                f"{preset}: the band is {self.low_hz:g} to {self.high_hz:g} Hz; it must ascend and end below "
                f"0.45 of the sampling frequency, {0.45 * self.sampling_hz:g} Hz"
            )
        if not 0 <= self.f_number < math.inf:
            raise ConfigError(f"{preset}: f_number is {self.f_number}, it must be 0 or more and finite")
        if self.face_radius_m is not None:
            require_range(
                f"{preset}: face_radius_m",
                self.face_radius_m,
                low=0,
                high=MAX_FACE_RADIUS_M,
                unit="m",
                open_low=True,
                cure="0.01 is usual",
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
    """Preset of that name."""
    try:
        return _PRESETS[name]
    except KeyError:
        raise ConfigError(f"probe {name!r} is not known; choose one of: {', '.join(PRESET_NAMES)}") from None
