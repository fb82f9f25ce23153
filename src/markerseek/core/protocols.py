"""Protocols of the parts of a rig: one to four methods each.

Angles are in degrees, times in seconds. A part that cannot do what it is asked raises a
`DeviceError`; it never returns something else instead.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from markerseek.core.estimate import Estimate
from markerseek.core.frame import Frame
from markerseek.core.interval import Interval
from markerseek.core.permit import Permit
from markerseek.core.reading import Reading, Sample
from markerseek.core.sweep import Sweep


@runtime_checkable
class Policy(Protocol):
    """Chooses the next angle. The caller owns the loop."""

    def ask(self) -> float | None:
        """Next angle in degrees, or None when the search is over; asking twice changes nothing."""

    def tell(self, sample: Sample) -> None:
        """Receive one sample; its angle is the one reached."""

    def estimate(self) -> Estimate:
        """Present answer; allowed at any time, also before the first sample."""


@runtime_checkable
class SweepingPolicy(Protocol):
    """A policy that may ask for a sweep instead of an angle; every `Policy` is one that never does.

    During a sweep it is told each sample as it comes. The sweep goes on while `ask` returns an equal `Sweep`; anything
    else ends it: the light first, then the probe brakes.
    """

    def ask(self) -> float | Sweep | None:
        """Next angle in degrees or next sweep, or None when the search is over; asking twice changes nothing."""

    def tell(self, sample: Sample) -> None:
        """Receive one sample; its angle is the one reached."""

    def estimate(self) -> Estimate:
        """Present answer; allowed at any time, also before the first sample."""


@runtime_checkable
class ConfirmablePolicy(Policy, Protocol):
    """A policy that weighs the acquisition at the angle found, and may go on with the search after it."""

    def confirm(self, sample: Sample) -> None:
        """Receive the acquisition at the angle of its answer; `ask` then says whether the search goes on."""


@runtime_checkable
class Clock(Protocol):
    """Time on a rig, real or virtual."""

    def now_s(self) -> float:
        """Seconds since some fixed moment; never runs backwards."""

    def wait(self, duration_s: float) -> None:
        """Return when that many seconds have gone by."""


@runtime_checkable
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


@runtime_checkable
class Laser(Protocol):
    """Fires pulses of light. There is no "on"."""

    def fire(self, permit: Permit) -> int:
        """Fire at most the permitted pulses and return how many were fired."""

    def disarm(self) -> None:
        """Give up any permit still held; allowed at any time, also twice."""


@runtime_checkable
class Receiver(Protocol):
    """Records the sound that the laser's pulses make."""

    def settle(self) -> None:
        """Wait until nothing of an earlier acquisition can arrive; `AcquisitionError` names what arrived meanwhile."""

    def arm(self, permit: Permit) -> None:
        """Get ready for the trigger that the laser will give."""

    def acquire(self, permit: Permit) -> Frame:
        """Frame of the trigger that was given since `arm`."""


@runtime_checkable
class Reader(Protocol):
    """Computes the reading of a frame."""

    def read(self, frame: Frame) -> Reading:
        """Features of the frame."""
