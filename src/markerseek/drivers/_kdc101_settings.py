"""Settings of a rotation stage: the keys of a rig file, and those that only the driver uses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from markerseek.core import ConfigError, Interval, require_range


@dataclass(frozen=True, slots=True, kw_only=True)
class Kdc101Keys:
    """Keys of a rotation stage in a rig file; angles are the probe's unless they are called the stage's own."""

    zero_deg: float = 0.0
    """The stage's own reading at which the probe points at 0."""
    direction: Literal["forward", "reverse"] = "forward"
    """How the probe is mounted: "forward" if its angle grows with the stage's own reading, "reverse" if it falls. The
    default is an assumption: ``markerseek doctor --rig RIG.toml --source-deg ANGLE`` tests it."""
    serial_number: int | None = None
    """Serial number that the controller must have; None accepts any."""
    speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    """``speed_deg_s`` and ``acceleration_deg_s2``: speed and acceleration of its moves, in degrees per second and per
    second squared; at most 25."""
    approach_from: Literal["below", "above"] = "below"
    approach_deg: float = 1.0
    """``approach_from`` and ``approach_deg``: side, by the probe's angle, from which every target is approached, and
    over what distance, in degrees: longer than the gears' play."""
    begin_s: float = 0.5
    """Time without motion after which it counts as stuck."""
    age_s: float = 0.3
    """Greatest age of the controller's answer."""

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("zero_deg", -360, 360, "deg"),
            ("speed_deg_s", 0.1, 25, "deg/s"),
            ("acceleration_deg_s2", 0.1, 25, "deg/s²"),
            ("approach_deg", 0.01, 5, "deg"),
            ("begin_s", 0.1, 5, "s"),
            ("age_s", 0.01, 1, "s"),
        ):
            require_range(f"stage: {name}", getattr(self, name), low=low, high=high, unit=unit)
        if self.approach_from not in ("below", "above"):
            raise ConfigError(f"stage: approach_from is {self.approach_from!r}, it must be 'below' or 'above'")
        if self.direction not in ("forward", "reverse"):
            raise ConfigError(f"stage: direction is {self.direction!r}, it must be 'forward' or 'reverse'")


@dataclass(frozen=True, slots=True, kw_only=True)
class Kdc101DriverSettings(Kdc101Keys):
    """Settings of the driver: the keys of a rig file, the travel range, and how a move is made and checked."""

    travel: Interval = field(default_factory=lambda: Interval(low_deg=-36.5, high_deg=36.5))
    """Angles at which the probe may be, in degrees; written to the controller as its soft limits."""
    lead_deg: float = 5.0
    renew_s: float = 0.1
    """``lead_deg`` and ``renew_s``: how far ahead a target may be, in degrees, and how often it is renewed, in
    seconds."""
    arrival_deg: float = 0.01
    """Largest distance from its target at which the stage counts as arrived."""
    unexpected_deg: float = 0.2
    """Largest distance from where it should be on its way, and at rest."""
    answer_s: float = 0.1
    """Time for an answer before the request is repeated."""

    @property
    def sense(self) -> int:
        """1 if the probe's angle grows with the stage's own reading, -1 if it falls."""
        return 1 if self.direction == "forward" else -1

    def __post_init__(self) -> None:
        # Without arguments, super() does not work in a dataclass with slots, which is made a second time.
        Kdc101Keys.__post_init__(self)
        for name, low, high, unit in (
            ("lead_deg", 0.5, 5, "deg"),
            ("renew_s", 0.02, 0.5, "s"),
            ("arrival_deg", 0.001, 0.1, "deg"),
            ("unexpected_deg", 0.05, 1, "deg"),
            ("answer_s", 0.01, 1, "s"),
        ):
            require_range(f"stage: {name}", getattr(self, name), low=low, high=high, unit=unit)
        if not 2 * self.approach_deg <= self.travel.width_deg <= 359:
            raise ConfigError(
                f"stage: the travel range {self.travel} must be at least twice approach_deg ({self.approach_deg} deg) "
                "wide, and less than a turn"
            )
