"""An armed guard, the permit of a sweep and one to follow, for the tests of the guard."""

from __future__ import annotations

from typing import Any

from markerseek.core import FollowPermit, Interval, SweepPermit
from markerseek.guard import Admission, FiringLimits, Guard, Limits

WANTED = SweepPermit(
    token="",
    angle_deg=-30.0,
    pulses=100,
    expires_s=0.0,
    to_deg=30.0,
    slowest_deg_s=2.0,
    fastest_deg_s=12.0,
    period_s=0.05,
)

FOLLOW = FollowPermit(
    angles=Interval(low_deg=-20.0, high_deg=25.0), speed_deg_s=4.0, duration_s=60.0, pulses=4, pulses_per_second=6
)


def disarmed(**changes: Any) -> Guard:
    """A new guard, by the usual rules but for those that are changed."""
    return Guard(**({"limits": Limits(), "firing": FiringLimits(), "admission": Admission()} | changes))


def armed(**changes: Any) -> Guard:
    """The same, armed."""
    made = disarmed(**changes)
    made.arm(by="a test")
    return made
