"""Permits: to fire for one acquisition at one angle, to fire single pulses in one sweep, and to follow a target."""

from __future__ import annotations

import math

import msgspec

from markerseek.core.checks import is_finite, is_whole, require_range
from markerseek.core.errors import ConfigError
from markerseek.core.interval import Interval

SWEEP_READING_S = 0.15
"""Longest time between two readings of a stage that sweeps, in seconds."""

MOST_FOLLOWING_HZ = 64
"""Most pulses within a second that a permit to follow may allow: a few looks of a camera, and one acquisition."""

_TURN_S = 1.0


class Permit(msgspec.Struct, frozen=True, kw_only=True):
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
        """Number of pulses averaged in a frame."""
        return self.pulses

    @property
    def commanded_deg(self) -> float:
        """Angle that the stage is sent to, in degrees."""
        return self.angle_deg

    @property
    def turned_deg(self) -> float:
        """Largest turn of the probe between the readbacks before and after a frame, in degrees."""
        return 0.0


class SweepPermit(Permit, frozen=True, kw_only=True):
    """Permits single pulses while the probe turns from ``angle_deg`` to ``to_deg``, until a moment, once.

    The target of the stage is the end of the permit, so the stage stops there by itself even if the search dies.

    Attributes
    ----------
    to_deg
        Angle at which it ends, or turns back, in degrees.
    back_deg
        Angle at which it ends after it has turned back at ``to_deg``; None: it does not turn back.
    slowest_deg_s, fastest_deg_s
        Speeds between which the probe may be lit, in degrees per second, in either direction; where it turns back it
        may be slower, and at rest, for `turn_s`.
    period_s
        Least time between two pulses, in seconds.

    Raises
    ------
    ConfigError
        If a limit is no number, or the limits leave no pulse.
    """

    to_deg: float
    slowest_deg_s: float
    fastest_deg_s: float
    period_s: float
    back_deg: float | None = None

    def __post_init__(self) -> None:
        if not (is_finite(self.angle_deg) and is_finite(self.to_deg) and self.to_deg != self.angle_deg):
            raise ConfigError(
                f"sweep permit: from {self.angle_deg} to {self.to_deg} deg, these must be two different angles"
            )
        if self.back_deg is not None and not self.forward * (self.to_deg - self.back_deg) > 0:
            raise ConfigError(
                f"sweep permit: from {self.angle_deg} to {self.to_deg} and back to {self.back_deg} deg, it must turn "
                "back there"
            )
        name = "sweep permit: slowest_deg_s"
        require_range(name, self.slowest_deg_s, low=0, high=self.fastest_deg_s, unit="deg/s", open_low=True)
        require_range("sweep permit: fastest_deg_s", self.fastest_deg_s, low=0, high=360, unit="deg/s")
        require_range("sweep permit: period_s", self.period_s, low=1e-6, high=10, unit="s")

    @property
    def forward(self) -> float:
        """1 where the angle rises, -1 where it falls."""
        return math.copysign(1.0, self.to_deg - self.angle_deg)

    @property
    def end_deg(self) -> float:
        """Angle at which the light ends, in degrees."""
        return self.to_deg if self.back_deg is None else self.back_deg

    @property
    def turn_s(self) -> float:
        """Longest time for which the probe may be lit where it turns back, in seconds."""
        return _TURN_S

    @property
    def words(self) -> str:
        """What it permits, in words; without pulses it is a turn in the dark."""
        what = "sweep" if self.pulses else "turn"
        back = "" if self.back_deg is None else f" and back to {self.back_deg:.2f} deg"
        return (
            f"the permitted {what} from {self.angle_deg:.2f} to {self.to_deg:.2f} deg{back}, at most "
            f"{self.fastest_deg_s:.4g} deg/s, with a reading every {SWEEP_READING_S:g} s until {self.expires_s:.1f} s"
        )

    def turns_at(self, angle_deg: float, *, within_deg: float) -> bool:
        """Return whether it may turn back at an angle, in degrees."""
        return self.back_deg is not None and abs(angle_deg - self.to_deg) <= within_deg

    def turned(self, before_deg: float, angle_deg: float, *, back: bool) -> tuple[float, float]:
        """Return how far a probe has turned along its way, and how far it is outside of it, in degrees.

        ``back``: whether it is on the way back.
        """
        from_deg, to_deg = (self.to_deg, self.end_deg) if back else (self.angle_deg, self.to_deg)
        forward = -self.forward if back else self.forward
        return forward * (angle_deg - before_deg), max(forward * (angle_deg - to_deg), forward * (from_deg - angle_deg))

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
        """Largest turn of the probe between two readings of the stage, in degrees."""
        return self.fastest_deg_s * SWEEP_READING_S


class FollowPermit(msgspec.Struct, frozen=True, kw_only=True):
    """Permits to follow a target with the probe for some time; a person gives it, and renews it.

    Attributes
    ----------
    angles
        Angles to which the probe may be turned, inside the search range.
    speed_deg_s
        Largest speed of a turn, in degrees per second.
    duration_s
        Time after which it is void, in seconds.
    pulses
        Most pulses of one firing, which needs the probe at rest; 0: there is no light.
    pulses_per_second
        Most pulses within any one second.

    Raises
    ------
    ConfigError
        If a limit is no number, or bounds nothing.
    """

    angles: Interval
    speed_deg_s: float
    duration_s: float
    pulses: int
    pulses_per_second: int

    def __post_init__(self) -> None:
        require_range("follow permit: speed_deg_s", self.speed_deg_s, low=0, high=100, unit="deg/s", open_low=True)
        require_range("follow permit: duration_s", self.duration_s, low=0, high=3600, unit="s", open_low=True)
        if not (is_whole(self.pulses) and is_whole(self.pulses_per_second)):
            raise ConfigError(
                f"follow permit: {self.pulses} pulses, {self.pulses_per_second} a second, these must be whole numbers"
            )
        if not 0 <= self.pulses <= self.pulses_per_second <= MOST_FOLLOWING_HZ:
            raise ConfigError(
                f"follow permit: {self.pulses} pulses at once and {self.pulses_per_second} a second, it must be at "
                f"least 0, no more at once than in a second, and at most {MOST_FOLLOWING_HZ} a second"
            )

    def turn(self, from_deg: float, to_deg: float, *, fastest_deg_s: float, expires_s: float) -> SweepPermit:
        """Return the rules of one turn in the dark: those of a sweep, without its light.

        Parameters
        ----------
        from_deg, to_deg
            Angles at which it begins and ends, in degrees.
        fastest_deg_s
            Speed beyond which it has failed, in degrees per second.
        expires_s
            Time by which it is over, in seconds on the rig's clock.

        Raises
        ------
        ConfigError
            If the angles are equal, or a limit is no number.
        """
        return SweepPermit(
            token="",
            angle_deg=from_deg,
            pulses=0,
            expires_s=expires_s,
            to_deg=float(to_deg),
            slowest_deg_s=self.speed_deg_s,
            fastest_deg_s=fastest_deg_s,
            period_s=1.0,
        )
