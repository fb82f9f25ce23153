"""Motion of an emulated KDC101 and its PRM1Z8: moves, homing, stops, status bits, and the faults of the mechanics.

Motor, encoder, backlash and the probe that it turns are pure, and exact in time.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from markerseek.emulators.faults import Faults
from markerseek.sim import phases
from markerseek.wire import apt

# Sums of phases miss a step's end by rounding; a remainder of this size is no time, and must not start a phase.
_NO_TIME_S = 1e-12


@dataclass(slots=True, kw_only=True)
class Motor:
    """A motor with trapezoidal speed, whose target may change during a move."""

    angle_deg: float
    target_deg: float
    speed_deg_s: float = 0.0
    """``angle_deg`` and ``speed_deg_s``: angle, and speed with its sign."""
    top_speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    """``top_speed_deg_s`` and ``acceleration_deg_s2``: largest speed, and acceleration."""
    low_deg: float = -math.inf
    high_deg: float = math.inf
    """``low_deg`` and ``high_deg``: angles at which it stops at once: a soft limit, or an obstacle."""
    lowest_deg: float = math.inf
    highest_deg: float = -math.inf
    """``lowest_deg`` and ``highest_deg``: smallest and largest angle that it has reached."""

    @property
    def at_rest(self) -> bool:
        """Whether it is at rest at its target."""
        return self.speed_deg_s == 0 and self.angle_deg == self.target_deg

    def halt(self) -> None:
        """Stop at once, and stay."""
        self.speed_deg_s = 0.0
        self.target_deg = self.angle_deg

    def advance(self, duration_s: float) -> bool:
        """Turn for that long; return whether it stopped at a limit."""
        left_s = duration_s
        self._note()
        for phase_s, acceleration in phases(
            self.target_deg - self.angle_deg,
            speed_deg_s=self.speed_deg_s,
            top_deg_s=self.top_speed_deg_s,
            acceleration_deg_s2=self.acceleration_deg_s2,
        ):
            step_s = min(phase_s, left_s)
            self.angle_deg += self.speed_deg_s * step_s + acceleration * step_s**2 / 2
            self.speed_deg_s += acceleration * step_s
            left_s -= step_s
            # Checked at the end of a phase only: within one the speed keeps its sign, so its end is the farthest point.
            if not self.low_deg <= self.angle_deg <= self.high_deg:
                self.angle_deg = min(max(self.angle_deg, self.low_deg), self.high_deg)
                self.halt()
                self._note()
                return True
            self._note()
            if left_s <= _NO_TIME_S:
                break
        if left_s > _NO_TIME_S or (abs(self.angle_deg - self.target_deg) < 1e-9 and abs(self.speed_deg_s) < 1e-6):
            self.angle_deg = self.target_deg
            self.speed_deg_s = 0.0
            self._note()
        return False

    def _note(self) -> None:
        self.lowest_deg = min(self.lowest_deg, self.angle_deg)
        self.highest_deg = max(self.highest_deg, self.angle_deg)


class Turned(Protocol):
    """The true angle of the probe, as in `markerseek.sim.SimulatedWorld`."""

    angle_deg: float


_SWING_S = 0.15
_SWING_ENDS_S = 0.1
"""Period of the servo's swings at the end of a move, and time in which they fall to 1/e, in seconds."""
_LARGEST_SWING = 0.707
"""Largest value of exp(-t/_SWING_ENDS_S) * sin(2 pi t/_SWING_S)."""


