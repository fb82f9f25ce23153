"""A sweep (fly-scan): the probe turns at a constant speed while the laser fires, and each pulse gives one frame."""

from __future__ import annotations

from typing import Annotated

import msgspec

from markerseek.core.checks import Within, is_finite, is_whole, require_fields
from markerseek.core.errors import ConfigError


class Sweep(msgspec.Struct, frozen=True, kw_only=True):
    """One turn of the probe in light.

    Attributes
    ----------
    to_deg
        Angle at which the sweep ends unless it is ended before, in degrees.
    speed_deg_s
        Speed between run-up and braking, in degrees per second, positive in either direction.
    from_deg
        Angle at which it begins, to which the probe is moved without light; None: where the probe is.
    back_deg
        Angle to which the probe turns back in light once it has reached `to_deg`, in degrees; None: it stays there.
    wait_deg
        Angle to which the probe is moved without light after it, while its frames are read, in degrees; None: it stays
        where the sweep ends, as it does where reading them takes no longer than the way there.

    Raises
    ------
    ConfigError
        If a number is not finite, or the speed is not positive.
    """

    to_deg: float
    speed_deg_s: Annotated[float, Within(0, 360, "deg/s", open_low=True)]
    from_deg: float | None = None
    back_deg: float | None = None
    wait_deg: float | None = None

    def __post_init__(self) -> None:
        for name in ("to_deg", "from_deg", "back_deg", "wait_deg"):
            angle_deg = getattr(self, name)
            if not is_finite(angle_deg) and not (angle_deg is None and name != "to_deg"):
                raise ConfigError(f"sweep: {name} is {angle_deg} deg, it must be a finite number")
        require_fields(self, "sweep")

    @property
    def end_deg(self) -> float:
        """Angle at which the light ends, in degrees."""
        return self.to_deg if self.back_deg is None else self.back_deg


class SweepTiming(msgspec.Struct, frozen=True, kw_only=True):
    """What a sample of a sweep shares with the other samples of its sweep.

    Its true angle is ``angle_deg + speed_deg_s * delay + backlash + e``. The delay is the same in all samples of all
    sweeps of a run, the backlash in all samples of one sweep that turn away from the side of approach, and e differs
    from sample to sample.

    Attributes
    ----------
    number
        Number of the sweep in its run, counted from 1.
    speed_deg_s
        Speed of the probe at the pulse in degrees per second, negative where the angle falls.
    delay_sigma_s
        Standard deviation of the unknown delay between pulse and angle, in seconds.
    play_sigma_deg
        Standard deviation of the unknown part of the backlash between encoder and probe, in degrees; 0 where the stage
        turns in the direction in which it approaches the angle of a single acquisition.

    Raises
    ------
    ConfigError
        If a number cannot be used.
    """

    number: int
    speed_deg_s: float
    delay_sigma_s: Annotated[float, Within(0, 1, "s")] = 0.0
    play_sigma_deg: Annotated[float, Within(0, 10, "deg")] = 0.0

    def __post_init__(self) -> None:
        if not (is_whole(self.number) and self.number >= 1):
            raise ConfigError(f"sweep timing: number is {self.number}, it must be a whole number of at least 1")
        if not is_finite(self.speed_deg_s):
            raise ConfigError(f"sweep timing: speed_deg_s is {self.speed_deg_s} deg/s, it must be a finite number")
        require_fields(self, "sweep timing")


class StageReading(msgspec.Struct, frozen=True, kw_only=True):
    """Angle of a turning stage, read between two moments of the rig's clock.

    Attributes
    ----------
    angle_deg
        Readback in degrees.
    asked_s, answered_s
        When it was asked for and when it came, in seconds; the stage was there at a moment in between.
    """

    angle_deg: float
    asked_s: float
    answered_s: float

    @property
    def at_s(self) -> float:
        """Middle between question and answer, in seconds."""
        return (self.asked_s + self.answered_s) / 2


class Pulse(msgspec.Struct, frozen=True, kw_only=True):
    """One pulse of a sweep, as the laser or its trigger box stamped it.

    Attributes
    ----------
    at_s
        When it was fired, on the rig's clock in seconds.
    sigma_s
        Standard deviation of ``at_s``, independent from pulse to pulse, in seconds.
    energy
        Its energy over the usual one; None if the laser does not measure it.
    """

    at_s: float
    sigma_s: float = 0.0
    energy: float | None = None


MAX_AHEAD_DEG = 5.0
"""Most that a target lies ahead of a stage that moves without a permit, in degrees: if the host dies, the stage
turns no further. The target of a sweep is the end of its permit."""

MAX_RESOLUTION_DEG = 0.1
"""Coarsest resolution of a stage, in degrees: further from its target than this, the guard takes a move for a fault."""
