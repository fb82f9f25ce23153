"""One sweep: the stage turns, the laser fires single pulses, and each gives a sample at the angle where it was fired.

The angle of a pulse is interpolated between two readings of the stage, never taken from a set point. Where the stage
triggers the laser by its position, it is the encoder's at the trigger, and the interpolated one must agree with it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from typing import cast

from markerseek.core import (
    MAX_AHEAD_DEG,
    AcquisitionError,
    Clock,
    ConfigError,
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
    TriggeringStage,
    Triggers,
)
from markerseek.guard import Guard
from markerseek.scan._pulse_angle import AGREE_DEG, READ_LATE_S, TriggerCount, not_between, stamped_angle

READ_S = 0.05
"""Time from one reading of a turning stage to the next."""

SLOWEST, FASTEST = 0.2, 1.25
"""Speeds between which the probe is lit, as shares of the speed of the sweep: pulses on the ramps count, too."""

SLOWER = 1.1
"""Time of a sweep over that which the stage's own numbers give: it may be slower than it says."""

BEGIN_S = 1.0
"""Time within which a stage must have begun to turn, and within which it must have come to rest after braking."""

IN_FUTURE_S = 2e-3
"""Most by which a pulse may be stamped later than it is reported: the clocks are compared to 1 ms."""

DARK_PERIODS = 3
"""Periods of the laser in which at least one pulse must come."""

AT_REST_DEG = 0.005
"""Most by which two readings of a stage at rest differ: ten counts of a PRM1Z8's encoder."""

SHORT_DEG = 1.0
"""Most by which a sweep that nobody ended may end before its end: it brakes earlier, and at least as hard."""

