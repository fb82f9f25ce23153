"""A rig under a guard, which keeps its true state beside what it reports, for the checks of seeded bugs."""

from __future__ import annotations

from collections.abc import Callable

from markerseek.core import DeviceError, Frame, FrameHeader, Interval, NotFound, Permit, Reading, ReadingFrame, Sample
from markerseek.guard import Admission, FiringLimits, Guard, Limits
from markerseek.scan import Scanner


class Rig:
    """Stage, laser, receiver, reader, clock and watchdog in one; keeps its true state beside what it reports."""

    def __init__(self) -> None:
        self.limits = Interval(low_deg=-36.5, high_deg=36.5)
        self.true_deg = 0.0
        self.off_deg = 0.0
        self.true_pulses = 0
        self.held = False
        self.unheld: list[str] = []
        self.extra_pulses = 0
        self.error: Exception | None = None
        self.sequence = 0
        self.now = 0.0

    @property
    def angle_deg(self) -> float:
        return self.true_deg

    def move_to(self, angle_deg: float) -> float:
        self._watch("move")
        self.true_deg = angle_deg + self.off_deg
        return self.true_deg

    def stop(self) -> None:
        pass

    def disarm(self) -> None:
        pass

    def hold(self) -> None:
        self.held = True

    def release(self) -> None:
        self.held = False

    def arm(self, permit: Permit) -> None:
        pass

    def fire(self, permit: Permit) -> int:
        self._watch("fire")
        if self.error is not None:
            raise self.error
        self.true_pulses += permit.pulses + self.extra_pulses
        return permit.pulses + self.extra_pulses

    def settle(self) -> None:
        """Nothing of an earlier acquisition arrives."""

    def acquire(self, permit: Permit) -> Frame:
        self.sequence += 1
        return ReadingFrame(
            header=FrameHeader(
                sequence=self.sequence,
                token=permit.token,
                pulses=permit.pulses,
                commanded_deg=permit.angle_deg,
                started_s=self.now,
                ended_s=self.now,
            ),
            intensity=float(self.sequence),
        )

    def read(self, frame: Frame) -> Reading:
        assert isinstance(frame, ReadingFrame)
        return Reading(intensity=frame.intensity)

    def now_s(self) -> float:
        return self.now

    def wait(self, duration_s: float) -> None:
        self.now += duration_s

    def _watch(self, verb: str) -> None:
        if not self.held:
            self.unheld.append(verb)


class Twice:
    """A policy that asks for two angles."""

    def __init__(self) -> None:
        self.samples: list[Sample] = []

    def ask(self) -> float | None:
        return float(len(self.samples)) if len(self.samples) < 2 else None

    def tell(self, sample: Sample) -> None:
        self.samples.append(sample)

    def estimate(self) -> NotFound:
        return NotFound(mean_deg=0.0, reason="a test")


def armed() -> Guard:
    guard = Guard(limits=Limits(), firing=FiringLimits(pulses_per_session=100), admission=Admission())
    guard.arm(by="a test")
    return guard


def scanner(rig: Rig) -> Scanner:
    return Scanner(stage=rig, laser=rig, receiver=rig, reader=rig, clock=rig, guard=armed(), pulses=4, watchdog=rig)


def refused(step: Callable[[], object], error: type[Exception] = DeviceError) -> bool:
    try:
        step()
    except error:
        return True
    return False
