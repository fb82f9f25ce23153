"""One sweep: the stage turns, the laser fires single pulses, and each gives a sample at the angle where it was fired.

The angle of a pulse is interpolated between two readings of the stage, never taken from a set point.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

from markerseek.core import (
    AcquisitionError,
    Clock,
    Frame,
    LaserError,
    MoveError,
    Pulse,
    StageReading,
    SweepPermit,
    SweepTiming,
    Swept,
)
from markerseek.guard import Guard
from markerseek.scan._pulse_angle import not_between, stamped_angle
from markerseek.scan.sweeping_devices import TURN_DEG, SweepingDevices

READ_S = 0.05
"""Time from one reading of a turning stage to the next."""

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

SHORT_DEG = 1.0
"""Most by which a sweep that nobody ended may end before its end: it brakes earlier, and at least as hard."""


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
    ``admit_dark``: refuses a dark frame that holds a source. ``turn_away``: turns the probe to where it waits for the
    frames of a burst, and returns its angle; None: it stays.
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
        self._turning_s: float | None = None
        self._readings = [at]
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
        stage, laser, receiver = self._devices.stage, self._devices.laser, self._devices.receiver
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
        last_deg, to_deg = self._readings[-1].angle_deg, self._permit.end_deg
        if wanted and (self._turns_back or not abs(last_deg - to_deg) <= SHORT_DEG):
            raise MoveError(
                f"the probe stopped at {last_deg:.3f} deg on its way to {to_deg:.3f} deg; look for an obstacle"
            )
        if fired != len(self._pulses):
            raise AcquisitionError(f"{len(self._pulses)} of {fired} pulses have a time; the sweep is refused whole")
        if self._turn_away is not None:
            last_deg = self._turn_away()
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

    def _turn_back(self) -> None:
        """Send the stage back once it is at rest where it turns; `MoveError` if it then stays there."""
        if self._permit.back_deg is None:
            return
        if self._rests and self._at_turn and self._turns_back:
            self._turning_s = self._clock.now_s()
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
        """Whether the last two readings are those of a stage at rest."""
        return abs(self._readings[-1].angle_deg - self._readings[-2].angle_deg) <= AT_REST_DEG

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
        last = self._devices.stage.read_sweep()
        self._readings.append(last)
        self._guard.end_sweep(last.angle_deg, pulses=fired, now_s=last.at_s)
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
        now_s, laser = self._clock.now_s(), self._devices.laser
        latest_s = now_s + CLOCKS_S + max(0.0, -laser.stamp_delay_s)
        latest_s += 4 * math.hypot(laser.delay_sigma_s, STAMP_SIGMA_S)
        for stamped in pulses:
            pulse = replace(
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
        # A controller that answers late may do so each time: its readings are then old by the same time, all of them.
        answer_s = max(each.answered_s - each.asked_s for each in (stamped.lower, stamped.upper)) / math.sqrt(12)
        # Of the way, and not of two readings: at rest at its end they may differ in any direction.
        turned = self._turning_s is not None and pulse.at_s >= self._turning_s
        forward = -self._permit.forward if turned else self._permit.forward
        backlash_deg = self._devices.stage.play_deg(forward)
        header = replace(
            frame.header,
            angle_before_deg=stamped.lower.angle_deg,
            angle_after_deg=stamped.upper.angle_deg,
            energy=frame.header.energy if pulse.energy is None else pulse.energy,
        )
        return SweptFrame(
            frame=replace(frame, header=header),
            # The probe lags behind the encoder by the backlash.
            angle_deg=stamped.angle_deg - forward * backlash_deg,
            angle_sigma_deg=stamped.sigma_deg,
            timing=SweepTiming(
                number=self._number,
                speed_deg_s=stamped.speed_deg_s,
                delay_sigma_s=math.hypot(self._devices.laser.delay_sigma_s, answer_s),
                play_sigma_deg=BACKLASH_ERROR * backlash_deg,
            ),
        )
