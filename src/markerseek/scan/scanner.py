"""`Scanner`: one acquisition at one angle, or one sweep; the guard must permit each step."""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, closing
from functools import partial
from types import TracebackType
from typing import Protocol, cast

import numpy as np
from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    Clock,
    ConfigError,
    FollowedTissue,
    FollowPermit,
    Frame,
    HandTurnedStage,
    Laser,
    Permit,
    Reader,
    Reading,
    Receiver,
    Refused,
    Sample,
    SaturationError,
    Stage,
    StageReading,
    Sweep,
    SweepPermit,
    Swept,
    Turning,
    is_finite,
)
from markerseek.guard import Guard, Limits, State
from markerseek.scan.followed_tissue import await_known, await_pause, mean_displacement
from markerseek.scan.sweeping import SweepingDevices, SweepInProgress, SweptFrame
from markerseek.scan.turning import TurnInProgress, turning_stage

MIN_ENERGY = 0.1
"""Least measured energy over the usual one with which a reading is used; the most is as much above it."""


_LOG = logging.getLogger(__name__)

_THERE_DEG = 0.1
"""A probe so near to the beginning of a sweep is not moved there."""

_MARKS = 10
_MARK_S = 3.0
"""A burst has up to 9 dark triggers more, another number every 3 s, so that their number shows which one it is.

A program that is killed in a sweep leaves a burst that is written within 25 s; the next one cannot have the number of
that, for the clock goes on from program to program.
"""


class Watchdog(Protocol):
    """Makes laser and stage safe when the control loop stops stepping between `hold` and `release`."""

    def hold(self) -> None:
        """Require steps of the control loop from now on."""

    def release(self) -> None:
        """Require no more steps; allowed at any time, also twice."""


