"""Settings of an emulated stage."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import ConfigError


@dataclass(frozen=True, slots=True, kw_only=True)
class Kdc101Settings:
    """State and mounting of an emulated stage before a driver connects.

    Attributes
    ----------
    homed
        Whether it was homed since it was switched on.
    talking
        Whether it sends its status ten times a second, unasked.
    zero_deg
        The stage's own angle at which the probe points at 0, in degrees.
    turns
        Whole turns that the position counter is ahead: with 1, a probe at -35 deg reads 325.
    play_deg
        Backlash between motor and probe, in degrees.
    mirrored
        Whether the probe is mounted the other way round: its angle falls while the stage's own reading grows.
    model, serial_number
        Model and serial number that it reports.
    """

    homed: bool = True
    talking: bool = False
    zero_deg: float = 0.0
    turns: int = 0
    play_deg: float = 0.1
    mirrored: bool = False
    model: str = "KDC101"
    serial_number: int = 27000001

    def __post_init__(self) -> None:
        if not 0 <= self.play_deg <= 5:
            raise ConfigError(f"emulated stage: play_deg is {self.play_deg} deg, it must lie between 0 and 5 deg")
        if not -360 <= self.zero_deg <= 360:
            raise ConfigError(f"emulated stage: zero_deg is {self.zero_deg} deg, it must lie between -360 and 360 deg")
        if not -10 <= self.turns <= 10:
            raise ConfigError(f"emulated stage: turns is {self.turns}, it must lie between -10 and 10")
