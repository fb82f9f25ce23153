"""The way to an angle that leaves the play of the gears on the same side always. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import Interval

UP, DOWN = 1, -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """Where to go one after the other, and how the last place is arrived at.

    Attributes
    ----------
    stops_deg
        Places to go to, in degrees; none if the stage stands there, pushed from the right side.
    direction
        `UP` if the last is arrived at from below, `DOWN` if from above.
    reversed
        Whether that is not the usual side, for want of room.
    """

    stops_deg: tuple[float, ...]
    direction: int
    reversed: bool


def plan_approach(
    target_deg: float,
    *,
    here_deg: float,
    pushed: int | None,
    usual: int,
    room_deg: float,
    travel: Interval,
    same_deg: float,
) -> Approach:
    """Way to a target.

    Parameters
    ----------
    target_deg, here_deg
        Where to go, and where the stage stands, in degrees.
    pushed
        Direction in which the gears were last pushed, `UP` or `DOWN`; None if unknown.
    usual
        Direction in which targets are arrived at.
    room_deg
        Length of the way that takes up the play, in degrees.
    travel
        Angles at which the stage may be.
    same_deg
        Two angles no further apart than this are one, in degrees.
    """
    direction = usual if target_deg - usual * room_deg in travel else -usual
    way_deg = direction * (target_deg - here_deg)
    if pushed == direction and abs(way_deg) <= same_deg:
        stops: tuple[float, ...] = ()
    elif way_deg >= (0 if pushed == direction else room_deg):
        stops = (target_deg,)
    else:
        stops = (target_deg - direction * room_deg, target_deg)
    return Approach(stops_deg=stops, direction=direction, reversed=direction != usual)