class Scanner:
    """Measures at one angle: guard, stage, permit, laser and receiver, admission, reader.

    ``guard``: permits each step, and admits frames. It must be armed before anything moves. ``arms_itself``: whether
    the guard is armed by the first measurement: only where no hardware is involved. ``watchdog``: lease for each move
    and each firing; None if no hardware is involved.
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
        pulses: int | Sequence[int] = 16,
        arms_itself: bool = False,
        watchdog: Watchdog | None = None,
    ) -> None:
        in_turn = (pulses,) if isinstance(pulses, int) else tuple(pulses)
        if not in_turn or min(in_turn) < 1:
            raise ConfigError(f"scanner: pulses is {pulses}, at least 1 is needed to receive a signal")
        self.guard = guard
        self.clock = clock
        self._stage = stage
        self._laser = laser
        self._receiver = receiver
        self._reader = reader
        self._pulses = in_turn
        self._acquired = 0
        self._arms_itself = arms_itself
        self._watchdog_held = _WatchdogHeld(watchdog)
        self._faulting = _FaultOnError(guard)
        # A receiver or reader may refuse a frame, which is taken again; laser and stage have no such second try.
        self._refusable = _FaultOnError(guard, AcquisitionError, ConfigError)
        self._refused_frame: Frame | None = None
        # Whether a frame was asked for before, and whether the last one came.
        self._begun = False
        self._settled = False
        # Whether the laser has fired for a camera since the receiver was last quiet.
        self._lit = False
        self._mark: int | None = None
        self._fired_s = (0.0, 0.0)
        """Begin and end of the last firing."""
        self._pulse_s = 0.0
        """Time for each pulse of the last firing; 0 before the first."""
        # Angle of the probe over that of the stage: the backlash, as it lies after the last turn.
        self._lag_deg = 0.0

    @property
    def limits(self) -> Limits:
        """Angles that may be searched, and at which the probe may be."""
        return self.guard.limits

    @property
    def pulses(self) -> int:
        """Most laser pulses averaged in one acquisition."""
        return max(self._pulses)

    @property
    def angle_deg(self) -> float:
        """Readback of the stage in degrees, inside the travel range."""
        with self._faulting:
            angle_deg = self._stage.angle_deg
        return self.guard.readback(angle_deg)

    @property
    def refused_frame(self) -> Frame | None:
        """Frame of the last acquisition if it was refused; None if it was not, or nothing came."""
        return self._refused_frame

    def take(
        self,
        step: float | Sweep | None,
        *,
        number: int = 1,
        goes_on: Callable[[], bool] = lambda: True,
        tissue: FollowedTissue | None = None,
    ) -> Generator[Turning | Sample | Refused | Swept, None, None]:
        """Yield the samples of one step: one at an angle or, for None, one in the dark; of a sweep, one for each pulse.

        At an angle, a person who turns the probe is guided there before. The frame of a pulse that says nothing is
        `Refused`, and a sweep ends with `Swept`. ``number``: number of the sweep in its run. ``goes_on``: whether more
        of a sweep is wanted; if not, the light ends and the probe brakes. ``tissue``: the tissue, where it is followed:
        the samples state its displacement, and the light waits for its pause. Raises as `measure`; of a sweep,
        `ConfigError` if the rig cannot sweep so, and `AcquisitionError` if frames and pulses do not belong together,
        which refuses the sweep as a whole.
        """
        self._refused_frame = None
        if isinstance(step, Sweep):
            yield from self._sweep(step, number=number, goes_on=goes_on, tissue=tissue)
        elif step is None:
            yield self.measure_dark()
        else:
            # Of the class, and no isinstance: it would ask the device for its angle.
            if hasattr(type(self._stage), "guide"):
                with self._faulting:
                    yield from cast("HandTurnedStage", self._stage).guide(step)
            yield self.measure(step, tissue=tissue)

    def measure(self, angle_deg: float, *, tissue: FollowedTissue | None = None) -> Sample:
        """Turn the probe to an angle, fire, acquire a frame, and return its reading.

        ``angle_deg``: where to measure. ``tissue``: as of `take`. Raises `LimitError` if the angle is outside the
        search range or the guard is not armed; nothing was moved. Raises `AcquisitionError` if the frame was refused;
        it may be taken again. Raises `DeviceError` if a device did not do its part; the guard is in FAULT then.
        """
        self._move(angle_deg)
        self._acquired += 1
        pulses = self._pulses[(self._acquired - 1) % len(self._pulses)]
        sample = self._acquire(angle_deg, pulses=pulses, tissue=tissue)
        if tissue is None:
            return sample
        began_s, ended_s = self._fired_s
        await_known(tissue, self.clock, at_s=ended_s)
        return structs.replace(sample, displacement=mean_displacement(tissue, began_s=began_s, ended_s=ended_s))

    def measure_dark(self) -> Sample:
        """Acquire a frame of noise at the present angle, with the laser off.

        Raises `DeviceError` as `measure`.
        """
        self._arm_itself()
        return self._acquire(self.angle_deg, pulses=0)

    def light(self, pulses: int | None = None) -> int:
        """Fire at the present angle and receive nothing, for a camera that looks on.

        ``pulses``: how many; None: those of one acquisition. Returns the number of pulses. Raises as `measure`.
        """
        self._arm_itself()
        at_deg = self.angle_deg
        wanted = self._pulses[0] if pulses is None else pulses
        permit = self.guard.issue(angle_deg=at_deg, pulses=wanted, now_s=self.clock.now_s())
        # What a receiver may have recorded of it must not pass for the answer to the next permit.
        self._begun = True
        self._settled = False
        self._lit = True
        self.guard.redeem(permit, angle_deg=at_deg, now_s=self.clock.now_s())
        return self._fire(permit)

    def begin_following(self, permit: FollowPermit, *, by: str) -> None:
        """Begin to follow, or renew the permit, in the name of a person; nothing moves.

        Raises `ConfigError` if the stage cannot turn so, or not as fast, and `LimitError` if the guard is not armed.
        """
        stage = turning_stage(self._stage)
        fastest_deg_s = stage.fastest_sweep_deg_s
        if not permit.speed_deg_s <= fastest_deg_s:
            raise ConfigError(
                f"follow permit: speed_deg_s is {permit.speed_deg_s:g} deg/s, this stage turns with at most "
                f"{fastest_deg_s:g} deg/s"
            )
        self._arm_itself()
        self.guard.begin_following(permit, by=by, now_s=self.clock.now_s())
        self._lag_deg = 0.0

    def end_following(self) -> None:
        """End it; the rig stays armed, and the probe where it is."""
        self.guard.end_following()

    @property
    def probe_deg(self) -> float:
        """Angle of the probe in degrees: the readback, and the backlash after the last turn while it follows."""
        return self.angle_deg + self._lag_deg

    @property
    def play_deg(self) -> float:
        """Largest backlash of a stage that turns, in degrees."""
        stage = turning_stage(self._stage)
        return max(stage.play_deg(1.0), stage.play_deg(-1.0))

    @property
    def turning_acceleration_deg_s2(self) -> float:
        """Acceleration of a stage that turns, in degrees per second squared; `ConfigError` if the rig cannot follow."""
        return turning_stage(self._stage).acceleration_deg_s2

    def turn_to(
        self, angle_deg: float, *, speed_deg_s: float, goes_on: Callable[[], bool] = lambda: True
    ) -> Generator[float, None, float]:
        """Turn the probe in the dark while it follows: its angle every 50 ms, and at rest as the return value.

        ``goes_on``: asked after each angle; if not, the probe brakes. If it is closed early the rig stops. Raises as
        `measure`.
        """
        stage = turning_stage(self._stage)
        from_deg = self.angle_deg
        forward = 1.0 if angle_deg > from_deg + self._lag_deg else -1.0
        # The probe lags behind the stage by the backlash.
        to_deg = angle_deg + forward * stage.play_deg(forward)
        with self._faulting:
            stage.prepare_sweep(speed_deg_s=speed_deg_s)
        now_s = self.clock.now_s()
        self.guard.begin_turn(to_deg, from_deg=from_deg, now_s=now_s)
        _LOG.debug("turn to %.4f deg", to_deg)
        lag_deg = self._lag_deg

        def at_deg(stage_deg: float) -> float:
            slack_deg = lag_deg - (stage_deg - from_deg)
            self._lag_deg = min(max(slack_deg, -stage.play_deg(1.0)), stage.play_deg(-1.0))
            return stage_deg + self._lag_deg

        turn = TurnInProgress(
            stage,
            guard=self.guard,
            clock=self.clock,
            start=StageReading(angle_deg=from_deg, asked_s=now_s, answered_s=now_s),
            to_deg=to_deg,
            speed_deg_s=speed_deg_s,
        )
        try:
            # Closed here, and not by the garbage collector, which would print an error of the lease that ends with it.
            with self._faulting, self._watchdog_held, closing(turn.readings(goes_on)) as readings:
                while True:
                    try:
                        here_deg = next(readings)
                    except StopIteration as end:
                        reached_deg = cast("float", end.value)
                        break
                    yield at_deg(here_deg)
        finally:
            # Closed while it turns, or a fault.
            if self.guard.state in (State.TURNING, State.FAULT):
                self.stop()
        _LOG.debug("at rest at %.4f deg", reached_deg)
        return at_deg(reached_deg)

    def look(self, pulses: int) -> Sample:
        """Acquire a frame with so many pulses where the probe is at rest while it follows.

        Raises as `measure`.
        """
        sample = self._acquire(self.angle_deg, pulses=pulses)
        return structs.replace(sample, angle_deg=sample.angle_deg + self._lag_deg)

    @property
    def sweeping(self) -> SweepingDevices:
        """Its devices as those of a sweep; `ConfigError` says why this rig cannot sweep."""
        return SweepingDevices.of(self._stage, self._laser, self._receiver)

    def _sweep(
        self, sweep: Sweep, *, number: int, goes_on: Callable[[], bool], tissue: FollowedTissue | None
    ) -> Generator[Sample | Refused | Swept, None, None]:
        devices = self.sweeping
        if sweep.from_deg is not None and not abs(self.angle_deg - sweep.from_deg) <= _THERE_DEG:
            self._move(sweep.from_deg)
        self._arm_itself()
        # What an acquisition before this run may still write has another number of triggers than the burst.
        if self._begun or not devices.in_bursts:
            self._settle()
        self._begun = True
        self._settled = False
        lasts_s = devices.duration_s(sweep, from_deg=self.angle_deg)
        if tissue is not None and lasts_s < tissue.pause_s:
            await_pause(tissue, self.clock, for_s=lasts_s)
        dark, mark = (self.pulses, self._next_mark()) if devices.in_bursts else (0, 0)
        wanted = devices.permit(sweep, from_deg=self.angle_deg, dark=dark, mark=mark)
        now_s = self.clock.now_s()
        permit = self.guard.issue_sweep(wanted, now_s=now_s)
        devices.require_in_time(sweep, permit, now_s=now_s)
        wait_deg = devices.wait_deg(sweep)
        with self._faulting:
            devices.stage.prepare_sweep(speed_deg_s=sweep.speed_deg_s)
            devices.laser.prepare_sweep()
        with self._refusable:
            devices.receiver.begin_sweep(permit)
        from_deg = self.angle_deg
        now_s = self.clock.now_s()
        self.guard.redeem(permit, angle_deg=from_deg, now_s=now_s)
        progress = SweepInProgress(
            devices,
            permit,
            speed_deg_s=sweep.speed_deg_s,
            guard=self.guard,
            clock=self.clock,
            held=self._watchdog_held,
            number=number,
            at=StageReading(angle_deg=from_deg, asked_s=now_s, answered_s=now_s),
            admit_dark=self._admit_dark,
            turn_away=None if wait_deg is None else partial(self._move, wait_deg),
            tissue=tissue,
        )
        # Closed here, and not by the garbage collector, which would print an error of the lease that ends with it.
        with closing(progress.frames(goes_on)) as frames:
            try:
                with self._refusable:
                    swept = yield from self._samples(frames, permit)
            except AcquisitionError as refusal:
                if self.guard.state is State.SWEEPING:
                    self.guard.fail(str(refusal))
                raise
            finally:
                # Broken off while it turns, or by a fault: the light ends first.
                if self.guard.state in (State.SWEEPING, State.FAULT):
                    self._end_light_and_motion()
        self._settled = True
        yield swept

    def _next_mark(self) -> int:
        """Return how many triggers mark a burst: not as many as marked the one before, of any program."""
        mark = int(self.clock.now_s() / _MARK_S) % _MARKS
        self._mark = mark if mark != self._mark else (mark + 1) % _MARKS
        return self._mark

    def _admit_dark(self, frame: Frame) -> None:
        """Refuse the dark frame of a burst if it holds a source, as one at rest."""
        self.guard.admit_reading(self._reader.read(frame), frame=frame)

    def _samples(
        self, frames: Generator[list[SweptFrame], None, Swept], permit: SweepPermit
    ) -> Generator[Sample | Refused | Swept, None, Swept]:
        """Yield the samples of the frames of a sweep, which the guard admits; returns what the frames return."""
        while True:
            try:
                swept = next(frames)
            except StopIteration as end:
                return cast("Swept", end.value)
            for each in swept:
                self.guard.admit_frame(each.frame, permit=permit, now_s=self.clock.now_s())
            for each in swept:
                yield self._read(each)

    def _read(self, swept: SweptFrame) -> Sample | Refused:
        """Return the sample of a frame of a sweep, or why the frame says nothing; the sweep goes on in either case."""
        frame = swept.frame
        try:
            reading = per_energy(self._reader.read(frame), frame.header.energy)
            self.guard.admit_reading(reading, frame=frame)
        except SaturationError:
            raise
        except AcquisitionError as refusal:
            return Refused(angle_deg=swept.angle_deg, reason=str(refusal), frame=frame)
        return Sample(
            angle_deg=swept.angle_deg,
            reading=reading,
            angle_sigma_deg=swept.angle_sigma_deg,
            sweep=swept.timing,
            displacement=swept.displacement,
            frame=frame,
        )

    def stop(self) -> None:
        """Disarm the guard, take the laser's permit away, then stop the stage; a fault stays one."""
        # The laser first, and the stage even if that fails: light is the greater danger.
        self.guard.disarm()
        self._end_light_and_motion()

    def _end_light_and_motion(self) -> None:
        try:
            with self._faulting:
                self._laser.disarm()
        finally:
            with self._faulting:
                self._stage.stop()

    def _move(self, angle_deg: float) -> float:
        """Turn the probe without light, and return where it then is."""
        self._arm_itself()
        self.guard.begin_move(angle_deg)
        _LOG.debug("move to %.4f deg", angle_deg)
        with self._faulting, self._watchdog_held:
            reached_deg = self._stage.move_to(angle_deg)
        _LOG.debug("at rest at %.4f deg", reached_deg)
        self.guard.end_move(reached_deg)
        return reached_deg

    def _fire(self, permit: Permit) -> int:
        """Fire the pulses of a permit that is redeemed, and return how many were fired."""
        _LOG.debug("fire %s", permit)
        began_s = self.clock.now_s()
        with self._faulting, self._watchdog_held:
            fired = self._laser.fire(permit)
        _LOG.debug("fired %d pulses", fired)
        self.guard.end_fire(fired)
        ended_s = self.clock.now_s()
        if fired > 0:
            self._fired_s = (began_s, ended_s)
            self._pulse_s = (ended_s - began_s) / fired
        return fired

    def _settle(self) -> None:
        self._begun = True
        lit = self._lit
        self._lit = False
        if not self._settled:
            # After an acquisition that failed, its frame may arrive late and would pass for the answer to this permit.
            try:
                with self._refusable:
                    self._receiver.settle()
            except AcquisitionError:
                # What came after `light` answers its triggers.
                if not lit:
                    raise
        self._settled = False

    def _acquire(self, commanded_deg: float, *, pulses: int, tissue: FollowedTissue | None = None) -> Sample:
        self._refused_frame = None
        self._settle()
        if tissue is not None:
            await_pause(tissue, self.clock, for_s=pulses * self._pulse_s)
        permit = self.guard.issue(angle_deg=commanded_deg, pulses=pulses, now_s=self.clock.now_s())
        with self._refusable:
            self._receiver.arm(permit)
        # Read after arming: a start command may take seconds, in which the probe can be moved by hand.
        before_deg = self.angle_deg
        self.guard.redeem(permit, angle_deg=before_deg, now_s=self.clock.now_s())
        self._fire(permit)
        with self._refusable:
            frame = self._receiver.acquire(permit)
        _LOG.debug("frame %s", frame.header)
        # A second readback after the frame: the guard refuses one during which the probe moved.
        after_deg = self.angle_deg
        frame = structs.replace(
            frame, header=structs.replace(frame.header, angle_before_deg=before_deg, angle_after_deg=after_deg)
        )
        # Kept until it is admitted, so that `Refused` can carry it into the journal.
        self._refused_frame = frame
        self.guard.admit_frame(frame, permit=permit, now_s=self.clock.now_s())
        with self._refusable:
            reading = per_energy(self._reader.read(frame), frame.header.energy)
        self.guard.admit_reading(reading, frame=frame)
        self._refused_frame = None
        self._settled = True
        # The policy gets the angle reached, not the one asked for.
        return Sample(angle_deg=(before_deg + after_deg) / 2, reading=reading, dark=pulses == 0, frame=frame)

    def _arm_itself(self) -> None:
        if self._arms_itself and self.guard.state is State.DISARMED:
            self.guard.arm(by="a rig without hardware")


