"""Numbers and values of a KDC101 or TDC001 that turns a PRM1Z8.

The units are of this stage with this controller, whose clock ticks every 2048/6e6 s: counts per degree, and words for
speed and acceleration. They are rounded, never cut off.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core import ConfigError

COUNTS_PER_DEG = 1919.6418578623391
SPEED_WORD = 42941.66
"""Word for one degree per second."""
ACCELERATION_WORD = 14.6574
"""Word for one degree per second squared."""

_WORD = 2**31


def counts_of(angle_deg: float) -> int:
    """Encoder counts of an angle in degrees, to the nearest.

    Raises
    ------
    ConfigError
        If the angle is not finite, or has no 32-bit count.
    """
    return _word(angle_deg * COUNTS_PER_DEG, f"{angle_deg} deg")


def degrees_of(counts: int) -> float:
    """Angle in degrees of so many encoder counts."""
    return counts / COUNTS_PER_DEG


def speed_word(speed_deg_s: float) -> int:
    """Word for a speed in degrees per second, to the nearest."""
    return _word(speed_deg_s * SPEED_WORD, f"{speed_deg_s} deg/s")


def acceleration_word(acceleration_deg_s2: float) -> int:
    """Word for an acceleration in degrees per second squared, to the nearest."""
    return _word(acceleration_deg_s2 * ACCELERATION_WORD, f"{acceleration_deg_s2} deg/s^2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Info:
    """Who a controller is: model, serial number, firmware."""

    model: str
    serial_number: int
    firmware: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Velocity:
    """How fast it may turn, in words."""

    acceleration: int
    speed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SoftLimits:
    """How far it may turn, in counts, what it does there, and what it does at its limit switches.

    Attributes
    ----------
    low, high
        Ends of the range, in counts.
    mode
        1 goes on, 2 stops at once, 3 brakes.
    switches
        What both switches do: 4 is made at home and means nothing elsewhere.
    """

    low: int
    high: int
    mode: int = 2
    switches: int = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Status:
    """Where it is and what it does.

    Attributes
    ----------
    position
        Position counter, signed.
    moving, homing, homed
        Its own word on that. The first is false for a moment after a move was asked for.
    faults
        Errors that it reports, in words.
    """

    position: int
    moving: bool
    homing: bool
    homed: bool
    faults: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Counts:
    """A number of counts that was stored: a target, or a backlash."""

    counts: int


Answer = Info | Velocity | SoftLimits | Status | Counts


def _word(value: float, meaning: str) -> int:
    if not (math.isfinite(value) and -_WORD <= round(value) < _WORD):
        raise ConfigError(f"{meaning} cannot be said to the stage's controller, whose words have 32 bits")
    return round(value)
