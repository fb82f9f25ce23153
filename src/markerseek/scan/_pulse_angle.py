"""The angle at which a pulse of a sweep was fired: by its stamp, and by the stage's trigger that gave it.

By its stamp it is interpolated between two readings of the stage. A trigger's angle is the encoder's own, and must
agree with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markerseek.core import AcquisitionError, LaserError, Pulse, StageReading, Triggers

AGREE_DEG = 0.02
"""Most by which the angle of a trigger and that of its stamp differ, beside what the clocks leave open."""

READ_LATE_S = 15e-3
"""Most by which the stage's readings may be late against the stamps, where its triggers give the angles: three times
what a free-running sweep takes for its standard deviation."""


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


class TriggerCount:
    """The triggers of one sweep, counted from the first that gave light."""

    def __init__(self, triggers: Triggers) -> None:
        self.angles_deg, self.sigma_deg = triggers.angles_deg, triggers.sigma_deg
        self._before_first: int | None = None

    def angle_deg(self, pulse: Pulse, stamped: StampedAngle) -> float:
        """Angle of the trigger that gave a pulse, with which that of its stamp must agree.

        The stamp of the first pulse says which trigger gave it, because some may have come before the light. From there
        on triggers are counted; if one is lost or doubled on its way, all later stamps disagree.
        """
        angles_deg, edge = self.angles_deg, pulse.edge
        if edge is None:
            raise LaserError("a pulse of a position-triggered sweep does not say which trigger gave it")
        if self._before_first is None:
            nearest = min(range(len(angles_deg)), key=lambda each: abs(angles_deg[each] - stamped.angle_deg))
            self._before_first = nearest - edge
        index = self._before_first + edge
        most_deg = AGREE_DEG + 4 * stamped.sigma_deg + READ_LATE_S * abs(stamped.speed_deg_s)
        if len(angles_deg) > 1:
            # Farther away it might as well be that of the next trigger.
            most_deg = min(most_deg, abs(angles_deg[1] - angles_deg[0]) / 2)
        off_deg = stamped.angle_deg - angles_deg[index] if 0 <= index < len(angles_deg) else math.inf
        if not abs(off_deg) <= most_deg:
            raise AcquisitionError(
                f"trigger {edge} of the stage and the stamp of its pulse differ by {off_deg:.3f} deg, at most "
                f"{most_deg:.3f} deg are the clocks': a trigger was lost or doubled, or the stage is read too late, "
                "and the sweep is refused whole; check the cable from the stage's trigger to the laser box, or sweep "
                "slower"
            )
        return angles_deg[index]
