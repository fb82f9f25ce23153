"""How a rotation stage is used."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from markerseek.core import ConfigError, Interval


@dataclass(frozen=True, slots=True, kw_only=True)
class StageSettings:
    """How the stage is used; angles are the probe's unless they are called the stage's own.

    Attributes
    ----------
    travel
        Angles of the probe at which it may be, in degrees; written to the controller as its soft limits.
    zero_deg
        The stage's own reading at which the probe points at 0, in degrees.
    direction
        How the probe is mounted: "forward" if its angle grows with the stage's own reading, "reverse" if it falls.
    speed_deg_s, acceleration_deg_s2
        How it moves, in degrees per second and per second squared; at most 25.
    approach_from, approach_deg
        Side, by the probe's angle, from which every target is arrived at, and on how long a way, in degrees: longer
        than the gears' play.
    lead_deg, renew_s
        How far ahead a target may be, in degrees, and how often it is renewed, in seconds.
    arrival_deg
        How near to its target the stage must come, in degrees.
    unexpected_deg
        How far it may be from where it should be on its way, and at rest, in degrees.
    begin_s
        How long it may stand still before it is taken to be stuck, in seconds.
    answer_s, age_s
        How long the controller may take to answer before it is asked again, and how old an answer may be, in seconds.
    serial_number
        Which controller it must be; None takes any.
    """

    travel: Interval = field(default_factory=lambda: Interval(low_deg=-36.5, high_deg=36.5))
    zero_deg: float = 0.0
    direction: Literal["forward", "reverse"] = "forward"
    speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    approach_from: Literal["below", "above"] = "below"
    approach_deg: float = 1.0
    lead_deg: float = 5.0
    renew_s: float = 0.1
    arrival_deg: float = 0.01
    unexpected_deg: float = 0.2
    begin_s: float = 0.5
    answer_s: float = 0.1
    age_s: float = 0.3
    serial_number: int | None = None

    @property
    def sense(self) -> int:
        """1 if the probe's angle grows with the stage's own reading, -1 if it falls."""
        return 1 if self.direction == "forward" else -1

    def __post_init__(self) -> None:
        for name, low, high in (
            ("zero_deg", -360, 360),
            ("speed_deg_s", 0.1, 25),
            ("acceleration_deg_s2", 0.1, 25),
            ("approach_deg", 0.01, 5),
            ("lead_deg", 0.5, 5),
            ("renew_s", 0.02, 0.5),
            ("arrival_deg", 0.001, 0.1),
            ("unexpected_deg", 0.05, 1),
            ("begin_s", 0.1, 5),
            ("answer_s", 0.01, 1),
            ("age_s", 0.01, 1),
        ):
            if not low <= getattr(self, name) <= high:
                raise ConfigError(f"stage: {name} is {getattr(self, name)}, it must lie between {low} and {high}")
        if self.approach_from not in ("below", "above"):
            raise ConfigError(f"stage: approach_from is {self.approach_from!r}, it must be 'below' or 'above'")
        if self.direction not in ("forward", "reverse"):
            raise ConfigError(f"stage: direction is {self.direction!r}, it must be 'forward' or 'reverse'")
        if not 2 * self.approach_deg <= self.travel.width_deg <= 359:
            raise ConfigError(
                f"stage: the travel range {self.travel} must be at least twice approach_deg ({self.approach_deg} deg) "
                "wide, and less than a turn"
            )
