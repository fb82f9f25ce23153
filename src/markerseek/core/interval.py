"""A closed interval of probe angles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import SupportsFloat

import msgspec

from markerseek.core.checks import is_finite
from markerseek.core.errors import ConfigError


class Interval(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Angles from ``low_deg`` to ``high_deg``, both included.

    Attributes
    ----------
    low_deg, high_deg
        The two ends in degrees; finite, the first below the second.

    Raises
    ------
    ConfigError
        If an end is not finite or the two are in the wrong order.
    """

    low_deg: float
    high_deg: float

    def __post_init__(self) -> None:
        if not (is_finite(self.low_deg) and is_finite(self.high_deg)):
            raise ConfigError(f"interval [{self.low_deg}, {self.high_deg}] deg: both ends must be finite numbers")
        if not self.low_deg < self.high_deg:
            raise ConfigError(
                f"interval [{self.low_deg}, {self.high_deg}] deg: the low end must lie below the high end; swap them?"
            )

    @property
    def width_deg(self) -> float:
        """Distance between the ends in degrees."""
        return self.high_deg - self.low_deg

    @property
    def centre_deg(self) -> float:
        """Middle of the interval in degrees."""
        return (self.low_deg + self.high_deg) / 2

    def nearest(self, angle_deg: float) -> float:
        """Return the angle of the interval that is nearest: for answers. What a rig is asked for is refused instead."""
        return min(max(angle_deg, self.low_deg), self.high_deg)

    def __contains__(self, angle_deg: object) -> bool:
        """Whether the angle lies inside or on an end; NaN, and what is no real number, never does."""
        # is_finite first: comparing text or an array would raise, and every limit of the rig is checked here.
        return is_finite(angle_deg) and bool(self.low_deg <= angle_deg <= self.high_deg)

    def __str__(self) -> str:
        return f"[{self.low_deg:g}, {self.high_deg:g}] deg"


def as_interval(ends_deg: Interval | Sequence[SupportsFloat], *, name: str) -> Interval:
    """Return the interval of two angles, given as such or as any two numbers, low end first.

    ``name``: name of the argument, for the message.
    """
    if isinstance(ends_deg, Interval):
        return ends_deg
    # Unpacking refuses one and three values; float() refuses text that is no number.
    try:
        low_deg, high_deg = map(float, ends_deg)
    except (TypeError, ValueError) as problem:
        raise ConfigError(
            f"{name} is {ends_deg!r}, two angles in degrees are needed, as in {name}=(-35, 35)"
        ) from problem
    return Interval(low_deg=low_deg, high_deg=high_deg)


PAPER_RANGE = Interval(low_deg=-35.0, high_deg=35.0)
"""The rotation range of the paper (section 2.2)."""
