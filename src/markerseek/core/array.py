"""Geometry of a linear array: the part that the forward model and the imaging chain share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from markerseek.core.errors import ConfigError
from markerseek.core.shapes import CHECKED, Float64

if TYPE_CHECKING or CHECKED:
    import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearArray:
    """Elements in a row, evenly spaced, centred on the middle of the image.

    Attributes
    ----------
    elements
        Number of elements.
    pitch_m
        Distance from one element's centre to the next, in metres.
    """

    elements: int = 128
    pitch_m: float = 0.43e-3

    def __post_init__(self) -> None:
        if not 2 <= self.elements <= 4096:
            raise ConfigError(f"array: elements is {self.elements}, it must lie between 2 and 4096 to form an image")
        if not 1e-6 <= self.pitch_m <= 0.1:
            raise ConfigError(f"array: pitch_m is {self.pitch_m} m, it must lie between 1e-6 and 0.1 m")

    @property
    def lateral_m(self) -> Float64[np.ndarray, " elements"]:
        """Centre of each element along the array, in metres."""
        # Imported here: NumPy takes a tenth of a second to import, and ``markerseek --help`` needs none of it.
        import numpy as np

        from_middle: Float64[np.ndarray, " elements"] = np.arange(self.elements) - (self.elements - 1) / 2
        return from_middle * self.pitch_m
