"""Approach of a target always from the same side, so that the backlash of the gears does not matter. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core import Interval

UP, DOWN = 1, -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """Angles to go to in turn, and the direction of the last move."""

    stops_deg: tuple[float, ...]
    """Angles to go to; none if the stage is there already, approached from the right side."""
    direction: int
    """`UP` if the last is approached from below, `DOWN` if from above."""
    reversed: bool
    """Whether that is not the usual side, because the travel range ends too soon."""


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
    """Plan the approach of a target.

    ``target_deg``, ``here_deg``: target, and present angle of the stage. ``pushed``: direction of the last move, `UP`
    or `DOWN`; None if unknown. ``usual``: direction of the last move towards any target. ``room_deg``: length of a move
    that takes up the backlash. ``travel``: angles at which the stage may be. ``same_deg``: angles no further apart than
    this count as equal.
    """
    direction = usual if target_deg - usual * room_deg in travel else -usual
    # From a shorter distance, or from the other side, the gears would not yet be pushed when the target is reached.
    way_deg = direction * (target_deg - here_deg)
    if pushed == direction and abs(way_deg) <= same_deg:
        stops: tuple[float, ...] = ()
    elif way_deg >= (0 if pushed == direction else room_deg):
        stops = (target_deg,)
    else:
        stops = (target_deg - direction * room_deg, target_deg)
    return Approach(stops_deg=stops, direction=direction, reversed=direction != usual)