class _FaultOnError:
    """Puts the guard into FAULT at any error of a device, except those that it may recover from."""

    def __init__(self, guard: Guard, *recoverable: type[Exception]) -> None:
        self._guard = guard
        self._recoverable = recoverable

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None) -> None:
        # KeyboardInterrupt and GeneratorExit are no device's fault: `run` stops the rig, and it may be armed again.
        if isinstance(error, Exception) and not isinstance(error, self._recoverable):
            _LOG.debug("fault: %s: %s", type(error).__name__, error)
            self._guard.fail(f"{type(error).__name__}: {error}")


class _WatchdogHeld(AbstractContextManager[None]):
    """Holds the watchdog's lease during one step."""

    def __init__(self, watchdog: Watchdog | None) -> None:
        self._watchdog = watchdog

    def __enter__(self) -> None:
        if self._watchdog is not None:
            self._watchdog.hold()

    def __exit__(self, *_: object) -> None:
        if self._watchdog is not None:
            self._watchdog.release()


def per_energy(reading: Reading, energy: float | None) -> Reading:
    """Return the reading as it would be with the laser's usual energy, where the rig measures energies."""
    if energy is None:
        return reading
    if not (is_finite(energy) and MIN_ENERGY <= energy <= 1 / MIN_ENERGY):
        raise AcquisitionError(
            f"the energy of the pulses is {energy} of the usual one, it must lie between {MIN_ENERGY} and "
            f"{1 / MIN_ENERGY:g}; look at the laser and its energy meter"
        )
    return divided_reading(reading, energy)


def divided_reading(reading: Reading, energy: float) -> Reading:
    """Return the reading with all its heights, noise included, divided by a positive number."""
    maxima = reading.local_maxima
    if maxima is not None:
        scaled = np.frombuffer(maxima.intensities, "<f4") / np.float32(energy)
        maxima = structs.replace(maxima, intensities=scaled.astype("<f4").tobytes())
    spot = reading.spot
    if spot is not None:
        spot = structs.replace(spot, amplitude=spot.amplitude / energy)
    return structs.replace(
        reading,
        intensity=reading.intensity / energy,
        noise_sigma=None if reading.noise_sigma is None else reading.noise_sigma / energy,
        arrivals=tuple(structs.replace(each, intensity=each.intensity / energy) for each in reading.arrivals),
        spot=spot,
        local_maxima=maxima,
    )
