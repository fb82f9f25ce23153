"""Sweeps: the devices of a rig that can sweep, and one sweep, of which each pulse gives a sample at its angle.

The stage turns, and the laser fires single pulses. The angle of a pulse is interpolated between two readings of the
stage, never taken from a set point.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

from msgspec import structs

from markerseek.core import (
    AcquisitionError,
    Clock,
    ConfigError,
    Displacement,
    FollowedTissue,
    Frame,
    Laser,
    LaserError,
    MoveError,
    Pulse,
    Receiver,
    Stage,
    StageReading,
    Sweep,
    SweepingLaser,
    SweepingReceiver,
    SweepingStage,
    SweepPermit,
    SweepTiming,
    Swept,
)
from markerseek.guard import Guard
from markerseek.scan.followed_tissue import await_known

_LOG = logging.getLogger(__name__)

SLOWEST = 0.08
FASTEST = 1.25
"""Lowest and highest speed at which the laser fires, over the speed of the sweep: it fires on the ramps, but not if the
probe stalls."""

TURN_DEG = 0.1
"""Distance from the turning angle at which the probe counts as having reached it, the same as for the guard."""

TURN_S = 0.5
"""Time that a stage needs to turn back: it comes to rest, and gets its next target."""

LEAST_WAY_DEG = 0.5
"""Shortest way from rest to rest on which the laser must fire."""

SLOWER = 1.1
"""Longest duration of a sweep over the computed one: a stage may be slower than its settings say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepingDevices:
    """Stage, laser and receiver of a rig that can sweep."""

    stage: SweepingStage
    laser: SweepingLaser
    receiver: SweepingReceiver

    @classmethod
    def of(cls, stage: Stage, laser: Laser, receiver: Receiver) -> SweepingDevices:
        """Return the devices, if all three can sweep; `ConfigError` names a device that cannot."""
        for part, device in (("stage", stage), ("laser", laser), ("receiver", receiver)):
            # The class is checked, because isinstance would read the properties, and so ask the device for its angle.
            if not hasattr(type(device), "begin_sweep"):
                # A user's own class is called by its name in the rig file, not by the name of its wrapper.
                name = getattr(device, "driver", type(device).__name__)
                raise ConfigError(
                    f"this rig cannot sweep: its {part} ({name}) only works with the probe at rest; leave `sweep` out"
                )
        devices = cls(stage=stage, laser=laser, receiver=receiver)  # type: ignore[arg-type]
        # Read here, because it raises `ConfigError` if a device can sweep but is not set up for it.
        _ = devices.least_period_s
        return devices

    @property
    def least_period_s(self) -> float:
        """Least time between two pulses, in seconds."""
        return max(self.laser.sweep_period_s, self.receiver.frame_period_s)

    @property
    def in_bursts(self) -> bool:
        """Whether the frames of a sweep are read at its end, all as one acquisition."""
        return self.receiver.sweep_readout_s > 0

    def wait_deg(self, sweep: Sweep) -> float | None:
        """Return the angle at which the probe waits for the frames of a sweep.

        None: where it ends, because they come first.
        """
        if sweep.wait_deg is None:
            return None
        way_s = self._way_s(sweep.wait_deg - sweep.end_deg, speed_deg_s=sweep.speed_deg_s)
        return sweep.wait_deg if self.receiver.sweep_readout_s > way_s else None

    def permit(self, sweep: Sweep, *, from_deg: float, dark: int = 0, mark: int = 0) -> SweepPermit:
        """Return the permit that a sweep needs, without token and expiry.

        `ConfigError` if it is too fast for the stage.

        ``dark``: least number of triggers without light at the end. ``mark``: additional triggers.
        """
        speed = sweep.speed_deg_s
        fastest = self.stage.fastest_sweep_deg_s
        if not speed <= fastest:
            raise ConfigError(
                f"sweep: {speed:g} deg/s is too fast for this stage: at most {math.floor(100 * fastest) / 100:g} deg/s"
            )
        # On a short way the probe brakes before it reaches the speed of the sweep.
        way_deg = abs(sweep.to_deg - from_deg)
        reached = math.sqrt(max(way_deg, LEAST_WAY_DEG) * self.stage.acceleration_deg_s2)
        # At the turning angle the probe is as slow as a stage that is `TURN_DEG` away from rest.
        turning = math.inf if sweep.back_deg is None else 0.8 * math.sqrt(2 * self.stage.acceleration_deg_s2 * TURN_DEG)
        period_s = self.least_period_s
        lasts = self.duration_s(sweep, from_deg=from_deg) / period_s
        pulses = max(math.ceil(SLOWER * lasts) + 1, math.ceil(lasts) + dark)
        return SweepPermit(
            token="",
            angle_deg=from_deg,
            pulses=pulses + mark,
            expires_s=0.0,
            to_deg=sweep.to_deg,
            back_deg=sweep.back_deg,
            slowest_deg_s=min(SLOWEST * min(speed, reached), turning),
            fastest_deg_s=FASTEST * speed,
            period_s=period_s,
        )

    def require_in_time(self, sweep: Sweep, permit: SweepPermit, *, now_s: float) -> None:
        """Raise `ConfigError`, before anything moves, if the permit may expire during the sweep."""
        duration_s = self.duration_s(sweep, from_deg=permit.angle_deg)
        left_s = permit.expires_s - now_s
        if not SLOWER * duration_s <= left_s:
            raise ConfigError(
                f"sweep: it takes {duration_s:.1f} s at {sweep.speed_deg_s:g} deg/s, and its permit holds for "
                f"{left_s:.1f} s; sweep faster"
            )

    def duration_s(self, sweep: Sweep, *, from_deg: float) -> float:
        """Return the time of a sweep in seconds, run-up and braking included."""
        there_s = self._way_s(sweep.to_deg - from_deg, speed_deg_s=sweep.speed_deg_s)
        if sweep.back_deg is None:
            return there_s
        return there_s + TURN_S + self._way_s(sweep.back_deg - sweep.to_deg, speed_deg_s=sweep.speed_deg_s)

    def _way_s(self, way_deg: float, *, speed_deg_s: float) -> float:
        return rest_to_rest_s(abs(way_deg), speed_deg_s=speed_deg_s, acceleration_deg_s2=self.stage.acceleration_deg_s2)


