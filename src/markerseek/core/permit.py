"""Permits to fire: for one acquisition at one angle, and for the single pulses of one sweep."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markerseek.core.checks import is_finite, require_range
from markerseek.core.errors import ConfigError

SWEEP_READING_S = 0.15
"""Most time from one reading of a stage that sweeps to the next in seconds; the stage gets a new target as often."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Permit:
    """Permits a number of pulses at one angle, until a moment, once.

    Attributes
    ----------
    token
        Name of the permit; used once.
    angle_deg
        Angle at which it holds, in degrees.
    pulses
        Most pulses that may be fired; 0 takes a dark frame.
    expires_s
        Moment on the rig's clock after which it is void, in seconds.
    """

    token: str
    angle_deg: float
    pulses: int
    expires_s: float

    @property
    def pulses_in_1_s(self) -> int:
        """Most of its pulses within any one second."""
        return self.pulses

    @property
    def pulses_in_frame(self) -> int:
        """Pulses of which a frame is the average."""
        return self.pulses

    @property
    def commanded_deg(self) -> float:
        """Angle that the stage is sent to, in degrees."""
        return self.angle_deg

    @property
    def turned_deg(self) -> float:
        """Most that the probe may turn from the readback before a frame to that after it, in degrees."""
        return 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepPermit(Permit):
    """Permits single pulses while the probe turns from ``angle_deg`` to ``to_deg``, until a moment, once.

    Attributes
    ----------
    to_deg
        Angle at which it ends, in degrees.
    slowest_deg_s, fastest_deg_s
        Speeds between which the probe may be lit, in degrees per second, in either direction.
    period_s
        Least time between two pulses, in seconds.
    spacing_deg
        Least angle between two pulses, in degrees.

    Raises
    ------
    ConfigError
        If a limit is no number, or the limits leave no pulse.
    """

    to_deg: float
    slowest_deg_s: float
    fastest_deg_s: float
    period_s: float
    spacing_deg: float = 0.0

    def __post_init__(self) -> None:
        if not (is_finite(self.angle_deg) and is_finite(self.to_deg) and self.to_deg != self.angle_deg):
            raise ConfigError(
                f"sweep permit: from {self.angle_deg} to {self.to_deg} deg, these must be two different angles"
            )
        name = "sweep permit: slowest_deg_s"
        require_range(name, self.slowest_deg_s, low=0, high=self.fastest_deg_s, unit="deg/s", open_low=True)
        require_range("sweep permit: fastest_deg_s", self.fastest_deg_s, low=0, high=360, unit="deg/s")
        require_range("sweep permit: period_s", self.period_s, low=1e-6, high=10, unit="s")
        most_deg = self.slowest_deg_s * self.period_s
        cure = "raise slowest_deg_s or period_s"
        require_range("sweep permit: spacing_deg", self.spacing_deg, low=0, high=most_deg, unit="deg", cure=cure)

    @property
    def forward(self) -> float:
        """1 where the angle rises, -1 where it falls."""
        return math.copysign(1.0, self.to_deg - self.angle_deg)

    @property
    def pulses_in_1_s(self) -> int:
        """Most of its pulses within any one second."""
        return min(self.pulses, math.ceil(1 / self.period_s))

    @property
    def pulses_in_frame(self) -> int:
        """1: each pulse gives a frame."""
        return 1

    @property
    def commanded_deg(self) -> float:
        """Angle that the stage is sent to, in degrees."""
        return self.to_deg

    @property
    def turned_deg(self) -> float:
        """Most that the probe may turn between two readings of the stage, in degrees."""
        return self.fastest_deg_s * SWEEP_READING_S
