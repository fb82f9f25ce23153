"""Photoacoustic, B-mode and stereo images: positions of their pixels, elements of the array, sources of image pairs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias, runtime_checkable

import msgspec

from markerseek.core.checks import is_finite
from markerseek.core.errors import ConfigError
from markerseek.core.shapes import CHECKED, Float32, Float64, UInt8

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
        Positions of the columns along the array from its centre, and of the rows from the array's face, in metres.
    """

    envelope: Float32[np.ndarray, "depths laterals"]
    lateral_m: Float64[np.ndarray, " laterals"]
    depth_m: Float64[np.ndarray, " depths"]

    @property
    def geometry(self) -> ScanGeometry:
        """Positions of the pixels."""
        return ScanGeometry(
            first_lateral_m=float(self.lateral_m[0]),
            lateral_step_m=float(self.lateral_m[-1] - self.lateral_m[0]) / max(1, len(self.lateral_m) - 1),
            first_depth_m=float(self.depth_m[0]),
            depth_step_m=float(self.depth_m[-1] - self.depth_m[0]) / max(1, len(self.depth_m) - 1),
        )


class ScanGeometry(msgspec.Struct, frozen=True, kw_only=True):
    """Positions of the pixels of an image, the same for B-mode and photoacoustic images.

    Lateral positions count along the array from its centre, depths from its face. Row and column numbers may be
    fractions; pixel 0 is centred on the first position.

    Attributes
    ----------
    first_lateral_m, first_depth_m
        Position of pixel (0, 0) in metres.
    lateral_step_m, depth_step_m
        Distance from one column, and from one row, to the next in metres.

    Raises
    ------
    ConfigError
        If a position is not finite, or a step not positive.
    """

    first_lateral_m: float
    lateral_step_m: float
    first_depth_m: float
    depth_step_m: float

    def __post_init__(self) -> None:
        for name in ("first_lateral_m", "first_depth_m"):
            if not is_finite(getattr(self, name)):
                raise ConfigError(f"scan geometry: {name} is {getattr(self, name)} m, it must be finite")
        for name in ("lateral_step_m", "depth_step_m"):
            if not 0 < getattr(self, name) < math.inf:
                raise ConfigError(
                    f"scan geometry: {name} is {getattr(self, name)} m, it must be positive; 0.1 mm is usual"
                )

    @property
    def grid(self) -> dict[str, float]:
        """Centre of the first column and row, and the steps, in metres, under their names in messages and exports."""
        return {
            "first_lateral_m": self.first_lateral_m,
            "first_depth_m": self.first_depth_m,
            "lateral_spacing_m": self.lateral_step_m,
            "depth_spacing_m": self.depth_step_m,
        }

    def position_m(self, *, row: float, column: float) -> tuple[float, float]:
        """Return the lateral position and depth of a pixel, in metres."""
        return (
            self.first_lateral_m + column * self.lateral_step_m,
            self.first_depth_m + row * self.depth_step_m,
        )

    def pixel(self, *, lateral_m: float, depth_m: float) -> tuple[float, float]:
        """Return the row and column of a position in metres, not rounded."""
        return (
            (depth_m - self.first_depth_m) / self.depth_step_m,
            (lateral_m - self.first_lateral_m) / self.lateral_step_m,
        )

    def edges_mm(self, rows: int, columns: int) -> tuple[float, float, float, float]:
        """Return the outer edges of an image in millimetres: left, right, bottom (deepest), top."""
        left, top = self.position_m(row=-0.5, column=-0.5)
        right, bottom = self.position_m(row=rows - 0.5, column=columns - 0.5)
        return 1e3 * left, 1e3 * right, 1e3 * bottom, 1e3 * top


class LinearArray(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Evenly spaced elements in a row, whose centre is the lateral position 0.

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


MAX_PAIRS = 50
"""Most pairs that a source keeps until it is asked for them; older pairs are dropped."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StereoPair:
    """An image of each camera, taken at about the same time."""

    left: UInt8[np.ndarray, "rows columns"]
    """Image of the left camera: of each pixel the brightest colour."""
    right: UInt8[np.ndarray, "rows columns"]
    """Image of the right camera."""
    at_s: float
    """Time at which both images were there: monotonic seconds of this computer; with a simulated endoscope, time on the
    clock of its rig."""


Side: TypeAlias = Literal["left", "right"]
"""One of the two cameras of a stereo endoscope."""


@runtime_checkable
class StereoImages(Protocol):
    """A source of image pairs."""

    @property
    def name(self) -> str:
        """What the pairs come from, for messages: "folders a (left) and b (right)"."""

    def newest(self) -> list[StereoPair]:
        """Return the pairs that came since the last call, the oldest first, at most `MAX_PAIRS`.

        Returns soon, also without any.

        Raises `DeviceError` with cause and cure if the source has ended or failed.
        """

    def close(self) -> None:
        """Release what it holds; allowed twice."""