def rest_to_rest_s(way_deg: float, *, speed_deg_s: float, acceleration_deg_s2: float) -> float:
    """Return the time of a turn from rest to rest, in seconds; ``way_deg``: at least 0."""
    if way_deg <= speed_deg_s**2 / acceleration_deg_s2:
        return 2 * math.sqrt(way_deg / acceleration_deg_s2)
    return way_deg / speed_deg_s + speed_deg_s / acceleration_deg_s2


READ_S = 0.05
"""Time from one reading of a turning stage to the next."""

_LEAST_READ_S = 0.025
"""The same where computer or line were held up: nearer readings do not show whether the stage turns."""

_LATE_S = 0.1 * READ_S
"""Time for an answer from which on it is late: a speed between two readings may be wrong by a tenth then."""

BEGIN_S = 1.0
"""Time within which a stage must have begun to turn, and within which it must have come to rest after braking."""

CLOCKS_S = 2e-3
"""Most by which the clocks of stage and stamps differ: they are compared to 1 ms. A stamp is later than its report by
that, and by what the delay of the stamps may be."""

STAMP_SIGMA_S = 2e-3
"""Standard deviation of a stamp by itself, in seconds, where the laser states less: fast ones jitter by up to 3 ms."""

RATE_SPARE_S = 0.02
"""Time by which pulses may come earlier than the rate of their permit allows, jitter of the stamps included."""

BACK_S = 0.7
"""Time within which a stage that is to turn back must have begun to; the guard ends the light a little later."""

DARK_PERIODS = 3
"""Periods of the laser within which at least one pulse must come."""

BACKLASH_ERROR = 0.5
"""Relative standard deviation of the backlash that a rig states."""

AT_REST_DEG = 0.005
"""Most by which two readings of a stage at rest differ: ten counts of a PRM1Z8's encoder."""

OFF_WAY_DEG = 0.02
"""Most by which the servo of a PRM1Z8 is off its way while it turns, and where it begins: it settles there."""

