"""How far tissue is displaced from where it rests, as something outside the search sees it."""

from __future__ import annotations

import msgspec

from markerseek.core.checks import is_finite
from markerseek.core.errors import ConfigError
from markerseek.core.vectors import Matrix, Vector


class Displacement(msgspec.Struct, frozen=True, kw_only=True):
    """Displacement of the tissue at the marker from where it rests between two breaths, in the TRUS frame.

    Attributes
    ----------
    mm
        Along x, y (the axis of rotation) and z, in mm.
    covariance_mm2
        Covariance of its error, in mm².

    Raises
    ------
    ConfigError
        If a number is not finite, or a variance is negative.
    """

    mm: Vector
    covariance_mm2: Matrix

    def __post_init__(self) -> None:
        if not all(is_finite(each) for row in (self.mm, *self.covariance_mm2) for each in row):
            raise ConfigError(
                f"displacement: it is {self.mm} mm with the covariance {self.covariance_mm2} mm², its numbers must be "
                "finite"
            )
        for number, axis in enumerate("xyz"):
            variance_mm2 = self.covariance_mm2[number][number]
            if variance_mm2 < 0:
                raise ConfigError(
                    f"displacement: its variance along {axis} is {variance_mm2} mm², it must be at least 0"
                )
