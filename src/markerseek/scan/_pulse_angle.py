"""The angle at which a pulse of a sweep was fired: by its stamp, interpolated between two readings of the stage."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markerseek.core import AcquisitionError, Pulse, StageReading


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedAngle:
    """The angle of a pulse by its stamp, between two readings of the stage."""

    lower: StageReading
    upper: StageReading
    angle_deg: float
    sigma_deg: float
    speed_deg_s: float


def stamped_angle(pulse: Pulse, readings: Sequence[StageReading]) -> StampedAngle:
    """The angle of a pulse by its time; `not_between` is raised where no two readings enclose it."""
    after = next((index for index, each in enumerate(readings) if each.at_s >= pulse.at_s), 0)
    if after == 0:
        raise not_between(pulse, readings)
    lower, upper = readings[after - 1], readings[after]
    interval_s = upper.at_s - lower.at_s
    share = (pulse.at_s - lower.at_s) / interval_s
    speed_deg_s = (upper.angle_deg - lower.angle_deg) / interval_s
    # A reading is of any moment between question and answer: uniform, of standard deviation 1/√12.
    read_s = math.hypot(
        (1 - share) * (lower.answered_s - lower.asked_s), share * (upper.answered_s - upper.asked_s)
    ) / math.sqrt(12)
    # At constant acceleration, half way between two readings, a chord is off by a·h²/8.
    bend_deg = 0.0
    if after > 1:
        first = readings[after - 2]
        before_deg_s = (lower.angle_deg - first.angle_deg) / (lower.at_s - first.at_s)
        bend_deg = abs(speed_deg_s - before_deg_s) * interval_s / 8
    return StampedAngle(
        lower=lower,
        upper=upper,
        angle_deg=lower.angle_deg + share * (upper.angle_deg - lower.angle_deg),
        sigma_deg=math.hypot(speed_deg_s * math.hypot(read_s, pulse.sigma_s), bend_deg),
        speed_deg_s=speed_deg_s,
    )


def not_between(pulse: Pulse, readings: Sequence[StageReading]) -> AcquisitionError:
    """The error of a pulse that no two readings of the stage enclose."""
    return AcquisitionError(
        f"a pulse at {pulse.at_s:.3f} s is not between two readings of the stage, from {readings[0].at_s:.3f} to "
        f"{readings[-1].at_s:.3f} s; the sweep is refused whole, compare the clocks"
    )
