"""Skin exposure by a pulsed laser (ICNIRP 2013, IEC 60825-1), 400-1400 nm: an aid in planning, never the interlock."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import ConfigError

CAVEAT = "A laser safety officer must confirm this; the eye's limit is hundreds of times lower."


def correction_c_a(wavelength_nm: float) -> float:
    """Factor C_A of a wavelength in nm: 1 up to 700 nm, 5 from 1050 nm; `ConfigError` outside 400-1400 nm."""
    if not 400 <= wavelength_nm <= 1400:
        raise ConfigError(f"exposure: wavelength_nm is {wavelength_nm} nm, the limits hold in [400, 1400] nm")
    return min(max(1.0, math.pow(10, 0.002 * (wavelength_nm - 700))), 5.0)


def skin_limit_j_m2(*, wavelength_nm: float, duration_s: float) -> float:
    """Most radiant exposure of skin in J/m² by a pulse, or by a train as a whole; `ConfigError` below 1 ns."""
    c_a = correction_c_a(wavelength_nm)
    if not 1e-9 <= duration_s < math.inf:
        raise ConfigError(f"exposure: a duration of {duration_s} s, the limits hold from 1 ns on")
    if duration_s <= 1e-7:
        return 200 * c_a
    if duration_s <= 10:
        return 11e3 * c_a * math.pow(duration_s, 0.25)
    return 2e3 * c_a * duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinExposure:
    """What skin would get from a train of equal pulses on one spot, beside the limits.

    Attributes
    ----------
    wavelength_nm, pulse_s, energy_j, spot_m2
        Wavelength in nm; duration of a pulse in seconds, its energy in joules, the area that it meets in m².
    rate_hz, train_s
        Pulses per second, and duration of the train in seconds.
    """

    wavelength_nm: float
    pulse_s: float
    energy_j: float
    spot_m2: float
    rate_hz: float
    train_s: float

    def __post_init__(self) -> None:
        for name in ("energy_j", "spot_m2", "rate_hz"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(f"exposure: {name} is {getattr(self, name)}, it must be positive and finite")

    @property
    def pulse_share(self) -> float:
        """Radiant exposure of one pulse as a share of its limit."""
        return self.energy_j / self.spot_m2 / skin_limit_j_m2(wavelength_nm=self.wavelength_nm, duration_s=self.pulse_s)

    @property
    def train_share(self) -> float:
        """Radiant exposure of the whole train as a share of its limit."""
        limit_j_m2 = skin_limit_j_m2(wavelength_nm=self.wavelength_nm, duration_s=self.train_s)
        return self.energy_j * self.rate_hz * self.train_s / self.spot_m2 / limit_j_m2

    def __str__(self) -> str:
        return f"skin: a pulse is {self.pulse_share:.1%} of its limit, the train {self.train_share:.1%}. {CAVEAT}"
