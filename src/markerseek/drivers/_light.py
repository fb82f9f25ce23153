"""Keys of every laser in a rig file: its pulses, and its light on the skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from markerseek.core import ConfigError, require_range

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
    energy_from: Literal["photodiode", "pickup", "metadata"] | None = None
    """What measures the energy of each acquisition, by which readings are divided: the photodiode of a laser box with a
    light meter, the laser's pick-up in the channels, or a field of a PLUS server's images. None: nothing does."""
    usual_energy: float | None = None
    """What it says of a usual pulse, in a unit of its own; None: it is measured and not used."""
    pickup_us: tuple[float, float] | None = None
    """Where the pick-up is: first and last moment after the trigger, in microseconds."""
    energy_field: str | None = None
    """Name of the field of a PLUS server's images."""

    def __post_init__(self) -> None:
        for name, (low, high, unit) in LIGHT.items():
            value = getattr(self, name)
            if value is not None:
                require_range(f"laser: {name}", value, low=low, high=high, unit=unit)
        if self.usual_energy is not None:
            require_range("laser: usual_energy", self.usual_energy, low=0, high=1e12, open_low=True)
        for name, source in (("pickup_us", "pickup"), ("energy_field", "metadata")):
            if (getattr(self, name) is None) == (self.energy_from == source):
                raise ConfigError(
                    f"laser: {name} belongs to energy_from = {source!r}, which is {self.energy_from!r}; name both, or "
                    "neither"
                )
        if self.pickup_us is not None and not 0 <= self.pickup_us[0] < self.pickup_us[1] <= 1000:
            raise ConfigError(
                f"laser: pickup_us is {list(self.pickup_us)} us, it must be a first and a later moment of 0 to 1000 us"
            )
        require_range("laser: pulses", self.pulses, low=1, high=1024)
        require_range("laser: rate_hz", self.rate_hz, low=0, high=1000, unit="Hz", open_low=True)
