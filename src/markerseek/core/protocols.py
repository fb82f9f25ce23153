"""Protocols of the parts of a rig; those of a sweep extend the plain ones.

Angles are in degrees, times in seconds. A part that cannot do what it is asked raises a
`DeviceError`; it never returns something else instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol, TypeAlias, runtime_checkable

import msgspec

from markerseek.core.displacement import Displacement
from markerseek.core.errors import SearchError
from markerseek.core.estimate import Ambiguous, AtBound, Estimate, Found, NotFound, Unsure
from markerseek.core.events import Searched, Turning
from markerseek.core.interval import Interval
from markerseek.core.permit import Permit, SweepPermit
from markerseek.core.reading import Frame, Reading, Sample
from markerseek.core.sweep import Pulse, StageReading, Sweep


@runtime_checkable
class Policy(Protocol):
    """Chooses the next angle. The caller owns the loop."""

    def ask(self) -> float | None:
        """Return the next angle in degrees, or None when the search is over; asking twice changes nothing."""

    def tell(self, sample: Sample) -> None:
        """Receive one sample; its angle is the one reached."""

    def estimate(self) -> Estimate:
        """Return the present answer; allowed at any time, also before the first sample."""


@runtime_checkable
class SweepingPolicy(Protocol):
    """A policy that may ask for a sweep instead of an angle.

    During a sweep it is told each sample as it comes. The sweep goes on while `ask` returns an equal `Sweep`; anything
    else ends it: the light first, then the probe brakes.
    """

    def ask(self) -> float | Sweep | None:
        """Return the next angle in degrees or next sweep, or None when the search is over.

        Asking twice changes nothing.
        """

    def tell(self, sample: Sample) -> None:
        """Receive one sample; its angle is the one reached."""

    def end_sweep(self) -> None:
        """Learn that the sweep is over, by itself or at its end, and that all its samples have been told.

        Its last sample does not say so: how far from the end the light goes out is a matter of the stage and the laser.
        """

    def estimate(self) -> Estimate:
        """Return the present answer; allowed at any time, also before the first sample."""


AnyPolicy: TypeAlias = Policy | SweepingPolicy
"""What a run takes."""


def estimate_of(policy: AnyPolicy) -> Estimate:
    """Return the present answer of a policy; `SearchError` if it returns none, for example without ``return``."""
    estimate: object = policy.estimate()
    if isinstance(estimate, Found | NotFound | Ambiguous | AtBound | Unsure):
        return _with_plain_numbers(estimate)
    kind = type(policy)
    raise SearchError(
        f"policy {kind.__module__}.{kind.__qualname__}: estimate() returned {estimate!r:.80}, it must return a Found, "
        "NotFound, Ambiguous, AtBound or Unsure of markerseek.core, also before the first sample"
    )


def _with_plain_numbers(estimate: Estimate) -> Estimate:
    """Return the answer with Python's numbers instead of NumPy's, which a user's own policy may put there."""
    try:
        msgspec.json.encode(estimate)
    except TypeError:
        return msgspec.convert(msgspec.to_builtins(estimate, enc_hook=_plain_number), type(estimate))
    return estimate


def _plain_number(value: Any) -> object:
    """Return the number in one of NumPy's, which this package is imported without."""
    if type(value).__module__ != "numpy" or getattr(value, "ndim", None) != 0:
        raise TypeError(f"{value!r:.80} is no number")
    return value.item()


@runtime_checkable
class ConfirmablePolicy(Policy, Protocol):
    """A policy that weighs the acquisition at the angle found, and may go on with the search after it."""

    def confirm(self, sample: Sample) -> None:
        """Receive the acquisition at the angle of its answer; `ask` then says whether the search goes on."""


@runtime_checkable
class RecordingPolicy(Policy, Protocol):
    """A policy that searches a recording, then takes its other angles, and answers from all of them."""

    @property
    def searched(self) -> Searched | None:
        """What the search took and said; None before its end."""


@runtime_checkable
class Clock(Protocol):
    """Time on a rig, real or virtual."""

    def now_s(self) -> float:
        """Return the seconds since some fixed moment; never runs backwards."""

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
class HandTurnedStage(Stage, Protocol):
    """A stage that a person turns: it asks, and waits until the angle is steady."""

    def guide(self, angle_deg: float) -> Iterator[Turning]:
        """Ask for an angle, and report where the probe is until it is there; a move there then returns at once."""


