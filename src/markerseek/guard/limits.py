"""The angles that may be searched, and those at which the probe may be. Out of range is refused, never clamped."""

from __future__ import annotations

import msgspec

from markerseek.core import PAPER_RANGE, ConfigError, Interval, LimitError, is_finite


class Limits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The two ranges of a rig."""

    search: Interval = PAPER_RANGE
    """Angles at which a policy may ask for an acquisition."""
    travel: Interval = Interval(low_deg=-36.5, high_deg=36.5)
    """Angles at which the probe may be at all: the search range, and room to approach it from one side."""

    def __post_init__(self) -> None:
        if not (self.search.low_deg in self.travel and self.search.high_deg in self.travel):
            raise ConfigError(
                f"limits: the search range {self.search} leaves the travel range {self.travel}; "
                "widen the travel range or narrow the search range"
            )

    def require_search(self, angle_deg: float) -> None:
        """Refuse an angle that is no number or outside the search range by a `LimitError`, before anything moves."""
        if angle_deg not in self.search:
            raise LimitError(
                f"angle {_degrees(angle_deg)} is outside the search range {self.search}; nothing was moved; "
                "ask for an angle inside"
            )

    def require_travel(self, readback_deg: float) -> None:
        """Refuse a readback that is no number or outside the travel range by a `LimitError`."""
        if readback_deg not in self.travel:
            raise LimitError(
                f"the stage reads {_degrees(readback_deg)}, outside its travel range {self.travel}; "
                "check the probe and the stage's zero"
            )


def _degrees(value: float) -> str:
    """Return the text of an angle as the device or the caller gave it, which may be no number at all."""
    number = is_finite(value) or isinstance(value, float)
    return f"{float(value):g} deg" if number else f"a {type(value).__name__} (no angle)"