SHORT_DEG = 1.0
"""Most by which a sweep that nobody ended may end before its end: it brakes earlier, and at least as hard."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptFrame:
    """A frame of a sweep, with the angle of its pulse."""

    frame: Frame
    angle_deg: float
    angle_sigma_deg: float
    timing: SweepTiming
    displacement: Displacement | None = None
    """Of the tissue at the pulse; None: not known."""


def await_reading(clock: Clock, last: StageReading) -> None:
    """Wait until a turning stage is to be read again.

    Shorter where computer or line were held up: the guard must have a reading every `SWEEP_READING_S`.
    """
    since_s = clock.now_s() - last.asked_s
    clock.wait(min(READ_S, max(_LEAST_READ_S, READ_S + _LEAST_READ_S - since_s)))


class Way:
    """A way from rest to rest at the speed of a sweep, and when the stage was where its readings say.

    A reading is of any moment between question and answer. On its way the stage needs a known time to each angle, and
    it began once: the latest beginning that its readings force gives the earliest moment of each that they all allow.
    """

    def __init__(
        self, *, start: StageReading, target_deg: float, speed_deg_s: float, acceleration_deg_s2: float
    ) -> None:
        self._start_deg = start.angle_deg
        self._target_deg = target_deg
        self._speed_deg_s = speed_deg_s
        self._acceleration_deg_s2 = acceleration_deg_s2
        self._began_s = start.asked_s

    def moment_s(self, reading: StageReading) -> float:
        """Return the earliest moment of a reading, never before its question or after its answer."""
        done_deg = abs(reading.angle_deg - self._start_deg)
        # By what a servo may be off its way, it needed a little less or a little more.
        self._began_s = max(self._began_s, reading.asked_s - self._needed_s(done_deg + OFF_WAY_DEG))
        moment_s = self._began_s + self._needed_s(done_deg - OFF_WAY_DEG)
        return min(max(moment_s, reading.asked_s), reading.answered_s)

    def _needed_s(self, done_deg: float) -> float:
        """Return the time that a part of the way takes from its start."""
        way_deg = abs(self._target_deg - self._start_deg)
        done_deg = min(max(done_deg, 0.0), way_deg)
        if done_deg > way_deg / 2:
            return 2 * self._run_up_s(way_deg / 2) - self._run_up_s(way_deg - done_deg)
        return self._run_up_s(done_deg)

    def _run_up_s(self, way_deg: float) -> float:
        """Return the time from rest over a way, braking left out."""
        ramp_deg = self._speed_deg_s**2 / (2 * self._acceleration_deg_s2)
        if way_deg <= ramp_deg:
            return math.sqrt(2 * way_deg / self._acceleration_deg_s2)
        return (way_deg + ramp_deg) / self._speed_deg_s


class SweepInProgress:
    """One sweep from its redeemed permit on; the guard is SWEEPING until the probe is at rest again.

    ``held``: holds the watchdog's lease while the probe turns. ``at``: readback and time at which the permit was used.
    ``admit_dark``: refuses a dark frame that holds a source. ``turn_away``: turns the probe to where it waits for the
    frames of a burst, and returns its angle; None: it stays. ``tissue``: the tissue, where it is followed.
    """

    def __init__(
        self,
        devices: SweepingDevices,
        permit: SweepPermit,
        *,
        speed_deg_s: float,
        guard: Guard,
        clock: Clock,
        held: AbstractContextManager[None],
        number: int,
        at: StageReading,
        admit_dark: Callable[[Frame], None],
        turn_away: Callable[[], float] | None = None,
        tissue: FollowedTissue | None = None,
    ) -> None:
        self._devices = devices
        self._permit = permit
        self._speed_deg_s = speed_deg_s
        self._guard = guard
        self._clock = clock
        self._held = held
        self._number = number
        self._admit_dark = admit_dark
        self._turn_away = turn_away
        self._tissue = tissue
        self._turning_s: float | None = None
        self._readings = [at]
        self._way = self._way_to(permit.to_deg)
        self._pulses: list[Pulse] = []
        self._frames: list[Frame] = []
        self._told = 0
        self._latest_s = -math.inf

    def frames(self, goes_on: Callable[[], bool]) -> Generator[list[SweptFrame], None, Swept]:
        """Turn, and return the frames with their angles as they come, then where the probe came to rest.

        Those of a burst come all at once, and are admitted before the first is used: none grows old meanwhile.

        ``goes_on``: whether more of the sweep is wanted; if not, the light ends, then the motion. `AcquisitionError`
        refuses the sweep as a whole: frames and pulses do not belong together.
        """
        stage = self._devices.stage
        laser = self._devices.laser
        receiver = self._devices.receiver
        with self._held:
            stage.begin_sweep(self._permit.to_deg)
            self._await_speed()
            lit = self._readings[-1]
            laser.begin_sweep(self._permit)
            # A probe that is too slow ends the light: it stalls, or has reached the end.
            wanted = True
            while self._read() and (wanted := goes_on()):
                self._take(laser.pulses())
                self._keep(receiver.frames())
                yield self._matched()
                self._turn_back()
            fired = self._end(lit)
        stage.end_sweep()
        last_deg = self._readings[-1].angle_deg
        to_deg = self._permit.end_deg
        if wanted and (self._turns_back or not abs(last_deg - to_deg) <= SHORT_DEG):
            raise MoveError(
                f"the probe stopped at {last_deg:.3f} deg on its way to {to_deg:.3f} deg; look for an obstacle"
            )
        if fired != len(self._pulses):
            raise AcquisitionError(f"{len(self._pulses)} of {fired} pulses have a time; the sweep is refused whole")
        if self._turn_away is not None:
            last_deg = self._turn_away()
        self._keep_last(receiver.end_sweep(pulses=fired))
        if self._tissue is not None and self._pulses:
            await_known(self._tissue, self._clock, at_s=self._pulses[-1].at_s)
        yield self._matched(over=True)
        if self._told < len(self._frames):
            raise not_between(self._pulses[self._told], self._readings)
        return Swept(angle_deg=last_deg, pulses=fired)

    def _await_speed(self) -> None:
        """Run up without light, to the least speed at which the probe may be lit."""
        began_s = self._clock.now_s()
        may_be_lit = False
        while True:
            could_be_lit = may_be_lit
            may_be_lit = self._read()
            last = self._readings[-1]
            # A late reading alone says little of a speed that is still low.
            if may_be_lit and (could_be_lit or last.answered_s - last.asked_s <= _LATE_S):
                return
            if not self._clock.now_s() - began_s < BEGIN_S:
                raise MoveError(
                    f"the stage has not begun the sweep in {BEGIN_S:g} s, it is at {self._readings[-1].angle_deg:.3f} "
                    "deg; look for an obstacle"
                )

    def _read(self) -> bool:
        """Read the stage after a pause, and return whether the probe may be lit."""
        await_reading(self._clock, self._readings[-1])
        reading = self._next_reading()
        return self._guard.read_sweep(reading.angle_deg, now_s=self._way.moment_s(reading))

    def _next_reading(self) -> StageReading:
        reading = self._devices.stage.read_sweep()
        self._readings.append(reading)
        return reading

    def _way_to(self, target_deg: float) -> Way:
        """Return the way from where it stands now."""
        return Way(
            start=self._readings[-1],
            target_deg=target_deg,
            speed_deg_s=self._speed_deg_s,
            acceleration_deg_s2=self._devices.stage.acceleration_deg_s2,
        )

    def _turn_back(self) -> None:
        """Send the stage back once it is at rest where it turns; `MoveError` if it then stays there."""
        if self._permit.back_deg is None:
            return
        if self._rests and self._at_turn and self._turns_back:
            self._turning_s = self._clock.now_s()
            self._way = self._way_to(self._permit.back_deg)
            self._devices.stage.begin_sweep(self._permit.back_deg)
        elif self._rests and self._turning_s is not None and not self._clock.now_s() - self._turning_s < BACK_S:
            at_deg = self._readings[-1].angle_deg
            raise MoveError(f"the stage has not turned back at {at_deg:.3f} deg; look for an obstacle")

    @property
    def _turns_back(self) -> bool:
        """Whether the stage is still to be sent back."""
        return self._permit.back_deg is not None and self._turning_s is None

    @property
    def _rests(self) -> bool:
        """Whether the last readings are those of a stage at rest."""
        last = self._readings[-1]
        # Readings of nearly the same moment say nothing; an answer may be old by as much as it came late.
        apart = [each for each in self._readings if last.asked_s - each.answered_s >= 0.9 * READ_S]
        return bool(apart) and abs(last.angle_deg - apart[-1].angle_deg) <= AT_REST_DEG

    @property
    def _at_turn(self) -> bool:
        """Whether the probe is where it turns back, and may be lit at rest."""
        return self._permit.back_deg is not None and abs(self._readings[-1].angle_deg - self._permit.to_deg) <= TURN_DEG

    def _end(self, lit: StageReading) -> int:
        """End the light that began after that reading, brake, come to rest, and return how many pulses were fired."""
        lasted_s = self._clock.now_s() - lit.answered_s
        fired = self._devices.laser.end_sweep()
        if fired == 0 and not lasted_s <= DARK_PERIODS * self._permit.period_s:
            raise LaserError(f"no pulse came in {lasted_s:.2f} s of a sweep; check the laser and its trigger")
        self._take(self._devices.laser.pulses())
        self._devices.stage.brake()
        braked_s = self._clock.now_s()
        # The first reading encloses the last pulse; the others show that the probe is at rest.
        while (self._read() and not self._at_turn) or not self._rests:
            self._require_braking(braked_s)
        self._clock.wait(READ_S)
        last = self._next_reading()
        self._guard.end_sweep(last.angle_deg, pulses=fired, now_s=self._way.moment_s(last))
        return fired

    def _require_braking(self, braked_s: float) -> None:
        """`MoveError` if a stage that began to brake then should be at rest by now."""
        now_s = self._clock.now_s()
        if not now_s - braked_s < BEGIN_S + self._speed_deg_s / self._devices.stage.acceleration_deg_s2:
            raise MoveError(
                f"the stage does not stop, it is at {self._readings[-1].angle_deg:.3f} deg {now_s - braked_s:.2f} s "
                "after it was told to; look at the stage"
            )

    def _take(self, pulses: Sequence[Pulse]) -> None:
        """Keep the times of pulses, as far as the delay of their stamps is known; none comes faster than permitted."""
        now_s = self._clock.now_s()
        laser = self._devices.laser
        latest_s = now_s + CLOCKS_S + max(0.0, -laser.stamp_delay_s)
        latest_s += 4 * math.hypot(laser.delay_sigma_s, STAMP_SIGMA_S)
        for stamped in pulses:
            pulse = structs.replace(
                stamped,
                at_s=stamped.at_s + laser.stamp_delay_s,
                sigma_s=max(stamped.sigma_s, STAMP_SIGMA_S),
            )
            if not stamped.at_s <= latest_s + 4 * stamped.sigma_s:
                raise LaserError(
                    f"a pulse is stamped {stamped.at_s:.3f} s and it is {now_s:.3f} s: its clock is wrong; compare the "
                    "clocks, and start again"
                )
            # Against all pulses before, and not that before alone: a stamp may be milliseconds off by itself.
            behind_s = pulse.at_s - 0.9 * self._permit.period_s * len(self._pulses)
            self._latest_s = max(self._latest_s, behind_s)
            if not behind_s >= self._latest_s - RATE_SPARE_S:
                raise LaserError(
                    f"pulse {len(self._pulses) + 1} came {1e3 * (self._latest_s - behind_s):.0f} ms too early after "
                    f"those before, {1e3 * self._permit.period_s:.2f} ms between two is the least that was permitted; "
                    "check the laser's trigger"
                )
            _LOG.debug("pulse %s", stamped)
            self._pulses.append(pulse)

    def _keep(self, frames: Sequence[Frame]) -> None:
        """Keep frames; each is of the trigger after that of the frame before."""
        for frame in frames:
            if self._frames:
                before = self._frames[-1].header.sequence
                now = frame.header.sequence
                if now != before + 1:
                    raise AcquisitionError(
                        f"frame {now} came after frame {before}: a trigger was lost or doubled, and the sweep is "
                        "refused whole; check the trigger's cable"
                    )
            _LOG.debug("frame %s", frame.header)
            self._frames.append(frame)

    def _keep_last(self, frames: Sequence[Frame]) -> None:
        """Keep the last frames of a sweep, if there are as many as pulses, and the dark one after them is dark."""
        self._keep([frame for frame in frames if frame.header.pulses])
        self._guard.admit_sweep(len(self._frames))
        for frame in frames:
            if not frame.header.pulses:
                self._admit_dark(frame)

    def _matched(self, *, over: bool = False) -> list[SweptFrame]:
        """Return the frames between two readings, with their angles, once the displacement at them is known.

        ``over``: whether that was awaited, at the end of the sweep.
        """
        matched: list[SweptFrame] = []
        until_s = self._readings[-1].at_s
        if self._tissue is not None and not over:
            until_s = min(until_s, self._clock.now_s() - self._tissue.known_after_s)
        while self._told < min(len(self._frames), len(self._pulses)):
            pulse = self._pulses[self._told]
            if not pulse.at_s <= until_s:
                break
            matched.append(self._at(pulse, self._frames[self._told]))
            self._told += 1
        return matched

    def _at(self, pulse: Pulse, frame: Frame) -> SweptFrame:
        """Return a frame with the angle of its pulse, and what that angle may be off by."""
        stamped = stamped_angle(pulse, self._readings)
        # A controller that answers late may do so each time: its readings are then old by the same time, all of them.
        answer_s = max(each.answered_s - each.asked_s for each in (stamped.lower, stamped.upper)) / math.sqrt(12)
        # Of the way, and not of two readings: at rest at its end they may differ in any direction.
        turned = self._turning_s is not None and pulse.at_s >= self._turning_s
        forward = -self._permit.forward if turned else self._permit.forward
        backlash_deg = self._devices.stage.play_deg(forward)
        header = structs.replace(
            frame.header,
            angle_before_deg=stamped.lower.angle_deg,
            angle_after_deg=stamped.upper.angle_deg,
            energy=frame.header.energy if pulse.energy is None else pulse.energy,
        )
        return SweptFrame(
            frame=structs.replace(frame, header=header),
            # The probe lags behind the encoder by the backlash.
            angle_deg=stamped.angle_deg - forward * backlash_deg,
            angle_sigma_deg=stamped.sigma_deg,
            timing=SweepTiming(
                number=self._number,
                speed_deg_s=stamped.speed_deg_s,
                delay_sigma_s=math.hypot(self._devices.laser.delay_sigma_s, answer_s),
                play_sigma_deg=BACKLASH_ERROR * backlash_deg,
            ),
            displacement=None if self._tissue is None else self._tissue.displacement(pulse.at_s),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class StampedAngle:
    """The angle of a pulse by its stamp, between two readings of the stage."""

    lower: StageReading
    upper: StageReading
    angle_deg: float
    sigma_deg: float
    speed_deg_s: float


def stamped_angle(pulse: Pulse, readings: Sequence[StageReading]) -> StampedAngle:
    """Return the angle of a pulse by its time; `not_between` is raised where no two readings enclose it."""
    after = next((index for index, each in enumerate(readings) if each.at_s >= pulse.at_s), 0)
    if after == 0:
        raise not_between(pulse, readings)
    lower = readings[after - 1]
    upper = readings[after]
    interval_s = upper.at_s - lower.at_s
    share = (pulse.at_s - lower.at_s) / interval_s
    speed_deg_s = (upper.angle_deg - lower.angle_deg) / interval_s
    # A reading is of any moment between question and answer: uniform, of standard deviation 1/√12.
    read_s = math.hypot(
        (1 - share) * (lower.answered_s - lower.asked_s), share * (upper.answered_s - upper.asked_s)
    ) / math.sqrt(12)
    # At constant acceleration, half way between two readings, a chord is off by a·h²/8.
    bend_deg = 0.0
    if after > 1:
        first = readings[after - 2]
        before_deg_s = (lower.angle_deg - first.angle_deg) / (lower.at_s - first.at_s)
        bend_deg = abs(speed_deg_s - before_deg_s) * interval_s / 8
    return StampedAngle(
        lower=lower,
        upper=upper,
        angle_deg=lower.angle_deg + share * (upper.angle_deg - lower.angle_deg),
        sigma_deg=math.hypot(speed_deg_s * math.hypot(read_s, pulse.sigma_s), bend_deg),
        speed_deg_s=speed_deg_s,
    )


def not_between(pulse: Pulse, readings: Sequence[StageReading]) -> AcquisitionError:
    """Return the error of a pulse that no two readings of the stage enclose."""
    return AcquisitionError(
        f"a pulse at {pulse.at_s:.3f} s is not between two readings of the stage, from {readings[0].at_s:.3f} to "
        f"{readings[-1].at_s:.3f} s; the sweep is refused whole, compare the clocks"
    )
