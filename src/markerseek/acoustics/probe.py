"""The probe: a row of elements of some height and width behind a lens, at some distance from the axis of rotation."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from markerseek.acoustics._checks import positive
from markerseek.core import ConfigError, LinearArray
from markerseek.core.shapes import Float64


@dataclass(frozen=True, slots=True, kw_only=True)
class Probe:
    """Side-fire linear array, its row parallel to the axis that it turns about.

    Attributes
    ----------
    array
        Number and pitch of the elements.
    element_width_m
        Extent of an element along the row, in metres; at most the pitch.
    element_height_m
        Extent of an element across the row (elevation), in metres.
    elevation_focus_m
        Distance at which the lens focuses in elevation, in metres; None without a lens.
    face_radius_m
        Distance R of the face from the axis of rotation, in metres.
    """

    array: LinearArray = field(default_factory=LinearArray)
    element_width_m: float = 0.39e-3
    element_height_m: float = 5e-3
    elevation_focus_m: float | None = 30e-3
    face_radius_m: float = 10e-3

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

    def lens_delay_m(self, elevation_m: Float64[np.ndarray, " points"]) -> Float64[np.ndarray, " points"]:
        """Path by which the lens shortens the way to a point of an element, in metres.

        It is sqrt(F² + η²) − F, so that sound from the focus reaches the whole height at once; 0 without a lens.

        Parameters
        ----------
        elevation_m
            Points η over the height, measured from its middle, in metres.
        """
        if self.elevation_focus_m is None:
            return np.zeros_like(elevation_m)
        shortened: Float64[np.ndarray, " points"] = np.hypot(self.elevation_focus_m, elevation_m)
        return shortened - self.elevation_focus_m

    def in_probe_frame(self, *, radius_m: float, off_plane_deg: float) -> tuple[float, float]:
        """Where a point lies as seen from the face: offset in elevation and distance from the face's plane, in metres.

        With t the angle from the image plane to the point these are ρ sin t and ρ cos t − R.

        Parameters
        ----------
        radius_m
            Distance ρ of the point from the axis of rotation, in metres.
        off_plane_deg
            Angle t of the image plane less that of the point, in degrees.
        """
        turned = math.radians(off_plane_deg)
        return radius_m * math.sin(turned), radius_m * math.cos(turned) - self.face_radius_m
