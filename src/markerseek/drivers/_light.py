"""Keys of every laser in a rig file: its pulses, and its light on the skin."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import require_range

LIGHT = {
    "wavelength_nm": (400, 1400, "nm"),
    "pulse_energy_j": (1e-9, 10, "J"),
    "pulse_width_s": (1e-9, 1e-3, "s"),
    "spot_diameter_m": (1e-5, 1, "m"),
}
"""Ranges in which the limits of skin exposure hold (wavelength, pulse width), or which a suitable laser can have."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserKeys:
    """Keys that every laser has."""

    pulses: int = 16
    """Pulses averaged in one acquisition."""
    rate_hz: float = 100.0
    """Pulses per second."""
    wavelength_nm: float | None = None
    pulse_energy_j: float | None = None
    pulse_width_s: float | None = None
    spot_diameter_m: float | None = None
    """``wavelength_nm``, ``pulse_energy_j``, ``pulse_width_s`` and ``spot_diameter_m``: the light on the skin:
    wavelength in nm, energy and duration of a pulse in J and s, and diameter of the lit spot in metres. They only serve
    to show the exposure of skin when the rig is armed; None if not known."""

    def __post_init__(self) -> None:
        for name, (low, high, unit) in LIGHT.items():
            value = getattr(self, name)
            if value is not None:
                require_range(f"laser: {name}", value, low=low, high=high, unit=unit)
        require_range("laser: pulses", self.pulses, low=1, high=1024)
        require_range("laser: rate_hz", self.rate_hz, low=0, high=1000, unit="Hz", open_low=True)
