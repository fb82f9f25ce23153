"""How a target is followed, as a person chooses it."""

from __future__ import annotations

from typing import Annotated

import msgspec

from markerseek.core import FollowPermit, Help, Interval, require_range

LEAST_WITHIN_DEG = 0.2
"""Least distance at which the probe turns: backlash and arrival of a stage are half of it."""


class FollowPlan(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of following.

    The fields with `Help` are what a person chooses.

    Raises
    ------
    ConfigError
        If a number cannot be used.
    """

    within_deg: Annotated[
        float,
        Help(
            "How far the target may be from the image plane before the probe turns, in degrees: the sensitive range of "
            "the target, to either side."
        ),
    ] = 1.0
    speed_deg_s: Annotated[float, Help("Largest speed of the probe, in degrees per second.")] = 5.0
    minutes: Annotated[float, Help("Time for which it may follow, in minutes; then a person must renew it.")] = 10.0
    rest_s: Annotated[float, Help("Least rest between two turns, in seconds.")] = 0.1
    pulses: Annotated[int, Help("Pulses of one look at a laser spot.", least=1)] = 4
    light_while_waiting: Annotated[
        bool,
        Help(
            "Look for a laser spot that is lost once a second, instead of waiting in the dark until somebody says that "
            "it is set."
        ),
    ] = False
    looks_per_second: Annotated[float, Help("Looks at a laser spot within a second, at most.")] = 3.0

    def __post_init__(self) -> None:
        require_range("within_deg", self.within_deg, low=LEAST_WITHIN_DEG, high=20, unit="deg")
        require_range("speed_deg_s", self.speed_deg_s, low=0.1, high=100, unit="deg/s")
        require_range("minutes", self.minutes, low=0.01, high=60, unit="min")
        require_range("rest_s", self.rest_s, low=0, high=10, unit="s")
        require_range("looks_per_second", self.looks_per_second, low=0.1, high=10, unit="1/s")
        self.permit(Interval(low_deg=-1, high_deg=1), lit=True)

    def permit(self, angles: Interval, *, lit: bool) -> FollowPermit:
        """Return the permit that it needs from the guard; ``lit``: whether the target is seen by the laser's light."""
        pulses = self.pulses if lit else 0
        return FollowPermit(
            angles=angles,
            speed_deg_s=self.speed_deg_s,
            duration_s=60 * self.minutes,
            pulses=pulses,
            pulses_per_second=round(pulses * (self.looks_per_second + 1)),
        )
