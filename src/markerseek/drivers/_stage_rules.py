"""The verbs of a stage, what a stage says of itself, and the rules by which it is moved and checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

from markerseek.core import MAX_AHEAD_DEG, MAX_RESOLUTION_DEG, Within, require_fields

RENEW_S = 0.1
"""How often a target is renewed, in seconds."""

TOO_FAST = 1.25
"""Share of speed and acceleration set that is put down to the servo and to the age of two readings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageStatus:
    """What a stage says of itself."""

    angle_deg: float
    """Angle of the probe by the stage's own encoder or count, in degrees."""
    moving: bool = False
    """Whether the stage says that it moves; some deny it for a moment after a command."""
    problem: str = ""
    """Why the stage must not be used, with its cure; empty if all is well. It is asked a second time before this is
    believed."""
    since_s: float | None = None
    """Earliest time at which the angle can have been taken, in seconds of the clock; None: when it was asked for."""
    cure: str = "look for an obstacle"
    """What to do where the stage does not move."""


class StageLogic(Protocol):
    """The verbs of a stage, in degrees of the probe. Each returns at once; waiting and checking is `StandardStage`'s.

    A class may have the attributes ``emulated``, whether it is no real device, and ``description``.
    """

    def read(self) -> StageStatus:
        """Return what the stage says now."""

    def go(self, angle_deg: float) -> float | None:
        """Begin to turn to an angle; it is called on the way again, with the next target.

        Returns when the command was sent, in seconds of the clock; None: when this was called.
        """

    def stop(self) -> None:
        """Begin to stop; it is called again until the stage is at rest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageRules:
    """How a stage is moved and checked; angles in degrees of the probe."""

    speed_deg_s: Annotated[float, Within(0, 1e4, "deg/s", open_low=True)]
    """Speed of its moves, as the stage keeps it."""
    acceleration_deg_s2: float | None = None
    """Its acceleration, as the stage keeps it; None: not known, and only the speed is checked."""
    resolution_deg: Annotated[float, Within(0, MAX_RESOLUTION_DEG, "deg", open_low=True)]
    """Step of its readback; two readings at rest differ by two steps at most."""
    arrival_deg: Annotated[float, Within(0, 0.2, "deg", open_low=True)] = 0.01
    """Largest distance from its target at which it counts as arrived."""
    unexpected_deg: float = 0.2
    """Largest distance from where it should be on its way, and at rest."""
    unsteady_deg: float = 0.0105
    """How far a servo may be ahead of its set point, at any speed."""
    settle_deg: float = 0.0
    """How far a servo may be off the angle at which it comes to rest, until it has settled."""
    begin_s: Annotated[float, Within(0, 60, "s", open_low=True)] = 0.5
    """Time without motion after which it counts as stuck, in seconds."""
    brake_s: float = 0.0
    """Time that it takes to come to rest after a stop, in seconds."""
    approach_from: Literal["below", "above"] = "below"
    approach_deg: float = 0.0
    """``approach_from`` and ``approach_deg``: side from which every target is approached, and over what distance."""

    def __post_init__(self) -> None:
        require_fields(self, "stage")

    @property
    def same_deg(self) -> float:
        """Most by which two readings at rest differ."""
        return 2.01 * self.resolution_deg

    @property
    def ramp_s(self) -> float:
        """Time to its full speed."""
        return 0.0 if self.acceleration_deg_s2 is None else self.speed_deg_s / self.acceleration_deg_s2

    def longest_s(self, way_deg: float) -> float:
        """Return the longest time that a move of that length may take, in seconds."""
        # A fast stage waits for its next target.
        speed_deg_s = min(self.speed_deg_s, MAX_AHEAD_DEG / (2 * RENEW_S))
        return 2 * (way_deg / speed_deg_s + self.ramp_s) + 2 * self.begin_s

    def reach_deg(self, duration_s: float) -> float:
        """Return the farthest that a motor gets from rest in that time, with what it may exceed its settings by."""
        ramp_s = min(duration_s, self.ramp_s)
        ramp_deg = 0.0 if self.acceleration_deg_s2 is None else self.acceleration_deg_s2 * ramp_s**2 / 2
        return TOO_FAST * (ramp_deg + self.speed_deg_s * (duration_s - ramp_s))
