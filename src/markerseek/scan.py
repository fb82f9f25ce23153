"""The heart: `Scanner` measures at one angle, `run` drives a policy over it.

There is one loop for simulated, replayed and real rigs. `run` is a generator of events, so that a terminal, a page,
a journal or a test can watch it; closing it stops the stage and takes the laser's permit away.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Protocol

from markerseek.core import (
    AcquisitionError,
    Asked,
    Clock,
    ConfigError,
    Event,
    Failed,
    Finished,
    Found,
    Laser,
    Measured,
    Policy,
    Reader,
    Receiver,
    Refused,
    Sample,
    SaturationError,
    SearchError,
    Stage,
    Started,
)
from markerseek.guard import Guard, Limits, State


class DeadMan(Protocol):
    """Lets go of the laser and the stage when the control loop falls silent between `hold` and `release`."""

    def hold(self) -> None:
        """Begin to need the steps of the control loop."""

    def release(self) -> None:
        """Need no more steps; allowed at any time, also twice."""


class Scanner:
    """Measures at one angle: guard, stage, permit, laser and receiver, admission, reader.

    Parameters
    ----------
    stage, laser, receiver, reader, clock
        The parts of the rig.
    guard
        Says what may be done, and believed. It must be armed before anything moves.
    pulses
        Laser pulses averaged in one acquisition.
    arms_itself
        Whether the guard is armed by the first measurement: only where no hardware is involved.
    dead_man
        Watches over each move and each firing; None where no hardware is involved.
    """

    def __init__(
        self,
        *,
        stage: Stage,
        laser: Laser,
        receiver: Receiver,
        reader: Reader,
        clock: Clock,
        guard: Guard,
        pulses: int = 16,
        arms_itself: bool = False,
        dead_man: DeadMan | None = None,
    ) -> None:
        if pulses < 1:
            raise ConfigError(f"scanner: pulses is {pulses}, at least 1 is needed to hear anything")
        self.guard = guard
        self.clock = clock
        self._stage = stage
        self._laser = laser
        self._receiver = receiver
        self._reader = reader
        self._pulses = pulses
        self._arms_itself = arms_itself
        self._dead_man = dead_man

    @property
    def limits(self) -> Limits:
        """Where it may look, and where the probe may be."""
        return self.guard.limits

    @property
    def angle_deg(self) -> float:
        """Readback of the stage in degrees, inside the travel range."""
        with self._trusted():
            angle_deg = self._stage.angle_deg
        return self.guard.readback(angle_deg)

    def measure(self, angle_deg: float) -> Sample:
        """Turn the probe to an angle, fire, listen, and say what was heard.

        Parameters
        ----------
        angle_deg
            Where to measure, in degrees.

        Raises
        ------
        LimitError
            If the angle is outside the search range or the guard is not armed; nothing was moved.
        AcquisitionError
            If the frame was refused; it may be taken again.
        DeviceError
            If a device did not do its part; the guard is in FAULT then.
        """
        self._arm_itself()
        self.guard.begin_move(angle_deg)
        with self._watched():
            reached_deg = self._stage.move_to(angle_deg)
        self.guard.end_move(reached_deg)
        return self._acquire(angle_deg, pulses=self._pulses)

    def measure_dark(self) -> Sample:
        """Listen where the probe stands with the laser kept off: what noise alone looks like.

        Raises
        ------
        DeviceError
            As `measure`.
        """
        self._arm_itself()
        return self._acquire(self.angle_deg, pulses=0)

    def stop(self) -> None:
        """Disarm the guard, take the laser's permit away, then stop the stage; a fault stays one."""
        self.guard.disarm()
        try:
            with self._trusted():
                self._laser.disarm()
        finally:
            with self._trusted():
                self._stage.stop()

    def _acquire(self, commanded_deg: float, *, pulses: int) -> Sample:
        permit = self.guard.issue(angle_deg=commanded_deg, pulses=pulses, now_s=self.clock.now_s())
        with self._trusted(AcquisitionError, ConfigError):
            self._receiver.arm(permit)
        before_deg = self.angle_deg
        self.guard.redeem(permit, angle_deg=before_deg, now_s=self.clock.now_s())
        with self._watched():
            fired = self._laser.fire(permit)
        self.guard.end_fire(fired)
        with self._trusted(AcquisitionError, ConfigError):
            frame = self._receiver.acquire(permit)
        after_deg = self.angle_deg
        frame = replace(frame, header=replace(frame.header, angle_before_deg=before_deg, angle_after_deg=after_deg))
        self.guard.admit_frame(frame, permit=permit, now_s=self.clock.now_s())
        with self._trusted(AcquisitionError, ConfigError):
            reading = self._reader.read(frame)
        self.guard.admit_reading(reading, frame=frame)
        return Sample(angle_deg=(before_deg + after_deg) / 2, reading=reading, dark=pulses == 0, frame=frame)

    def _arm_itself(self) -> None:
        if self._arms_itself and self.guard.state is State.DISARMED:
            self.guard.arm(by="a rig without hardware")

    @contextmanager
    def _watched(self) -> Iterator[None]:
        """Under the dead man's lease, and trusted to raise nothing."""
        with self._trusted():
            if self._dead_man is not None:
                self._dead_man.hold()
            try:
                yield
            finally:
                if self._dead_man is not None:
                    self._dead_man.release()

    @contextmanager
    def _trusted(self, *harmless: type[Exception]) -> Iterator[None]:
        """Whatever a device raises is its fault, but for what it may refuse."""
        try:
            yield
        except harmless:
            raise
        except Exception as error:
            self.guard.fail(f"{type(error).__name__}: {error}")
            raise


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLimits:
    """What a run may cost before it is ended with an error.

    Attributes
    ----------
    acquisitions
        Most acquisitions that a policy may ask for.
    duration_s
        Longest time on the rig's clock, in seconds.
    attempts
        How often one acquisition is tried when its frames are refused.
    """

    acquisitions: int = 500
    duration_s: float = 3600.0 * 3
    attempts: int = 3