TRIGGER_SPARE = 1.1
"""Time between two triggers at the speed of the sweep, over the least between two pulses: a servo is never exact, and
a trigger that comes too early gives no light."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepingDevices:
    """Stage, laser and receiver of a rig that can sweep."""

    stage: SweepingStage
    laser: SweepingLaser
    receiver: SweepingReceiver

    @classmethod
    def of(cls, stage: Stage, laser: Laser, receiver: Receiver) -> SweepingDevices:
        """The devices, if all three can; `ConfigError` names the one that cannot."""
        for part, device in (("stage", stage), ("laser", laser), ("receiver", receiver)):
            # Of the class, and no isinstance: it would ask the device for its angle.
            if not hasattr(type(device), "begin_sweep"):
                # Of a class of one's own the name in the rig file, not that of what is wrapped around it.
                name = getattr(device, "driver", type(device).__name__)
                raise ConfigError(
                    f"this rig cannot sweep: its {part} ({name}) only works with the probe at rest; leave --sweep out"
                )
        devices = cls(stage=stage, laser=laser, receiver=receiver)  # type: ignore[arg-type]
        # Asked here, since a device of a kind that can may not be set up for it.
        _ = devices.least_period_s, devices.triggering
        return devices

    @property
    def triggering(self) -> TriggeringStage | None:
        """The stage, if its triggers give the pulses; None where the laser runs free.

        Raises `ConfigError` if they are to, and the stage has none.
        """
        if not getattr(self.laser, "position_triggered", False):
            return None
        if not hasattr(type(self.stage), "set_triggers"):
            raise ConfigError(
                f"this rig cannot sweep position-triggered: its stage ({type(self.stage).__name__}) gives no triggers; "
                'set laser.sweep_mode = "free-running"'
            )
        stage = cast("TriggeringStage", self.stage)
        _ = stage.trigger_step_deg
        return stage

    @property
    def least_period_s(self) -> float:
        """Least time between two pulses, in seconds."""
        return max(self.laser.sweep_period_s, self.receiver.frame_period_s)

    @property
    def in_bursts(self) -> bool:
        """Whether the frames of a sweep are read at its end, all as one acquisition."""
        return self.receiver.sweep_readout_s > 0

    def permit(self, sweep: Sweep, *, from_deg: float, dark: int = 0, mark: int = 0) -> SweepPermit:
        """The permit that a sweep needs, without token and expiry; `ConfigError` if it is too fast for the stage.

        ``dark``: triggers that must be left without light at the end. ``mark``: further ones.
        """
        speed, fastest = sweep.speed_deg_s, self.stage.fastest_sweep_deg_s
        if not speed <= fastest:
            raise ConfigError(
                f"sweep: {speed:g} deg/s is too fast for this stage, whose targets lie at most {MAX_AHEAD_DEG:g} deg "
                f"ahead: at most {math.floor(100 * fastest) / 100:g} deg/s"
            )
        # The floor of the speed keeps two pulses apart by the spacing also on the ramps; 0.8 leaves it room below.
        period_s = max(self.least_period_s, sweep.spacing_deg / (0.8 * speed))
        if self.triggering is None:
            lasts = self.duration_s(sweep, from_deg=from_deg) / period_s
            pulses = max(math.ceil(SLOWER * lasts) + 1, math.ceil(lasts) + dark)
        else:
            pulses = math.ceil(abs(sweep.to_deg - from_deg) / trigger_spacing_deg(sweep, period_s=period_s)) + dark
        return SweepPermit(
            token="",
            angle_deg=from_deg,
            pulses=pulses + mark,
            expires_s=0.0,
            to_deg=sweep.to_deg,
            # By a billionth more, so that rounding does not put two pulses nearer than the spacing.
            slowest_deg_s=max(SLOWEST * speed, (1 + 1e-9) * sweep.spacing_deg / period_s),
            fastest_deg_s=FASTEST * speed,
            period_s=period_s,
            spacing_deg=sweep.spacing_deg,
        )

    def set_triggers(self, sweep: Sweep, permit: SweepPermit) -> Triggers | None:
        """Have the stage give a trigger for each pulse of that sweep; None where the laser runs free."""
        stage = self.triggering
        if stage is None:
            return None
        return stage.set_triggers(
            from_deg=permit.angle_deg,
            to_deg=permit.to_deg,
            spacing_deg=trigger_spacing_deg(sweep, period_s=permit.period_s),
        )

    def require_in_time(self, sweep: Sweep, permit: SweepPermit, *, now_s: float) -> None:
        """Refuse a sweep by `ConfigError` if its permit may expire on the way: nothing has moved."""
        duration_s, left_s = self.duration_s(sweep, from_deg=permit.angle_deg), permit.expires_s - now_s
        if not SLOWER * duration_s <= left_s:
            raise ConfigError(
                f"sweep: it takes {duration_s:.1f} s at {sweep.speed_deg_s:g} deg/s, and its permit holds for "
                f"{left_s:.1f} s; sweep faster"
            )

    def duration_s(self, sweep: Sweep, *, from_deg: float) -> float:
        """Time of a sweep in seconds, run-up and braking included."""
        way_deg = abs(sweep.to_deg - from_deg)
        speed, acceleration = sweep.speed_deg_s, self.stage.acceleration_deg_s2
        if way_deg <= speed**2 / acceleration:
            return 2 * math.sqrt(way_deg / acceleration)
        return way_deg / speed + speed / acceleration


def trigger_spacing_deg(sweep: Sweep, *, period_s: float) -> float:
    """Distance between two triggers of a sweep, whose pulses must not be nearer than the period.

    Half of it is never less than what a sound rig's stamps may be off by: else a late readout would pass for a lost
    trigger.
    """
    speed_deg_s = sweep.speed_deg_s
    return max(sweep.spacing_deg, TRIGGER_SPARE * speed_deg_s * period_s, 2 * (AGREE_DEG + READ_LATE_S * speed_deg_s))


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptFrame:
    """A frame of a sweep, with the angle of its pulse."""

    frame: Frame
    angle_deg: float
    angle_sigma_deg: float
    timing: SweepTiming


class SweepInProgress:
    """One sweep from its redeemed permit on; the guard is SWEEPING until the probe is at rest again.

    ``held``: holds the watchdog's lease while the probe turns. ``at``: readback and time at which the permit was used.
    ``admit_dark``: refuses a dark frame that holds a source. ``triggers``: where the stage triggers the laser; None
    where that runs free. ``lit_braking``: as of the `Sweep`.
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
        triggers: Triggers | None = None,
        lit_braking: bool = False,
    ) -> None:
        self._devices = devices
        self._triggers = None if triggers is None else TriggerCount(triggers)
        self._permit = permit
        self._speed_deg_s = speed_deg_s
        self._guard = guard
        self._clock = clock
        self._held = held
        self._number = number
        self._admit_dark = admit_dark
        self._lit_braking = lit_braking
        self._braked_s: float | None = None
        self._readings = [at]
        self._pulses: list[Pulse] = []
        self._frames: list[Frame] = []
        self._told = 0

    def frames(self, goes_on: Callable[[], bool]) -> Generator[list[SweptFrame], None, Swept]:
        """Turn, and return the frames with their angles as they come, then where the probe came to rest.

        Those of a burst come all at once, and are admitted before the first is used: none grows old meanwhile.

        ``goes_on``: whether more of the sweep is wanted; if not, the light ends, then the motion, or both together
        where the sweep says so. `AcquisitionError` refuses the sweep as a whole: frames and pulses do not belong
        together.
        """
        stage, laser, receiver = self._devices.stage, self._devices.laser, self._devices.receiver
        with self._held:
            stage.begin_sweep(self._permit.to_deg)
            self._await_speed()
            lit_s = self._clock.now_s()
            laser.begin_sweep(self._permit)
            # A probe that is too slow ends the light: it stalls, or has reached the end.
            wanted = True
            while self._read():
                if wanted and not (wanted := goes_on()):
                    if not self._lit_braking:
                        break
                    self._brake()
                if not wanted:
                    self._require_braking()
                    if self._too_slow_next():
                        break
                self._take(laser.pulses())
                self._keep(receiver.frames())
                yield self._matched()
            fired = self._end(lit_s=lit_s)
        stage.end_sweep()
        last_deg = self._readings[-1].angle_deg
        if wanted and not abs(last_deg - self._permit.to_deg) <= SHORT_DEG:
            to_deg = self._permit.to_deg
            raise MoveError(
                f"the probe stopped at {last_deg:.3f} deg on its way to {to_deg:.3f} deg; look for an obstacle"
            )
        if fired != len(self._pulses):
            raise AcquisitionError(f"{len(self._pulses)} of {fired} pulses have a time; the sweep is refused whole")
        self._keep_last(receiver.end_sweep(pulses=fired))
        yield self._matched()
        if self._told < len(self._frames):
            raise not_between(self._pulses[self._told], self._readings)
        return Swept(angle_deg=last_deg, pulses=fired)

    def _await_speed(self) -> None:
        """Run up without light, to the least speed at which the probe may be lit."""
        began_s = self._clock.now_s()
        while not self._read():
            if not self._clock.now_s() - began_s < BEGIN_S:
                raise MoveError(
                    f"the stage has not begun the sweep in {BEGIN_S:g} s, it is at {self._readings[-1].angle_deg:.3f} "
                    "deg; look for an obstacle"
                )

    def _read(self) -> bool:
        """Read the stage after a pause, and return whether the probe may be lit."""
        self._clock.wait(READ_S)
        reading = self._devices.stage.read_sweep()
        self._readings.append(reading)
        return self._guard.read_sweep(reading.angle_deg, now_s=reading.at_s)

    def _too_slow_next(self) -> bool:
        """Whether a probe that brakes would be too slow for light by the next reading."""
        before, last = self._readings[-2:]
        interval_s = last.at_s - before.at_s
        # The mean speed is that of the middle of the interval, and the next reading is one interval ahead.
        lost_deg_s = 1.5 * interval_s * self._devices.stage.acceleration_deg_s2
        return abs(last.angle_deg - before.angle_deg) / interval_s - lost_deg_s < self._permit.slowest_deg_s

    def _end(self, *, lit_s: float) -> int:
        """End the light that began then, brake, come to rest, and return how many pulses were fired."""
        lasted_s = self._clock.now_s() - lit_s
        fired = self._devices.laser.end_sweep()
        apart_s = self._permit.period_s
        if self._triggers is not None and len(self._triggers.angles_deg) > 1:
            first_deg, second_deg, *_ = self._triggers.angles_deg
            apart_s = max(apart_s, abs(second_deg - first_deg) / self._permit.slowest_deg_s)
        if fired == 0 and not lasted_s <= DARK_PERIODS * apart_s:
            raise LaserError(f"no pulse came in {lasted_s:.2f} s of a sweep; check the laser and its trigger")
        self._take(self._devices.laser.pulses())
        self._brake()
        # The first reading encloses the last pulse; the others show that the probe is at rest.
        while self._read() or abs(self._readings[-1].angle_deg - self._readings[-2].angle_deg) > AT_REST_DEG:
            self._require_braking()
        self._clock.wait(READ_S)
        last = self._devices.stage.read_sweep()
        self._readings.append(last)
        self._guard.end_sweep(last.angle_deg, pulses=fired, now_s=last.at_s)
        return fired

    def _brake(self) -> None:
        """Have the stage brake; what it takes to come to rest counts from the first time on."""
        self._devices.stage.brake()
        if self._braked_s is None:
            self._braked_s = self._clock.now_s()

    def _require_braking(self) -> None:
        """`MoveError` if the stage should be at rest by now."""
        now_s = self._clock.now_s()
        braked_s = now_s if self._braked_s is None else self._braked_s
        if not now_s - braked_s < BEGIN_S + self._speed_deg_s / self._devices.stage.acceleration_deg_s2:
            raise MoveError(
                f"the stage does not stop, it is at {self._readings[-1].angle_deg:.3f} deg {now_s - braked_s:.2f} s "
                "after it was told to; look at the stage"
            )

    def _take(self, pulses: Sequence[Pulse]) -> None:
        """Keep the times of pulses, which come in order and no faster than permitted."""
        now_s = self._clock.now_s()
        for pulse in pulses:
            if not pulse.at_s <= now_s + IN_FUTURE_S + 4 * pulse.sigma_s:
                raise LaserError(
                    f"a pulse is stamped {pulse.at_s:.3f} s and it is {now_s:.3f} s: its clock is wrong; compare the "
                    "clocks, and start again"
                )
            if self._pulses:
                apart_s = pulse.at_s - self._pulses[-1].at_s
                least_s = 0.9 * self._permit.period_s - 4 * pulse.sigma_s
                if not apart_s >= least_s:
                    raise LaserError(
                        f"two pulses came {1e3 * apart_s:.2f} ms apart, {1e3 * self._permit.period_s:.2f} ms is the "
                        "least that was permitted; check the laser's trigger"
                    )
            self._pulses.append(pulse)

    def _keep(self, frames: Sequence[Frame]) -> None:
        """Keep frames; each is of the trigger after that of the frame before."""
        for frame in frames:
            if self._frames:
                before, now = self._frames[-1].header.sequence, frame.header.sequence
                if now != before + 1:
                    raise AcquisitionError(
                        f"frame {now} came after frame {before}: a trigger was lost or doubled, and the sweep is "
                        "refused whole; check the trigger's cable"
                    )
            self._frames.append(frame)

    def _keep_last(self, frames: Sequence[Frame]) -> None:
        """Keep the last frames of a sweep, if there are as many as pulses, and the dark one after them is dark."""
        self._keep([frame for frame in frames if frame.header.pulses])
        self._guard.admit_sweep(len(self._frames))
        for frame in frames:
            if not frame.header.pulses:
                self._admit_dark(frame)

    def _matched(self) -> list[SweptFrame]:
        """Frames whose pulse lies between two readings, with the angle at it."""
        matched: list[SweptFrame] = []
        while self._told < min(len(self._frames), len(self._pulses)):
            pulse = self._pulses[self._told]
            if not pulse.at_s <= self._readings[-1].at_s:
                break
            matched.append(self._at(pulse, self._frames[self._told]))
            self._told += 1
        return matched

    def _at(self, pulse: Pulse, frame: Frame) -> SweptFrame:
        """A frame with the angle of its pulse, and what that angle may be off by."""
        stamped = stamped_angle(pulse, self._readings)
        angle_deg, sigma_deg = stamped.angle_deg, stamped.sigma_deg
        if self._triggers is not None:
            angle_deg, sigma_deg = self._triggers.angle_deg(pulse, stamped), self._triggers.sigma_deg
        header = replace(
            frame.header, angle_before_deg=stamped.lower.angle_deg, angle_after_deg=stamped.upper.angle_deg
        )
        return SweptFrame(
            frame=replace(frame, header=header),
            angle_deg=angle_deg,
            angle_sigma_deg=sigma_deg,
            timing=SweepTiming(
                number=self._number,
                speed_deg_s=stamped.speed_deg_s,
                delay_sigma_s=self._devices.laser.delay_sigma_s,
                play_sigma_deg=self._devices.stage.play_deg(self._permit.forward),
            ),
        )
