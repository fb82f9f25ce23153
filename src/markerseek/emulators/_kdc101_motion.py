"""Motion of an emulated KDC101: moves, homing, stops, status bits, and the faults of the mechanics."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from markerseek.emulators._prm1z8 import Prm1z8
from markerseek.emulators.faults import Faults
from markerseek.wire import apt

# MGMSG_MOT_MOVE_COMPLETED, _MOVE_STOPPED and _MOVE_HOMED of the APT protocol.
COMPLETED, STOPPED, HOMED = 0x0464, 0x0466, 0x0444
"""Messages at the end of a move, after a stop, and at home."""

VELOCITY, JOG, LIMITS, BACKLASH, HOME, TARGET = 0x0413, 0x0416, 0x0423, 0x043A, 0x0440, 0x0450
"""Identities of the messages that set a parameter; identity + 1 requests the parameter, identity + 2 answers."""

_BEGINS_S = 5e-3
"""Delay from the command to the beginning of a move; until then the moving bits are clear."""
_STEP_S = 0.01
_TOP_SPEED_DEG_S = 25.0
_IGNORE_LIMIT = 1

POWER_UP: Mapping[int, bytes] = {
    VELOCITY: struct.pack("<H3i", apt.CHANNEL, 0, apt.acceleration_word(20), apt.speed_word(20)),
    JOG: struct.pack("<HH4iH", apt.CHANNEL, 2, apt.counts_of(5), 0, 147, apt.speed_word(10), 2),
    LIMITS: struct.pack("<3HIIH", apt.CHANNEL, 4, 4, 0, 0, _IGNORE_LIMIT),
    BACKLASH: struct.pack("<Hi", apt.CHANNEL, apt.counts_of(1.0)),
    HOME: struct.pack("<3Hii", apt.CHANNEL, 2, 1, apt.speed_word(10), apt.counts_of(4.0)),
    TARGET: struct.pack("<Hi", apt.CHANNEL, 0),
}
"""Parameters after a loss of power: twice the usual speed, no limits, and a backlash correction of 1 deg."""

# Status bits of MGMSG_MOT_GET_STATUSBITS in the APT protocol.
_MOVING_UP, _MOVING_DOWN, _CONNECTED, _HOMING, _HOMED, _ERROR, _ENABLED = (
    *(0x10, 0x20, 0x100, 0x200, 0x400, 0x4000),
    0x80000000,
)


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
        self._homing = self._error = self._braking = False
        self._then_deg: float | None = None
        self._pending: tuple[float, float] | None = None
        self._frozen: int | None = None
        self._commanded: int | None = None
        self.learn(POWER_UP)

    def learn(self, stored: Mapping[int, bytes]) -> None:
        """Set the parameters."""
        _channel, _least, acceleration, speed = struct.unpack("<H3i", stored[VELOCITY])
        _channel, _cw, _ccw, high, low, mode = struct.unpack("<3HiiH", stored[LIMITS])
        # Never 0: a driver may set speed 0, and the motor's equations divide by speed and acceleration.
        self._speed_deg_s = max(speed / apt.SPEED_WORD, 1e-6)
        self._acceleration_deg_s2 = max(acceleration / apt.ACCELERATION_WORD, 1e-3)
        self._home_speed_deg_s = max(struct.unpack("<3Hii", stored[HOME])[3] / apt.SPEED_WORD, 1e-6)
        self._backlash_deg = struct.unpack("<Hi", stored[BACKLASH])[1] / apt.COUNTS_PER_DEG
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
        overshoot, early = self._fault("overshoot"), self._fault("done too early")
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
        self._homing, self._homed = True, False
        self._pending = self._then_deg = None
        self._motor.target_deg = 360.0 * math.floor(self._motor.angle_deg / 360.0)
        if self._motor.at_rest:
            self._arrive()

    def stop(self, *, profiled: bool = False) -> None:
        """Stop at once without deceleration, or, if ``profiled``, with the deceleration that was set."""
        if self._fault("ignores stop") is None:
            if profiled:
                motor, acceleration = self._motor, self._acceleration_deg_s2
                motor.target_deg = motor.angle_deg + motor.speed_deg_s * abs(motor.speed_deg_s) / (2 * acceleration)
            else:
                self._motor.halt()
            self._pending = self._then_deg = None
            self._homing = False
        self._braking = not self._motor.at_rest
        if not self._braking:
            self.events.append(STOPPED)

    def _fail(self) -> None:
        """Apply the faults of the mechanics that are active now."""
        if self._fault("power cut"):
            self._motor.halt()
            self._pending = self._then_deg = None
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
        motor, acceleration_deg_s2 = self._motor, self._acceleration_deg_s2
        speed_deg_s = self._home_speed_deg_s if self._homing else self._speed_deg_s
        slow, fast, obstacle = self._fault("slow"), self._fault("too fast"), self._fault("obstacle")
        if slow is not None:
            speed_deg_s *= slow.amount
        if fast is not None:
            speed_deg_s = acceleration_deg_s2 = fast.amount
        motor.top_speed_deg_s = min(speed_deg_s, _TOP_SPEED_DEG_S)
        motor.acceleration_deg_s2 = acceleration_deg_s2
        motor.low_deg, motor.high_deg = -math.inf, math.inf
        if self._soft_range is not None and not self._homing:
            low_deg, high_deg = (self._stage.angle_of(counts) for counts in self._soft_range)
            # A motor that is outside already may still turn back.
            motor.low_deg, motor.high_deg = min(low_deg, motor.angle_deg), max(high_deg, motor.angle_deg)
        if obstacle is not None and (at_deg := self._stage.motor_angle_of(obstacle.amount)) >= motor.angle_deg:
            motor.high_deg = min(motor.high_deg, at_deg)

    def _begin(self, target_deg: float) -> None:
        self._error = self._braking = False
        self._then_deg = None
        # As in the device, downward moves overshoot and come back from below.
        if self._backlash_deg > 0 and target_deg < self._motor.angle_deg:
            self._then_deg, target_deg = target_deg, target_deg - self._backlash_deg
        self._motor.target_deg = target_deg
        if self._motor.at_rest:
            self._arrive()

    def _arrive(self) -> None:
        if self._then_deg is not None:
            self._motor.target_deg, self._then_deg = self._then_deg, None
        elif self._homing:
            self._homing, self._homed = False, True
            self._stage.offset -= self._stage.counts
            self.events.append(HOMED)
        else:
            self.events.append(STOPPED if self._braking else COMPLETED)
            self._braking = False

    def _end_by_error(self) -> None:
        self._motor.halt()
        self._then_deg = None
        self._error = True
