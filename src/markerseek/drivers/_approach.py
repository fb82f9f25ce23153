"""From where the stage approaches a target: always from the same side, where its travel range allows it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from markerseek.core import ConfigError, Interval, LimitError
from markerseek.guard import Limits

UP, DOWN = 1, -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Approach:
    """Angles to go to in turn: to the last always from the same side, so that the backlash does not matter."""

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


def require_inside(travel: Interval, angle_deg: float, *, then: str = "nothing was moved") -> None:
    """Refuse a target outside the travel range, and NaN, which is in no interval; ``then``: what was not done."""
    if angle_deg not in travel:
        raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {travel}; {then}")


def require_wide(travel: Interval, *, approach_deg: float) -> None:
    """Refuse a travel range in which no target could be approached from one side, or of a turn and more."""
    if not 2 * approach_deg <= travel.width_deg <= 359:
        raise ConfigError(
            f"stage: the travel range {travel} must be at least twice approach_deg ({approach_deg} deg) "
            "wide, and less than a turn"
        )


def require_room(limits: Limits, *, approach_from: Literal["below", "above"], approach_deg: float) -> None:
    """Refuse a search range whose ends cannot be approached from the usual side."""
    # Approached from the other side, an angle would be off by the backlash of the gears, and the marker with it.
    from_below = approach_from == "below"
    farthest_deg = limits.search.low_deg if from_below else limits.search.high_deg
    start_deg = farthest_deg - approach_deg if from_below else farthest_deg + approach_deg
    if start_deg not in limits.travel:
        raise ConfigError(
            f"stage: to arrive at {farthest_deg:g} deg from {approach_from} the stage must start at "
            f"{start_deg:g} deg, outside the travel range {limits.travel}; narrow limits.search, widen "
            "limits.travel, or shorten stage.approach_deg"
        )