_RUN_LIMITS = RunLimits()


def run(
    policy: Policy, scanner: Scanner, *, dark_frames: int = 0, stay: bool = False, limits: RunLimits = _RUN_LIMITS
) -> Generator[Event, None, None]:
    """Let a policy search on a rig, and report each step.

    A search that found a marker ends with a move to it and one acquisition there, which confirms and is not told.
    Each `Measured` is handed out before the policy is told of it.

    Parameters
    ----------
    policy
        Decides where to look next.
    scanner
        The rig.
    dark_frames
        Acquisitions without laser before the first, which tell the policy what noise looks like.
    stay
        Leave the probe where the last acquisition was taken, and confirm nothing.
    limits
        What the run may cost.

    Yields
    ------
    Event
        Started; Asked, Refused and Measured; then Finished, or Failed followed by its error.

    Raises
    ------
    Exception
        Whatever ended the run, a `MarkerseekError` unless a driver broke its promise; the probe stays where it stopped.
    """
    began_s = scanner.clock.now_s()
    travel_deg = 0.0
    count = 0
    try:
        place_deg = scanner.angle_deg
        yield Started(start_deg=place_deg, limits=scanner.limits.search)
        for index in range(1, dark_frames + 1):
            yield Asked(role="dark", index=index, angle_deg=place_deg)
            dark = yield from _admitted(scanner, scanner.measure_dark, place_deg, limits.attempts)
            yield Measured(role="dark", index=index, sample=dark)
            policy.tell(dark)
        while (asked_deg := policy.ask()) is not None:
            _require_budget(count, scanner.clock.now_s() - began_s, limits)
            scanner.limits.require_search(asked_deg)
            yield Asked(role="search", index=count + 1, angle_deg=asked_deg)
            sample = yield from _admitted(scanner, _at(scanner, asked_deg), asked_deg, limits.attempts)
            count += 1
            travel_deg += abs(sample.angle_deg - place_deg)
            place_deg = sample.angle_deg
            yield Measured(role="search", index=count, sample=sample)
            policy.tell(sample)
        estimate = policy.estimate()
        confirmation = None
        if isinstance(estimate, Found) and not stay:
            yield Asked(role="confirmation", index=1, angle_deg=estimate.mean_deg)
            confirm = _at(scanner, estimate.mean_deg)
            confirmation = yield from _admitted(scanner, confirm, estimate.mean_deg, limits.attempts)
            travel_deg += abs(confirmation.angle_deg - place_deg)
            yield Measured(role="confirmation", index=1, sample=confirmation)
        yield Finished(
            estimate=estimate,
            confirmation=confirmation,
            acquisitions=count,
            travel_deg=travel_deg,
            elapsed_s=scanner.clock.now_s() - began_s,
        )
    except Exception as error:
        yield Failed(error=error)
        raise
    finally:
        scanner.stop()


def _at(scanner: Scanner, angle_deg: float) -> Callable[[], Sample]:
    return lambda: scanner.measure(angle_deg)


def _admitted(
    scanner: Scanner, measure: Callable[[], Sample], angle_deg: float, attempts: int
) -> Generator[Event, None, Sample]:
    """Measure again while frames are refused, and no more often than the limit says."""
    for attempt in range(1, attempts + 1):
        try:
            return measure()
        except SaturationError:
            raise
        except AcquisitionError as refusal:
            if scanner.guard.state is State.FAULT:
                raise
            if attempt == attempts:
                error = AcquisitionError(f"{refusal} (refused {attempts} times at {angle_deg:.2f} deg)")
                scanner.guard.fail(str(error))
                raise error from refusal
            yield Refused(angle_deg=angle_deg, reason=str(refusal))
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def _require_budget(count: int, elapsed_s: float, limits: RunLimits) -> None:
    if count >= limits.acquisitions:
        raise SearchError(f"the policy asked for more than {limits.acquisitions} acquisitions; its search does not end")
    if not elapsed_s <= limits.duration_s:
        raise SearchError(f"the search took {elapsed_s:.0f} s, more than the {limits.duration_s:.0f} s allowed")