@runtime_checkable
class SweepingStage(Stage, Protocol):
    """A stage that reports where it is while it turns."""

    @property
    def fastest_sweep_deg_s(self) -> float:
        """Largest speed of a sweep in degrees per second: the stage's own."""

    @property
    def acceleration_deg_s2(self) -> float:
        """Acceleration at both ends of a sweep, in degrees per second squared."""

    def play_deg(self, forward: float) -> float:
        """Return the backlash in a sweep in that direction, 1 or -1, in degrees, by which the probe lags.

        0 in the direction in which it approaches the angle of a single acquisition.
        """

    def prepare_sweep(self, *, speed_deg_s: float) -> None:
        """Set the speed of a sweep; nothing moves."""

    def begin_sweep(self, to_deg: float) -> None:
        """Begin to turn there, the end of the permit, and return at once."""

    def read_sweep(self) -> StageReading:
        """Return where it is; a target that a line has lost is given again."""

    def brake(self) -> None:
        """Begin to brake, and return at once."""

    def end_sweep(self) -> None:
        """Restore the speed of moves, once it is at rest; allowed at any time, also twice."""


@runtime_checkable
class Laser(Protocol):
    """Fires pulses of light. There is no "on"."""

    def fire(self, permit: Permit) -> int:
        """Fire at most the permitted pulses and return how many were fired."""

    def disarm(self) -> None:
        """Give up any permit still held; allowed at any time, also twice."""


@runtime_checkable
class SweepingLaser(Laser, Protocol):
    """A laser that fires single pulses, each with its time."""

    @property
    def sweep_period_s(self) -> float:
        """Least time between two of its pulses, in seconds; `ConfigError` says why this laser cannot sweep."""

    @property
    def delay_sigma_s(self) -> float:
        """Standard deviation of the unknown delay between a pulse and its time, the same for all, in seconds."""

    @property
    def stamp_delay_s(self) -> float:
        """Time from the stamp of a pulse to its light as far as it is known, the same for all, in seconds."""

    def prepare_sweep(self) -> None:
        """Get ready, as far as that takes time: the probe does not turn yet."""

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Begin to fire the permitted pulses, one every ``permit.period_s``, and return at once."""

    def pulses(self) -> Sequence[Pulse]:
        """Return the pulses since the last call, in order."""

    def end_sweep(self) -> int:
        """End the light, and return how many pulses were fired in all; `pulses` returns those not reported yet."""


@runtime_checkable
class Receiver(Protocol):
    """Records the sound that the laser's pulses make."""

    def settle(self) -> None:
        """Wait until nothing of an earlier acquisition can arrive; `AcquisitionError` names what arrived meanwhile."""

    def arm(self, permit: Permit) -> None:
        """Get ready for the trigger that the laser will give."""

    def acquire(self, permit: Permit) -> Frame:
        """Return the frame of the trigger that was given since `arm`."""


@runtime_checkable
class SweepingReceiver(Receiver, Protocol):
    """A receiver that records one frame for each trigger of a sweep."""

    @property
    def frame_period_s(self) -> float:
        """Least time between two triggers that it can record, in seconds; `ConfigError` says why it cannot sweep."""

    @property
    def sweep_readout_s(self) -> float:
        """Time from the last trigger of a sweep to its frames, in seconds; 0 where they come while it turns."""

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Get ready for one trigger after the other."""

    def frames(self) -> Sequence[Frame]:
        """Return the frames that came since the last call, in the order of their triggers.

        There are none before the end of a sweep if the receiver is read at its end.
        """

    def end_sweep(self, *, pulses: int) -> Sequence[Frame]:
        """Return the frames that have not been returned yet; ``pulses``: number of pulses of the whole sweep.

        Dark triggers may have followed the pulses. A receiver that is read at the end averages their frames into one
        dark frame, and returns it last.
        """


@runtime_checkable
class Reader(Protocol):
    """Computes the reading of a frame."""

    def read(self, frame: Frame) -> Reading:
        """Return the features of the frame."""


@runtime_checkable
class FollowedTissue(Protocol):
    """The tissue around the marker, followed while it is searched, as by the two cameras of an endoscope.

    As long as the rotation between cameras and probe is not known, only the size of a displacement is known.
    `displacement` then returns 0, with an error of that size in every direction. In the pause between two breaths that
    error is small.
    """

    @property
    def known_after_s(self) -> float:
        """Time from a moment until its displacement is known, in seconds."""

    @property
    def breath_s(self) -> float | None:
        """Time from breath to breath in seconds; None if the tissue does not breathe, or that is not known."""

    @property
    def pause_s(self) -> float:
        """Time in seconds in which it rests between two breaths; 0 if that is not known."""

    def rests(self, for_s: float) -> bool | None:
        """Return whether it stays in its pause from now on, for so many seconds; None if that is not known.

        Tissue that does not move rests at any time.
        """

    def displacement(self, at_s: float) -> Displacement | None:
        """Return the displacement of the tissue at the marker at a moment of the rig's clock.

        None if it is not known.
        """
