"""What can go wrong in a search, done to a simulated rig: receivers that fail, markers that move or fade."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from markerseek.core import AcquisitionError, Frame, Permit, ReadingFrame, Receiver
from markerseek.sim import IntensityCurve


class FaultyReceiver:
    """A receiver between the real one and the program, which spoils what comes through.

    Parameters
    ----------
    inner
        The receiver that works.
    spoil
        What becomes of a frame, given its number from 0 and the frame before; that is None at first.
    """

    def __init__(self, inner: Receiver, spoil: Callable[[int, Frame, Frame | None], Frame]) -> None:
        self._inner = inner
        self._spoil = spoil
        self._count = 0
        self._previous: Frame | None = None

    def settle(self) -> None:
        """Settle the receiver behind."""
        self._inner.settle()

    def arm(self, permit: Permit) -> None:
        """Arm the receiver behind."""
        self._inner.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        """Frame of the receiver behind, spoilt."""
        frame = self._inner.acquire(permit)
        spoilt = self._spoil(self._count, frame, self._previous)
        self._count += 1
        self._previous = frame
        return spoilt


def _with_intensity(frame: Frame, change: Callable[[float], float]) -> Frame:
    if not isinstance(frame, ReadingFrame):
        raise AcquisitionError("this fault spoils intensities; the frame holds channel data")
    return replace(frame, intensity=change(frame.intensity))


def nan_at(number: int) -> Callable[[int, Frame, Frame | None], Frame]:
    """Fault: the frame of that number, counted from 0, has no intensity.

    Parameters
    ----------
    number
        Which.
    """
    return lambda count, frame, _: _with_intensity(frame, lambda _: math.nan) if count == number else frame


def nan_always(_count: int, frame: Frame, _previous: Frame | None) -> Frame:
    """Fault: no frame has an intensity."""
    return _with_intensity(frame, lambda _: math.nan)


def dead(_count: int, frame: Frame, _previous: Frame | None) -> Frame:
    """Fault: nothing is connected, all intensities are 0."""
    return _with_intensity(frame, lambda _: 0.0)


def late(_count: int, frame: Frame, previous: Frame | None) -> Frame:
    """Fault: each acquisition hands over the frame of the one before."""
    return frame if previous is None else previous


def clipped(level: float) -> Callable[[int, Frame, Frame | None], Frame]:
    """Fault: intensities end at a level.

    Parameters
    ----------
    level
        In the unit of the intensities.
    """
    return lambda _count, frame, _previous: _with_intensity(frame, lambda heard: min(heard, level))


@dataclass(slots=True, kw_only=True)
class ChangingCurve:
    """A curve that moves, or fades, from one acquisition to the next; it counts how often it is heard.

    Attributes
    ----------
    inner
        The curve at first.
    shift_deg
        Angle by which the marker has moved from acquisition number ``after`` on, in degrees.
    after
        See there.
    fading
        Factor on the intensity from each acquisition to the next; 1 does not fade.
    heard
        Acquisitions so far.
    """

    inner: IntensityCurve
    shift_deg: float = 0.0
    after: int = 0
    fading: float = 1.0
    heard: int = 0

    def peaks(self, off_plane_deg: float) -> Sequence[float]:
        """Heights of the peaks now; see `markerseek.sim.IntensityCurve`."""
        moved_deg = self.shift_deg if self.heard >= self.after else 0.0
        strength = self.fading**self.heard
        self.heard += 1
        return [strength * height for height in self.inner.peaks(off_plane_deg - moved_deg)]
