"""A photoacoustic image: output of the imaging chain, input of pictures and exports."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from markerseek.core.shapes import CHECKED, Float32, Float64

if TYPE_CHECKING or CHECKED:
    import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PaImage:
    """Envelope image of one frame.

    Attributes
    ----------
    envelope
        Shape (depths, laterals), in ADC counts.
    lateral_m, depth_m
        Its columns and rows in metres: along the array from its centre, and from the array's face.
    """

    envelope: Float32[np.ndarray, "depths laterals"]
    lateral_m: Float64[np.ndarray, " laterals"]
    depth_m: Float64[np.ndarray, " depths"]
