"""A bench with all devices in one class and a policy that visits given angles, for the tests of the scan."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest

from markerseek.core import (
    Asked,
    Event,
    Found,
    Frame,
    FrameHeader,
    Interval,
    Measured,
    NotFound,
    Permit,
    Reading,
    ReadingFrame,
    Sample,
)
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.scan import Scanner

FOUND = Found(
    mean_deg=4.0, sigma_deg=0.1, interval95_deg=Interval(low_deg=3.8, high_deg=4.2), interval_kind="propagated"
)


@dataclass
class Bench:
    """Stage, laser, receiver, reader and clock in one, with a log and some faults."""

    angle_deg: float = -35.0
    limits: Interval = field(default_factory=lambda: Interval(low_deg=-36.5, high_deg=36.5))
    log: list[str] = field(default_factory=list)
    short_by_deg: float = 0.0
    missing_pulses: int = 0
    bad_frames: int = 0
    intensity: float = 5.0
    time_s: float = 0.0
    sequence: int = 0

    def move_to(self, angle_deg: float) -> float:
        self.log.append(f"move {angle_deg:g}")
        self.angle_deg = angle_deg - self.short_by_deg
        self.time_s += 1.0
        return self.angle_deg

    def stop(self) -> None:
        self.log.append("stop")

    def settle(self) -> None:
        """Nothing of an earlier acquisition arrives."""

    def arm(self, permit: Permit) -> None:
        self.log.append("arm")

    def fire(self, permit: Permit) -> int:
        self.log.append(f"fire {permit.pulses}")
        return max(permit.pulses - self.missing_pulses, 0)

    def disarm(self) -> None:
        self.log.append("disarm")

    def acquire(self, permit: Permit) -> Frame:
        self.sequence += 1
        stale = self.bad_frames > 0
        self.bad_frames -= stale
        header = FrameHeader(
            sequence=self.sequence,
            token="old" if stale else permit.token,
            pulses=permit.pulses,
            commanded_deg=permit.angle_deg,
            started_s=self.time_s,
            ended_s=self.time_s,
        )
        return ReadingFrame(header=header, intensity=self.intensity + 0.01 * self.sequence)

    def read(self, frame: Frame) -> Reading:
        assert isinstance(frame, ReadingFrame)
        return Reading(intensity=frame.intensity)

    def now_s(self) -> float:
        return self.time_s

    def wait(self, duration_s: float) -> None:
        self.time_s += duration_s


class Tour:
    """Visits the angles given and then returns the estimate given."""

    def __init__(self, *angles_deg: float, answer: Found | NotFound = FOUND) -> None:
        self.left = list(angles_deg)
        self.samples: list[Sample] = []
        self.answer = answer

    def ask(self) -> float | None:
        return self.left[0] if self.left else None

    def tell(self, sample: Sample) -> None:
        self.samples.append(sample)
        if not sample.dark:
            self.left.pop(0)

    def estimate(self) -> Found | NotFound:
        return self.answer


def scanner(bench: Bench, **changes: object) -> Scanner:
    arms_itself = {"arms_itself": True}
    return Scanner(
        stage=bench,
        laser=bench,
        receiver=bench,
        reader=bench,
        clock=bench,
        guard=Guard(limits=Limits(), firing=FiringLimits(), admission=Admission()),
        **(arms_itself | changes),
    )


def kinds(events: list[Event]) -> list[str]:
    """Names of the events without `Asked`, which precedes each acquisition."""
    others = [event for event in events if not isinstance(event, Asked)]
    return [event.role if isinstance(event, Measured) else type(event).__name__ for event in others]


def drain(events: Iterator[Event], error: type[Exception]) -> list[Event]:
    """Events up to the error that ends them."""
    seen: list[Event] = []
    with pytest.raises(error):
        seen.extend(events)
    return seen
