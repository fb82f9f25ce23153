"""The heart: `Scanner` measures at one angle, `run` drives a policy over it.

There is one loop for simulated, replayed and real rigs. `run` is a generator of events, so that a terminal, a page,
a journal or a test can watch it; closing it stops the stage and takes the laser's permit away.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

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
    LaserError,
    Measured,
    MoveError,
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
from markerseek.guard import Admission, Limits, Permits


class Scanner:
    """Measures at one angle: guard, stage, permit, laser and receiver, admission, reader.

    Parameters
    ----------
    stage, laser, receiver, reader, clock
        The parts of the rig.
    limits
        Where it may look.
    permits
        Who gives leave to fire.
    admission
        Which frames are believed.
    pulses
        Laser pulses averaged in one acquisition.
    arrival_deg
        Most that the readback may differ from the angle asked for, in degrees.
    """

    def __init__(
        self,
        *,
        stage: Stage,
        laser: Laser,
        receiver: Receiver,
        reader: Reader,
        clock: Clock,
        limits: Limits,
        permits: Permits,
        admission: Admission,
        pulses: int = 16,
        arrival_deg: float = 0.1,
    ) -> None:
        if pulses < 1:
            raise ConfigError(f"scanner: pulses is {pulses}, at least 1 is needed to hear anything")
        self.limits = limits
        self.clock = clock
        self._stage = stage
        self._laser = laser
        self._receiver = receiver
        self._reader = reader
        self._permits = permits
        self._admission = admission
        self._pulses = pulses
        self._arrival_deg = arrival_deg
        self._sequence: int | None = None

    @property
    def angle_deg(self) -> float:
        """Readback of the stage, in degrees."""
        return self._stage.angle_deg

    def measure(self, angle_deg: float) -> Sample:
        """Turn the probe to an angle, fire, listen, and say what was heard.

        Parameters
        ----------
        angle_deg
            Where to measure, in degrees.

        Raises
        ------
        LimitError
            If the angle is outside the search range; nothing was moved.
        DeviceError
            If a device did not do its part, or (AcquisitionError) the frame was refused.
        """
        self.limits.require_search(angle_deg)
        reached_deg = self._stage.move_to(angle_deg)
        if not abs(reached_deg - angle_deg) <= self._arrival_deg:
            raise MoveError(
                f"the stage was sent to {angle_deg:.3f} deg and stands at {reached_deg:.3f} deg, more than "
                f"{self._arrival_deg} deg away; check for an obstacle"
            )
        return self._acquire(angle_deg, pulses=self._pulses)

    def measure_dark(self) -> Sample:
        """Listen where the probe stands with the laser kept off: what noise alone looks like.

        Raises
        ------
        DeviceError
            If a device did not do its part, or (AcquisitionError) the frame was refused.
        """
        return self._acquire(self._stage.angle_deg, pulses=0)

    def stop(self) -> None:
        """Take the laser's permit away, then stop the stage."""
        try:
            self._laser.disarm()
        finally:
            self._stage.stop()

    def _acquire(self, commanded_deg: float, *, pulses: int) -> Sample:
        before_deg = self._stage.angle_deg
        permit = self._permits.issue(angle_deg=commanded_deg, pulses=pulses, now_s=self.clock.now_s())
        self._receiver.arm(permit)
        fired = self._laser.fire(permit)
        if fired != pulses:
            raise LaserError(
                f"the laser fired {fired} pulses, {pulses} were permitted; check the laser and its trigger"
            )
        frame = self._receiver.acquire(permit)
        after_deg = self._stage.angle_deg
        frame = replace(frame, header=replace(frame.header, angle_before_deg=before_deg, angle_after_deg=after_deg))
        self._admission.admit_frame(frame, permit=permit, previous_sequence=self._sequence)
        self._sequence = frame.header.sequence
        reading = self._reader.read(frame)
        self._admission.admit_reading(reading, frame=frame)
        return Sample(angle_deg=(before_deg + after_deg) / 2, reading=reading, dark=pulses == 0, frame=frame)


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
    place_deg = scanner.angle_deg
    travel_deg = 0.0
    count = 0
    try:
        yield Started(start_deg=place_deg, limits=scanner.limits.search)
        for index in range(1, dark_frames + 1):
            yield Asked(role="dark", index=index, angle_deg=place_deg)
            dark = yield from _admitted(scanner.measure_dark, place_deg, limits.attempts)
            yield Measured(role="dark", index=index, sample=dark)
            policy.tell(dark)
        while (asked_deg := policy.ask()) is not None:
            _require_budget(count, scanner.clock.now_s() - began_s, limits)
            yield Asked(role="search", index=count + 1, angle_deg=asked_deg)
            sample = yield from _admitted(_at(scanner, asked_deg), asked_deg, limits.attempts)
            count += 1
            travel_deg += abs(sample.angle_deg - place_deg)
            place_deg = sample.angle_deg
            yield Measured(role="search", index=count, sample=sample)
            policy.tell(sample)
        estimate = policy.estimate()
        confirmation = None
        if isinstance(estimate, Found) and not stay:
            yield Asked(role="confirmation", index=1, angle_deg=estimate.mean_deg)
            confirmation = yield from _admitted(_at(scanner, estimate.mean_deg), estimate.mean_deg, limits.attempts)
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


def _admitted(measure: Callable[[], Sample], angle_deg: float, attempts: int) -> Generator[Event, None, Sample]:
    """Measure again while frames are refused, and no more often than the limit says."""
    for attempt in range(1, attempts + 1):
        try:
            return measure()
        except SaturationError:
            raise
        except AcquisitionError as refusal:
            if attempt == attempts:
                raise AcquisitionError(f"{refusal} (refused {attempts} times at {angle_deg:.2f} deg)") from refusal
            yield Refused(angle_deg=angle_deg, reason=str(refusal))
    raise ConfigError(f"run limits: attempts is {attempts}, at least 1 is needed")


def _require_budget(count: int, elapsed_s: float, limits: RunLimits) -> None:
    if count >= limits.acquisitions:
        raise SearchError(f"the policy asked for more than {limits.acquisitions} acquisitions; its search does not end")
    if not elapsed_s <= limits.duration_s:
        raise SearchError(f"the search took {elapsed_s:.0f} s, more than the {limits.duration_s:.0f} s allowed")
