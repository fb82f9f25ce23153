"""The rotation stage: a Thorlabs PRM1Z8 on a KDC101 or TDC001.

It never homes: homing ignores the soft limits and turns through whatever is in the way. It never gives a target that
is more than a few degrees ahead: a computer that dies leaves the stage there, and not at the end of a long move.
"""

from __future__ import annotations

import math

from markerseek.core import Clock, DeviceError, Interval, LimitError, MoveError
from markerseek.drivers._approach import DOWN, UP, plan_approach
from markerseek.drivers._apt_line import AptLine
from markerseek.drivers._kdc101_move import Move, MoveRules
from markerseek.drivers._kdc101_settings import Kdc101DriverSettings
from markerseek.drivers._kdc101_setup import set_up
from markerseek.wire import Port, apt

__all__ = ["Kdc101DriverSettings", "Kdc101Stage"]

_STOP_S = 1.0
_STOP_AGAIN_S = 0.02
_SAME_COUNTS = 2
_READS = 6


class Kdc101Stage:
    """A `markerseek.core.Stage` over APT. Making one connects, checks and configures it; nothing moves.

    - ``port``: the line to the controller, for instance a `markerseek.drivers.serial_port.SerialPort`.
    - ``clock``: all waiting is done on it, so that each wait renews a lease.
    - ``approach_reversed``: whether the last target was approached from the other side, because the travel range ends
      too soon: its angle is off by the backlash of the gears.

    Raises `NotConnectedError` if it is no stage of this kind. Raises `MoveError` if it moves, is not homed, or does not
    keep what is written to it. Raises `LimitError` if it is outside its travel range. Raises `DeviceTimeoutError` if it
    does not answer in time.
    """

    def __init__(self, *, port: Port, clock: Clock, settings: Kdc101DriverSettings | None = None) -> None:
        settings = settings or Kdc101DriverSettings()
        self._settings = settings
        self._clock = clock
        self._line = AptLine(port=port, clock=clock, answer_s=settings.answer_s, age_s=settings.age_s)
        self.approach_reversed = False
        self._usual = UP if settings.approach_from == "below" else DOWN
        self._pushed: int | None = None
        self._move: Move | None = None
        velocity = apt.Velocity(
            acceleration=apt.acceleration_word(settings.acceleration_deg_s2),
            speed=apt.speed_word(settings.speed_deg_s),
        )
        connected = set_up(
            self._line,
            travel=settings.travel,
            zero_deg=settings.zero_deg,
            sense=settings.sense,
            velocity=velocity,
            serial_number=settings.serial_number,
        )
        self.identity = connected.info
        self._zero = connected.zero
        self._rest: int | None = connected.position
        self._rules = MoveRules(
            low=connected.limits.low,
            high=connected.limits.high,
            # As rounded to the controller's words, not as set: small accelerations are off by up to a third.
            speed=velocity.speed / apt.SPEED_WORD * apt.COUNTS_PER_DEG,
            acceleration=velocity.acceleration / apt.ACCELERATION_WORD * apt.COUNTS_PER_DEG,
            # One count less, since the motor may be anywhere within the count that is read.
            lead=math.floor(settings.lead_deg * apt.COUNTS_PER_DEG) - 1,
            renew_s=settings.renew_s,
            arrival=round(settings.arrival_deg * apt.COUNTS_PER_DEG),
            unexpected=round(settings.unexpected_deg * apt.COUNTS_PER_DEG),
            begin_s=settings.begin_s,
        )

    @property
    def limits(self) -> Interval:
        """Angles that it accepts."""
        return self._settings.travel

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading while it turns, in degrees, without another one; NaN at rest."""
        seen = None if self._move is None else self._move.seen
        return math.nan if seen is None else self._angle_of(seen)

    @property
    def angle_deg(self) -> float:
        """Readback of the angle, now, in degrees: two readings in a row that agree.

        Raises `MoveError` if it reports an error, or has turned by itself since it came to rest. Raises `LimitError` if
        it is outside its travel range; it was told to stop.
        """
        try:
            return self._angle_of(self._readback())
        except DeviceError:
            self._stop_after_error()
            raise

    def move_to(self, angle_deg: float) -> float:
        """Move to an angle, approach it from the usual side, come to rest, and return the readback in degrees.

        Raises `LimitError` if the angle is NaN or outside the travel range, and nothing moves; or if the stage left
        that range. Raises `MoveError` if it does not arrive. Raises `DeviceTimeoutError` if it stops answering.
        """
        if angle_deg not in self.limits:
            raise LimitError(f"stage: {angle_deg:g} deg is outside its travel {self.limits}; nothing was moved")
        here = self._readback()
        approach = plan_approach(
            angle_deg,
            here_deg=self._angle_of(here),
            pushed=self._pushed,
            usual=self._usual,
            room_deg=self._settings.approach_deg,
            travel=self.limits,
            same_deg=_SAME_COUNTS / 2 / apt.COUNTS_PER_DEG,
        )
        arrived = False
        self._rest = self._pushed = None
        try:
            for stop_deg in approach.stops_deg:
                self._move = Move(line=self._line, clock=self._clock, rules=self._rules)
                here = self._move.go(self._counts_of(stop_deg), here)
            arrived = True
        finally:
            # In `finally`, so that Ctrl-C stops the stage too.
            self._move = None
            if not arrived:
                self._stop_after_error()
        # From here on the stage must read this position: any other means that something turned it.
        self._rest, self._pushed = here, approach.direction
        self.approach_reversed = approach.reversed
        return self._angle_of(here)

    def stop(self) -> None:
        """Stop at once, and check that it is at rest; allowed at any time, also twice.

        Raises `MoveError` if it keeps moving. Raises `DeviceTimeoutError` if it does not report whether it moves.
        """
        ends_s = self._clock.now_s() + _STOP_S
        before: int | None = None
        while True:
            # Sent again each time: without a checksum, a damaged stop is ignored and nobody reports it.
            self._line.send(apt.stop())
            status = self._line.ask(apt.ask_status(), apt.STATUS, apt.Status)
            at_rest = not (status.moving or status.homing)
            if at_rest and before is not None and abs(status.position - before) <= _SAME_COUNTS:
                break
            if not self._clock.now_s() < ends_s:
                raise MoveError("the stage was told to stop and keeps moving; cut its power")
            before = status.position if at_rest else None
            self._clock.wait(_STOP_AGAIN_S)
        if self._rest is None or abs(status.position - self._rest) > _SAME_COUNTS:
            self._rest = self._pushed = None

    def close(self) -> None:
        """Close the line; the stage stays where it is. Allowed twice."""
        self._line.close()

    def _stop_after_error(self) -> None:
        """Stop after an error; a second error here must not hide the first."""
        self._rest = self._pushed = None
        try:
            self.stop()
        except DeviceError:
            return

    def _readback(self) -> int:
        """Position in counts, read twice in a row: a garbled answer does not come twice."""
        last: int | None = None
        for _ in range(_READS):
            status = Move(line=self._line, clock=self._clock, rules=self._rules, rest=self._rest).look()
            if last is not None and abs(status.position - last) <= _SAME_COUNTS:
                return status.position
            last = status.position
        raise MoveError("the stage turns without a command; keep hands off its wheel, and end other programs")

    def _angle_of(self, counts: int) -> float:
        return self._settings.sense * apt.degrees_of(counts - self._zero)

    def _counts_of(self, angle_deg: float) -> int:
        """Nearest counts of an angle that are inside the travel range."""
        return min(max(self._zero + apt.counts_of(self._settings.sense * angle_deg), self._rules.low), self._rules.high)
