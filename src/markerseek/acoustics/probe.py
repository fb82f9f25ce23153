"""Geometry of the probe: a row of elements behind a lens, at some distance from the axis of rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from markerseek.acoustics._checks import positive
from markerseek.core import ConfigError, LinearArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """Side-fire linear array, its row parallel to the axis that it turns about."""

    array: LinearArray = field(default_factory=LinearArray)
    """Number and pitch of the elements."""
    element_width_m: float = 0.39e-3
    """Extent of an element along the row; at most the pitch."""
    element_height_m: float = 5e-3
    """Extent of an element across the row (elevation)."""
    elevation_focus_m: float | None = 30e-3
    """Distance at which the lens focuses in elevation; None without a lens."""
    face_radius_m: float = 10e-3
    """Distance R of the face from the axis of rotation."""

    def __post_init__(self) -> None:
        positive(self.element_width_m, name="probe: element_width_m", unit="m", cure="0.9 of the pitch is usual")
        positive(self.element_height_m, name="probe: element_height_m", unit="m", cure="3 to 6 mm are usual")
        positive(self.face_radius_m, name="probe: face_radius_m", unit="m", cure="8 to 12 mm are usual")
        if self.element_width_m > self.array.pitch_m:
            raise ConfigError(
                f"probe: element_width_m is {self.element_width_m} m, the elements would overlap: "
                f"it must be at most the pitch of {self.array.pitch_m} m"
            )
        if self.elevation_focus_m is not None:
            positive(
                self.elevation_focus_m,
                name="probe: elevation_focus_m",
                unit="m",
                cure="20 to 40 mm are usual, None is a probe without a lens",
            )

    def in_probe_frame(self, *, radius_m: float, off_plane_deg: float) -> tuple[float, float]:
        """Where a point lies as seen from the face: offset in elevation and distance from the face's plane, in metres.

        With t the angle from the image plane to the point these are ρ sin t and ρ cos t − R.

        ``radius_m``: distance ρ of the point from the axis of rotation. ``off_plane_deg``: angle t of the image plane
        less that of the point.
        """
        turned = math.radians(off_plane_deg)
        return radius_m * math.sin(turned), radius_m * math.cos(turned) - self.face_radius_m
