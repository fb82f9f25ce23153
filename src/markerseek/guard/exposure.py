"""Skin exposure figures of a pulsed laser (ICNIRP 2013, IEC 60825-1), 400-1400 nm; an aid, never an interlock."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import ConfigError

CAVEAT = (
    "These figures concern skin only and are no clearance: a laser safety officer must confirm them. "
    "The eye's limit is hundreds of times lower."
)


def correction_c_a(wavelength_nm: float) -> float:
    """Factor C_A, 1 up to 700 nm and 5 from 1050 nm.

    Raises
    ------
    ConfigError
        If the wavelength is NaN or outside 400-1400 nm.
    """
    if not 400 <= wavelength_nm <= 1400:
        raise ConfigError(f"wavelength_nm is {wavelength_nm} nm, the formulas hold from 400 to 1400 nm")
    return min(max(1.0, float(10 ** (0.002 * (wavelength_nm - 700)))), 5.0)


def skin_limit_j_m2(*, wavelength_nm: float, duration_s: float) -> float:
    """Most radiant exposure of skin by one pulse, or by one train of pulses as a whole, in J/m².

    Raises
    ------
    ConfigError
        If the wavelength is outside 400-1400 nm, or the duration not at least 1 ns and finite.
    """
    c_a = correction_c_a(wavelength_nm)
    if not 1e-9 <= duration_s < float("inf"):
        raise ConfigError(f"duration_s is {duration_s} s, the formulas hold from 1 ns on")
    if duration_s <= 100e-9:
        return 200 * c_a
    if duration_s <= 10:
        return 11e3 * c_a * float(duration_s**0.25)
    return 2e3 * c_a * duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinExposure:
    """What skin would get from a train of equal pulses on one spot, beside the limits.

    Attributes
    ----------
    wavelength_nm, pulse_s
        Wavelength in nm and duration of a pulse in seconds.
    energy_j, spot_m2
        Energy of a pulse in joules, on an area in m².
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
            if not 0 < getattr(self, name) < float("inf"):
                raise ConfigError(f"exposure: {name} is {getattr(self, name)}, it must be positive and finite")
        skin_limit_j_m2(wavelength_nm=self.wavelength_nm, duration_s=self.pulse_s)
        skin_limit_j_m2(wavelength_nm=self.wavelength_nm, duration_s=self.train_s)

    @property
    def pulse_share(self) -> float:
        """Radiant exposure of one pulse as a share of its limit; 1 is the limit."""
        limit_j_m2 = skin_limit_j_m2(wavelength_nm=self.wavelength_nm, duration_s=self.pulse_s)
        return self.energy_j / self.spot_m2 / limit_j_m2

    @property
    def train_share(self) -> float:
        """Radiant exposure of the whole train as a share of its limit; 1 is the limit."""
        limit_j_m2 = skin_limit_j_m2(wavelength_nm=self.wavelength_nm, duration_s=self.train_s)
        return self.energy_j * self.rate_hz * self.train_s / self.spot_m2 / limit_j_m2

    def __str__(self) -> str:
        return f"skin: a pulse is {self.pulse_share:.1%} of its limit, the train {self.train_share:.1%}. {CAVEAT}"
