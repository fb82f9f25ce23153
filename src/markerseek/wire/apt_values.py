"""Units and values of a KDC101 or TDC001 with a PRM1Z8.

The units are of this stage with this controller, whose clock ticks every 2048/6e6 s: counts per degree, and words for
speed and acceleration. They are rounded, never truncated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import ConfigError

# Thorlabs, "APT Communications Protocol", PRM1-Z8 with TDC001 or KDC101: 1919.64, 42941.66 and 14.66.
COUNTS_PER_DEG = 1919.6418578623391
SPEED_WORD = 42941.66
"""Word for 1 deg/s: counts per sampling interval of 2048/6e6 s, times 65536."""
ACCELERATION_WORD = 14.6574
"""Word for 1 deg/s²: counts per sampling interval squared, times 65536."""

_WORD = 2**31


def counts_of(angle_deg: float) -> int:
    """Encoder counts of an angle in degrees, rounded.

    Raises
    ------
    ConfigError
        If the angle is not finite, or has no 32-bit count.
    """
    return _word(angle_deg * COUNTS_PER_DEG, f"{angle_deg} deg")


def degrees_of(counts: int) -> float:
    """Angle in degrees of a number of encoder counts."""
    return counts / COUNTS_PER_DEG


def speed_word(speed_deg_s: float) -> int:
    """Word for a speed in degrees per second, rounded."""
    return _word(speed_deg_s * SPEED_WORD, f"{speed_deg_s} deg/s")


def acceleration_word(acceleration_deg_s2: float) -> int:
    """Word for an acceleration in degrees per second squared, rounded."""
    return _word(acceleration_deg_s2 * ACCELERATION_WORD, f"{acceleration_deg_s2} deg/s^2")


EMULATOR = "simulated by markerseek"
"""Notes in the identity of an emulated controller."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """Identity of a controller: model, serial number, firmware, and the maker's notes."""

    model: str
    serial_number: int
    firmware: str
    notes: str = ""

    @property
    def emulated(self) -> bool:
        """Whether it says of itself that it is the emulator, and no hardware."""
        return self.notes == EMULATOR


@dataclass(frozen=True, slots=True, kw_only=True)
class Velocity:
    """Speed and acceleration, in the controller's words."""

    acceleration: int
    speed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftLimits:
    """Soft limits in counts, and the behaviour there and at the limit switches.

    Attributes
    ----------
    low, high
        Ends of the range, in counts.
    mode
        At a soft limit: 1 ignores it, 2 stops at once, 3 decelerates.
    switches
        Behaviour of both limit switches: 4 makes on contact, and serves for homing only.
    """

    low: int
    high: int
    mode: int = 2
    switches: int = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Status of the stage.

    Attributes
    ----------
    position
        Position counter, signed.
    moving, homing, homed
        As the controller reports it. ``moving`` is false for a moment after a move was commanded.
    faults
        Names of the errors that it reports.
    """

    position: int
    moving: bool
    homing: bool
    homed: bool
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """A stored number of counts: a target, or a backlash."""

    counts: int


Answer = Info | Velocity | SoftLimits | Status | Counts


def _word(value: float, meaning: str) -> int:
    if not (math.isfinite(value) and -_WORD <= round(value) < _WORD):
        raise ConfigError(f"{meaning} cannot be sent to the stage's controller, whose words have 32 bits")
    return round(value)