class Prm1z8:
    """A motor with an encoder, and a probe that it turns with some backlash.

    Angles of the motor are the stage's own, counted from its home; the probe's are the world's.

    ``zero_deg``: angle of the motor at which the probe points at 0. ``play_deg``: backlash between motor and probe:
    after an upward move the probe is at the motor's angle, after a downward move it lags by the backlash. ``sense``: 1
    if the probe turns as the motor does, -1 if it is mounted the other way round, the backlash included. ``fault``:
    its faults. ``settle_deg``: how far the servo swings beyond the end of a move.
    """

    def __init__(
        self,
        *,
        probe: Turned,
        zero_deg: float,
        play_deg: float,
        sense: int,
        fault: Faults,
        rng: np.random.Generator,
        settle_deg: float = 0.0,
    ) -> None:
        start_deg = sense * probe.angle_deg + zero_deg
        self.motor = Motor(angle_deg=start_deg, target_deg=start_deg)
        self.lowest_deg = probe.angle_deg
        self.highest_deg = self.lowest_deg
        self.offset = 0
        self._probe = probe
        self._zero_deg = zero_deg
        self._play_deg = play_deg
        self._sense = sense
        self._fault = fault
        self._jumped = False
        self._rng = rng
        self._jumps_in_s: float | None = None
        self._settle_deg = settle_deg
        self._heading = 0.0
        self._rested_s = math.inf

    @property
    def counts(self) -> int:
        """Value of the position counter."""
        return round((self.motor.angle_deg + self._swing_deg) * apt.COUNTS_PER_DEG) + self.offset

    @property
    def _swing_deg(self) -> float:
        """How far the servo is off the end of its move."""
        if not self._settle_deg or self._rested_s > 10 * _SWING_ENDS_S:
            return 0.0
        swing = math.exp(-self._rested_s / _SWING_ENDS_S) * math.sin(2 * math.pi * self._rested_s / _SWING_S)
        return self._heading * self._settle_deg / _LARGEST_SWING * swing

    def angle_of(self, counts: int) -> float:
        """Return the angle of the motor at which the position counter has that value, in degrees."""
        return (counts - self.offset) / apt.COUNTS_PER_DEG

    def motor_angle_of(self, probe_deg: float) -> float:
        """Return the angle of the motor at which it pushes the probe to that angle, in degrees."""
        return self._sense * probe_deg + self._zero_deg

    def advance(self, duration_s: float) -> bool:
        """Turn for that long; return whether the motor stopped before its target."""
        motor = self.motor
        jump = self._fault("readback jump")
        if jump is not None and not self._jumped:
            self._jumped = True
            self.offset += round(jump.amount * apt.COUNTS_PER_DEG)
        if motor.at_rest:
            self._rested_s += duration_s
            return False
        motor.lowest_deg = math.inf
        motor.highest_deg = -math.inf
        before_deg = motor.angle_deg
        stopped = motor.advance(duration_s)
        self._heading = math.copysign(1.0, motor.angle_deg - before_deg)
        self._rested_s = 0.0
        self._jump_on_its_way(duration_s)
        # The limits are checked against the whole path of the motor, turning points included.
        for angle_deg in {motor.lowest_deg, motor.highest_deg} - {motor.angle_deg, math.inf, -math.inf}:
            self._turn_probe(angle_deg)
        self._turn_probe(motor.angle_deg)
        return stopped

    def _jump_on_its_way(self, turned_s: float) -> None:
        """Make the counter jump once, after the motor has turned for a random time with this fault."""
        jump = self._fault("jump on its way")
        if jump is None or self._jumps_in_s == -math.inf:
            return
        if self._jumps_in_s is None:
            self._jumps_in_s = self._rng.uniform(0.0, 1.0)
        self._jumps_in_s -= turned_s
        if self._jumps_in_s <= 0 and not self.motor.at_rest:
            self._jumps_in_s = -math.inf
            self.offset += round(jump.amount * apt.COUNTS_PER_DEG)

    def _turn_probe(self, motor_deg: float) -> None:
        pushed_deg = motor_deg - self._zero_deg
        # The probe moves only when one side of the gap pushes it: clamp it to the gap, in the motor's direction.
        farthest_deg = pushed_deg + self._play_deg
        angle_deg = self._sense * min(max(self._sense * self._probe.angle_deg, pushed_deg), farthest_deg)
        self._probe.angle_deg = angle_deg
        self.lowest_deg = min(self.lowest_deg, angle_deg)
        self.highest_deg = max(self.highest_deg, angle_deg)


# MGMSG_MOT_MOVE_COMPLETED, _MOVE_STOPPED and _MOVE_HOMED of the APT protocol.
COMPLETED = 0x0464
_STOPPED = 0x0466
HOMED = 0x0444
"""Messages at the end of a move, after a stop, and at home."""

SET_VELOCITY = 0x0413
SET_JOG = 0x0416
SET_LIMITS = 0x0423
SET_BACKLASH = 0x043A
SET_HOME = 0x0440
SET_TARGET = 0x0450
"""Identities of the messages that set a parameter; identity + 1 requests the parameter, identity + 2 answers."""

_BEGINS_S = 5e-3
"""Delay from the command to the beginning of a move; until then the moving bits are clear."""
_STEP_S = 0.01
_TOP_SPEED_DEG_S = 25.0
_IGNORE_LIMIT = 1

POWER_UP: Mapping[int, bytes] = {
    SET_VELOCITY: struct.pack("<H3i", apt.CHANNEL, 0, apt.acceleration_word(20), apt.speed_word(20)),
    SET_JOG: struct.pack("<HH4iH", apt.CHANNEL, 2, apt.counts_of(5), 0, 147, apt.speed_word(10), 2),
    SET_LIMITS: struct.pack("<3HIIH", apt.CHANNEL, 4, 4, 0, 0, _IGNORE_LIMIT),
    SET_BACKLASH: struct.pack("<Hi", apt.CHANNEL, apt.counts_of(1.0)),
    SET_HOME: struct.pack("<3Hii", apt.CHANNEL, 2, 1, apt.speed_word(10), apt.counts_of(4.0)),
    SET_TARGET: struct.pack("<Hi", apt.CHANNEL, 0),
}
"""Parameters after a loss of power: twice the usual speed, no limits, and a backlash correction of 1 deg."""

