"""Where the light of a spot is absorbed: a camera sees the spot, and the probe hears the source below it."""

from __future__ import annotations

from typing import Annotated

import msgspec

from markerseek.core.checks import Within, require_fields


class SpotToSource(msgspec.Struct, frozen=True, kw_only=True):
    """Where light is absorbed, seen from the visible spot that it makes."""

    offset_sigma_m: Annotated[float, Within(0, 5e-3, "m", cure="0.0002 is usual")] = 0.2e-3
    """Usual standard deviation, along each direction, of the vector from spot to source of one marker: light spreads
    before it is absorbed. The registration estimates it from all markers, beginning with this value."""
    depth_m: Annotated[float, Within(0, 20e-3, "m", cure="0.0003 is usual")] = 0.3e-3
    """Mean depth of the source below the spot, along the line of sight of the left camera."""
    depth_sigma_m: Annotated[float, Within(0, 20e-3, "m", cure="0.0003 is usual")] = 0.3e-3
    """Standard deviation of that depth, which all markers share."""

    def __post_init__(self) -> None:
        require_fields(self, "spot")
