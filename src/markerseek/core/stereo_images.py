"""Images of both cameras of a stereo endoscope, and the protocol of their sources."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from markerseek.core.shapes import CHECKED, UInt8

if TYPE_CHECKING or CHECKED:
    import numpy as np

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


@runtime_checkable
class StereoImages(Protocol):
    """A source of image pairs."""

    @property
    def name(self) -> str:
        """What the pairs come from, for messages: "folders left and right"."""

    def newest(self) -> list[StereoPair]:
        """Pairs that came since the last call, the oldest first, at most `MAX_PAIRS`; returns soon, also without any.

        Raises `DeviceError` with cause and cure if the source has ended or failed.
        """

    def close(self) -> None:
        """Release what it holds; allowed twice."""