# Status bits of MGMSG_MOT_GET_STATUSBITS in the APT protocol.
_MOVING_UP = 0x10
_MOVING_DOWN = 0x20
_CONNECTED = 0x100
_HOMING = 0x200
_HOMED = 0x400
_ERROR = 0x4000
_ENABLED = 0x80000000


class MotionControl:
    """Moves, homes and stops a PRM1Z8.

    ``fault``: faults of the device. ``moves``: number of moves that began at rest. ``largest_lead_deg``: largest
    distance from the motor to a new target, in degrees. ``events``: messages to send without a request; the caller
    clears them. ``enabled``: whether the motor gets current; without current it accepts moves but does not turn.
    """

    def __init__(self, *, stage: Prm1z8, fault: Faults) -> None:
        self.moves = 0
        self.largest_lead_deg = 0.0
        self.events: list[int] = []
        self.enabled = True
        self._stage = stage
        self._motor = stage.motor
        self._fault = fault
        self._now_s = 0.0
        self.wake_up(homed=True)

    @property
    def position(self) -> int:
        """Position counter as the controller reports it."""
        if self._commanded is not None and self._fault("says it is there"):
            return self._commanded
        return self._stage.counts if self._frozen is None else self._frozen

    @property
    def bits(self) -> int:
        """Status bits as the controller reports them."""
        motor = self._motor
        bits = _CONNECTED | (_ENABLED if self.enabled else 0)
        if not motor.at_rest and not self._fault("hides its moves"):
            bits |= _MOVING_UP if motor.target_deg > motor.angle_deg else _MOVING_DOWN
        for flag, bit in ((self._homing, _HOMING), (self._homed, _HOMED), (self._error, _ERROR)):
            bits |= bit if flag else 0
        return bits

    @property
    def speed_deg_s(self) -> float:
        """Speed of the motor, in degrees per second."""
        return self._motor.speed_deg_s

    def wake_up(self, *, homed: bool) -> None:
        """Restart: keep only the angle of the motor and, if ``homed``, the position counter."""
        self._motor.halt()
        self._stage.offset = 0 if homed else self._stage.offset - self._stage.counts
        self._homed = homed
        self._homing = False
        self._error = False
        self._braking = False
        self._then_deg: float | None = None
        self._pending: tuple[float, float] | None = None
        self._frozen: int | None = None
        self._commanded: int | None = None
        self.learn(POWER_UP)

    def learn(self, stored: Mapping[int, bytes]) -> None:
        """Set the parameters."""
        _channel, _least, acceleration, speed = struct.unpack("<H3i", stored[SET_VELOCITY])
        _channel, _cw, _ccw, high, low, mode = struct.unpack("<3HiiH", stored[SET_LIMITS])
        # Never 0: a driver may set speed 0, and the motor's equations divide by speed and acceleration.
        self._speed_deg_s = max(speed / apt.SPEED_WORD, 1e-6)
        self._acceleration_deg_s2 = max(acceleration / apt.ACCELERATION_WORD, 1e-3)
        self._home_speed_deg_s = max(struct.unpack("<3Hii", stored[SET_HOME])[3] / apt.SPEED_WORD, 1e-6)
        self._backlash_deg = struct.unpack("<Hi", stored[SET_BACKLASH])[1] / apt.COUNTS_PER_DEG
        self._soft_range = None if mode == _IGNORE_LIMIT else (low, high)

    def advance(self, now_s: float) -> None:
        """Advance the motion to a time."""
        self._fail()
        while now_s > self._now_s:
            until_s = now_s
            if self._pending is not None:
                until_s = min(now_s, max(self._pending[0], self._now_s))
            if self._then_deg is not None:
                # Short steps, so that the return from an overshoot begins when the overshoot ends.
                until_s = min(until_s, self._now_s + _STEP_S)
            self._turn(until_s - self._now_s)
            self._now_s = until_s
            if self._pending is not None and self._pending[0] <= until_s:
                target_deg = self._pending[1]
                self._pending = None
                self._begin(target_deg)

    def go(self, counts: int) -> None:
        """Move to a position in counts: at once if the motor already turns, after a delay if it is at rest."""
        if not self.enabled:
            return
        motor = self._motor
        target_deg = self._stage.angle_of(counts)
        self._commanded = counts
        self.largest_lead_deg = max(self.largest_lead_deg, abs(target_deg - motor.angle_deg))
        if motor.at_rest and self._pending is None:
            self.moves += 1
            self._fail()
        overshoot = self._fault("overshoot")
        early = self._fault("done too early")
        if overshoot is not None:
            target_deg += math.copysign(overshoot.amount, target_deg - motor.angle_deg)
        if self._fault("says done") or self._fault("says it is there"):
            self.events.append(COMPLETED)
        elif not motor.at_rest:
            self._begin(target_deg)
        else:
            if early is not None:
                self.events.append(COMPLETED)
            begins_s = self._now_s + (_BEGINS_S if early is None else early.amount)
            self._pending = (begins_s if self._pending is None else self._pending[0], target_deg)

    def go_home(self) -> None:
        """Turn down to the home switch; as in the device, soft limits do not apply."""
        if not self.enabled:
            return
        self.moves += 1
        # Not homed until it reaches the switch, as the device reports it: a homing that was stopped must show.
        self._homing = True
        self._homed = False
        self._pending = None
        self._then_deg = None
        self._motor.target_deg = 360.0 * math.floor(self._motor.angle_deg / 360.0)
        if self._motor.at_rest:
            self._arrive()

    def stop(self, *, profiled: bool = False) -> None:
        """Stop at once without deceleration, or, if ``profiled``, with the deceleration that was set."""
        if self._fault("ignores stop") is None:
            if profiled:
                motor = self._motor
                acceleration = self._acceleration_deg_s2
                motor.target_deg = motor.angle_deg + motor.speed_deg_s * abs(motor.speed_deg_s) / (2 * acceleration)
            else:
                self._motor.halt()
            self._pending = None
            self._then_deg = None
            self._homing = False
        self._braking = not self._motor.at_rest
        if not self._braking:
            self.events.append(_STOPPED)

    def _fail(self) -> None:
        """Apply the faults of the mechanics that are active now."""
        if self._fault("power cut"):
            self._motor.halt()
            self._pending = None
            self._then_deg = None
        if self._fault("stall") and not self._motor.at_rest:
            self._end_by_error()
        if self._fault("frozen readback") is None:
            self._frozen = None
        elif self._frozen is None:
            self._frozen = self._stage.counts

    def _turn(self, duration_s: float) -> None:
        if self._fault("frozen motor"):
            return
        moving = not self._motor.at_rest
        if moving:
            self._prepare()
        if self._stage.advance(duration_s):
            if self._fault("obstacle"):
                self._end_by_error()
            else:
                self._arrive()
        elif moving and self._motor.at_rest:
            self._arrive()

    def _prepare(self) -> None:
        motor = self._motor
        acceleration_deg_s2 = self._acceleration_deg_s2
        speed_deg_s = self._home_speed_deg_s if self._homing else self._speed_deg_s
        slow = self._fault("slow")
        fast = self._fault("too fast")
        obstacle = self._fault("obstacle")
        if slow is not None:
            speed_deg_s *= slow.amount
        if fast is not None:
            speed_deg_s = fast.amount
            acceleration_deg_s2 = speed_deg_s
        motor.top_speed_deg_s = min(speed_deg_s, _TOP_SPEED_DEG_S)
        motor.acceleration_deg_s2 = acceleration_deg_s2
        motor.low_deg = -math.inf
        motor.high_deg = math.inf
        if self._soft_range is not None and not self._homing:
            low_deg, high_deg = (self._stage.angle_of(counts) for counts in self._soft_range)
            # A motor that is outside already may still turn back.
            motor.low_deg = min(low_deg, motor.angle_deg)
            motor.high_deg = max(high_deg, motor.angle_deg)
        if obstacle is not None and (at_deg := self._stage.motor_angle_of(obstacle.amount)) >= motor.angle_deg:
            motor.high_deg = min(motor.high_deg, at_deg)

    def _begin(self, target_deg: float) -> None:
        self._error = False
        self._braking = False
        self._then_deg = None
        # As in the device, downward moves overshoot and come back from below.
        if self._backlash_deg > 0 and target_deg < self._motor.angle_deg:
            self._then_deg = target_deg
            target_deg = target_deg - self._backlash_deg
        self._motor.target_deg = target_deg
        if self._motor.at_rest:
            self._arrive()

    def _arrive(self) -> None:
        if self._then_deg is not None:
            self._motor.target_deg = self._then_deg
            self._then_deg = None
        elif self._homing:
            self._homing = False
            self._homed = True
            self._stage.offset -= self._stage.counts
            self.events.append(HOMED)
        else:
            self.events.append(_STOPPED if self._braking else COMPLETED)
            self._braking = False

    def _end_by_error(self) -> None:
        self._motor.halt()
        self._then_deg = None
        self._error = True
