"""Skin exposure by a pulsed laser (ICNIRP 2013, IEC 60825-1), 400-1400 nm: for planning, never an interlock.

It is shown when a rig of devices is armed, from the settings of its laser.
"""

from __future__ import annotations

import math

from markerseek.core import ConfigError
from markerseek.drivers.entry import LIGHT, LaserKeys

CAVEAT = "A laser safety officer must confirm this; the eye's limit is hundreds of times lower."


def correction_c_a(wavelength_nm: float) -> float:
    """Return the factor C_A of a wavelength in nm: 1 up to 700 nm, 5 from 1050 nm.

    `ConfigError` outside 400-1400 nm.
    """
    if not 400 <= wavelength_nm <= 1400:
        raise ConfigError(f"exposure: wavelength_nm is {wavelength_nm} nm, the limits hold in [400, 1400] nm")
    # Table of C_A in ICNIRP 2013: 1 to 700 nm, 10^(0.002(λ-700)) to 1050 nm, 5 above; min and max join the pieces.
    return min(max(1.0, math.pow(10, 0.002 * (wavelength_nm - 700))), 5.0)


def skin_limit_j_m2(*, wavelength_nm: float, duration_s: float) -> float:
    """Return the most radiant exposure of skin in J/m² by a pulse, or by a train as a whole.

    `ConfigError` below 1 ns.
    """
    c_a = correction_c_a(wavelength_nm)
    # Below 1 ns the limits are those of peak irradiance, which are not computed here.
    if not 1e-9 <= duration_s < math.inf:
        raise ConfigError(f"exposure: a duration of {duration_s} s, the limits hold from 1 ns on")
    # Skin limits of ICNIRP 2013 by duration: 200 C_A J/m², 1.1e4 C_A t^0.25 J/m², 2e3 C_A W/m².
    if duration_s <= 1e-7:
        return 200 * c_a
    if duration_s <= 10:
        return 11e3 * c_a * math.pow(duration_s, 0.25)
    return 2e3 * c_a * duration_s


_LONG_S = 10.0
"""Duration in seconds from which the limit is a constant irradiance: longer trains have the same share."""


def exposure_line(laser: LaserKeys) -> str:
    """Return the skin exposure as shares of the limits in a line, or which keys of the rig file are missing.

    The three shares are those of a pulse, of one acquisition, and of pulses without a pause; a search pauses.
    """
    light = {name: getattr(laser, name) for name in LIGHT}
    missing = [f"laser.{name}" for name, value in light.items() if value is None]
    if missing:
        return f"skin exposure: not shown, the rig file has no {', '.join(missing)}. {CAVEAT}"
    pulse_j_m2: float = light["pulse_energy_j"] / (math.pi * light["spot_diameter_m"] ** 2 / 4)

    def share(pulses: float, duration_s: float) -> float:
        return pulses * pulse_j_m2 / skin_limit_j_m2(wavelength_nm=light["wavelength_nm"], duration_s=duration_s)

    return (
        f"skin exposure: a pulse is {share(1, light['pulse_width_s']):.1%} of its limit, an acquisition of "
        f"{laser.pulses} pulses {share(laser.pulses, laser.pulses / laser.rate_hz):.1%}, {laser.rate_hz:g} Hz without "
        f"a pause {share(laser.rate_hz * _LONG_S, _LONG_S):.1%}. {CAVEAT}"
    )
