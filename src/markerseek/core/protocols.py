"""What the parts of a rig must be able to do: protocols of one to four verbs.

Angles are in degrees, times in seconds. A part that cannot do what it is asked raises a
`DeviceError`; it never returns something else instead.
"""

from __future__ import annotations

from typing import Protocol

from markerseek.core.estimate import Estimate
from markerseek.core.frame import Frame
from markerseek.core.interval import Interval
from markerseek.core.permit import Permit
from markerseek.core.reading import Reading, Sample


class Policy(Protocol):
    """Decides where to look next. The caller owns the loop."""

    def ask(self) -> float | None:
        """Next angle in degrees, or None when the search is over; asking twice changes nothing."""

    def tell(self, sample: Sample) -> None:
        """Take in one sample; its angle is the one reached."""

    def estimate(self) -> Estimate:
        """What is known now; at any time, also before the first sample."""


class Clock(Protocol):
    """Time on a rig, real or virtual."""

    def now_s(self) -> float:
        """Seconds since some fixed moment; never runs backwards."""

    def wait(self, duration_s: float) -> None:
        """Return when that many seconds have gone by."""


class Stage(Protocol):
    """Turns the probe."""

    @property
    def angle_deg(self) -> float:
        """Readback of the angle, now."""

    @property
    def limits(self) -> Interval:
        """Angles that the stage itself accepts."""

    def move_to(self, angle_deg: float) -> float:
        """Go there, come to rest, and return the angle read back."""

    def stop(self) -> None:
        """Stop at once; allowed at any time, also twice."""


class Laser(Protocol):
    """Makes sound. There is no "on"."""

    def fire(self, permit: Permit) -> int:
        """Fire at most the permitted pulses and return how many were."""

    def disarm(self) -> None:
        """Give up any permit still held; allowed at any time, also twice."""


class Receiver(Protocol):
    """Hears sound."""

    def settle(self) -> None:
        """Wait until nothing of an earlier acquisition can arrive; `AcquisitionError` names what arrived meanwhile."""

    def arm(self, permit: Permit) -> None:
        """Get ready for the trigger that the laser will give."""

    def acquire(self, permit: Permit) -> Frame:
        """Frame of the trigger that was given since `arm`."""


class Reader(Protocol):
    """Turns a frame into what it says."""

    def read(self, frame: Frame) -> Reading:
        """Features of the frame."""
