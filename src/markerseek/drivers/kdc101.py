"""The rotation stage: a Thorlabs PRM1Z8 on a KDC101 or TDC001.

It never homes: homing ignores the soft limits and turns through whatever is in the way. It never gives a target that
is more than a few degrees ahead: a computer that dies leaves the stage there, and not at the end of a long move.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Literal

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceError,
    Interval,
    LimitError,
    MoveError,
    StageReading,
    Triggers,
    fastest_sweep_deg_s,
    require_range,
)
from markerseek.drivers._approach import DOWN, UP, plan_approach, require_room, require_wide
from markerseek.drivers._apt_line import AptLine
from markerseek.drivers._kdc101_move import DISABLED, Kdc101Moves, Move, MoveRules, counts_per_s
from markerseek.drivers._kdc101_setup import (
    TRIGGERING_MODELS,
    enable,
    set_up,
    write_trigger_ports,
    write_trigger_row,
    write_velocity,
)
from markerseek.drivers._kdc101_sweep import SweepMove
from markerseek.drivers.entry import Entry, Opening, StageSettings
from markerseek.files import Line
from markerseek.guard import Limits
from markerseek.wire import Port, apt

_STOP_S = 1.0
_STOP_AGAIN_S = 0.02
_SAME_COUNTS = 2
_READS = 6


class Kdc101Settings(
    StageSettings, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="driver", tag="kdc101"
):
    """Keys of the stage in a rig file; angles are the probe's unless they are called the stage's own."""

    port: str
    """Serial port of its controller."""
    zero_deg: float
    """The stage's own reading at which the probe points at 0."""
    direction: Literal["forward", "reverse"] = "forward"
    """How the probe is mounted: "forward" if its angle grows with the stage's own reading, "reverse" if it falls. The
    default is an assumption: ``markerseek doctor --rig RIG.toml --source-deg ANGLE`` tests it."""
    serial_number: int | None = None
    """Serial number that the controller must have; None accepts any."""
    speed_deg_s: float = 10.0
    acceleration_deg_s2: float = 10.0
    """``speed_deg_s`` and ``acceleration_deg_s2``: speed and acceleration of its moves, in degrees per second and per
    second squared; at most 25."""
    approach_from: Literal["below", "above"] = "below"
    approach_deg: float = 1.0
    """``approach_from`` and ``approach_deg``: side, by the probe's angle, from which every target is approached, and
    over what distance, in degrees: longer than the gears' play."""
    play_deg: float = 0.1
    """Largest play of the gears: by so much the probe may lag in a sweep away from the side of approach."""
    begin_s: float = 0.5
    """Time without motion after which it counts as stuck."""
    age_s: float = 0.3
    """Greatest age of the controller's answer."""

    def __post_init__(self) -> None:
        for name, low, high, unit in (
            ("zero_deg", -360, 360, "deg"),
            ("speed_deg_s", 0.1, 25, "deg/s"),
            ("acceleration_deg_s2", 0.1, 25, "deg/s²"),
            ("approach_deg", 0.01, 5, "deg"),
            ("play_deg", 0, 5, "deg"),
            ("begin_s", 0.1, 5, "s"),
            ("age_s", 0.01, 1, "s"),
        ):
            require_range(f"stage: {name}", getattr(self, name), low=low, high=high, unit=unit)
        if self.approach_from not in ("below", "above"):
            raise ConfigError(f"stage: approach_from is {self.approach_from!r}, it must be 'below' or 'above'")
        if self.direction not in ("forward", "reverse"):
            raise ConfigError(f"stage: direction is {self.direction!r}, it must be 'forward' or 'reverse'")

    @property
    def sense(self) -> int:
        """1 if the probe's angle grows with the stage's own reading, -1 if it falls."""
        return 1 if self.direction == "forward" else -1


class Kdc101Stage:
    """A `markerseek.core.Stage` over APT. Making one connects, checks and configures it; nothing moves.

    - ``port``: the line to the controller, for instance a `markerseek.drivers.serial_port.SerialPort`.
    - ``clock``: all waiting is done on it, so that each wait renews a lease.
    - ``settings``: None: those of a controller whose zero is the probe's.
    - ``travel``: angles at which the probe may be; written to the controller as its soft limits.
    - ``enabled``: whether its motor gets current; if not, `enable` is the word of the person who arms the rig.
    - ``approach_reversed``: whether the last target was approached from the other side, because the travel range ends
      too soon: its angle is off by the backlash of the gears.

    Raises `NotConnectedError` if it is no stage of this kind. Raises `MoveError` if it moves, is not homed, or does not
    keep what is written to it. Raises `LimitError` if it is outside its travel range. Raises `DeviceTimeoutError` if it
    does not answer in time.
    """

    def __init__(
        self,
        *,
        port: Port,
        clock: Clock,
        settings: Kdc101Settings | None = None,
        travel: Interval | None = None,
        moves: Kdc101Moves | None = None,
    ) -> None:
        settings, moves = settings or Kdc101Settings(port="", zero_deg=0.0), moves or Kdc101Moves()
        self.limits = travel or Limits().travel
        require_wide(self.limits, approach_deg=settings.approach_deg)
        self._settings = settings
        self._clock = clock
        self._line = AptLine(port=port, clock=clock, answer_s=moves.answer_s, age_s=settings.age_s)
        self.approach_reversed = False
        self._usual = UP if settings.approach_from == "below" else DOWN
        self._pushed: int | None = None
        self._move: Move | None = None
        self._sweep: SweepMove | None = None
        self._has_speed_of_sweep = self._has_triggers = False
        self._velocity = velocity = apt.Velocity(
            acceleration=apt.acceleration_word(settings.acceleration_deg_s2),
            speed=apt.speed_word(settings.speed_deg_s),
        )
        connected = set_up(
            self._line,
            travel=self.limits,
            zero_deg=settings.zero_deg,
            sense=settings.sense,
            velocity=velocity,
            serial_number=settings.serial_number,
        )
        self.identity = connected.info
        self._zero, self.enabled = connected.zero, connected.enabled
        self._rest: int | None = connected.position
        self._rules = MoveRules.of(moves, limits=connected.limits, velocity=velocity, begin_s=settings.begin_s)

    def enable(self) -> None:
        """Give its motor current if it has none, as after it was switched on with its channel disabled; nothing moves.

        Raises `MoveError` if the controller stays disabled. Raises `DeviceTimeoutError` as `move_to`.
        """
        if not self._line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status).enabled:
            enable(self._line)
        self.enabled = True

    @property
    def emulated(self) -> bool:
        """Whether the controller says that it is an emulator."""
        return self.identity.emulated

    @property
    def seen_deg(self) -> float:
        """Angle of the last reading while it turns, in degrees, without another one; NaN at rest."""
        seen = None if self._move is None else self._move.seen
        return math.nan if seen is None else self._angle_of(seen)

    @property
    def angle_deg(self) -> float:
        """Readback of the angle, now, in degrees: two readings in a row that agree.

        Raises `MoveError` if it reports an error, or has turned by itself since it came to rest. Raises `LimitError` if
        it is outside its travel range; it was sent a stop.
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
            raise self._outside(angle_deg)
        self.end_sweep()
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

    @property
    def fastest_sweep_deg_s(self) -> float:
        """Largest speed of a sweep, in degrees per second."""
        return min(self._settings.speed_deg_s, fastest_sweep_deg_s(self.acceleration_deg_s2))

    @property
    def acceleration_deg_s2(self) -> float:
        """Acceleration as the controller keeps it, in degrees per second squared."""
        return self._velocity.acceleration / apt.ACCELERATION_WORD

    def play_deg(self, forward: float) -> float:
        """Largest play in a sweep in that direction: none where the gears push as in the approach of a target."""
        return 0.0 if forward == self._usual else self._settings.play_deg

    def prepare_sweep(self, *, speed_deg_s: float) -> None:
        """Set the speed of a sweep, and read it back.

        The next start sets that of moves again, if this program dies meanwhile. Raises `MoveError` if the controller
        does not keep it. Raises `DeviceTimeoutError` if it does not answer in time.
        """
        velocity = replace(self._velocity, speed=apt.speed_word(speed_deg_s))
        # Noted first: half of a write may have reached it.
        self._has_speed_of_sweep = True
        write_velocity(self._line, velocity)
        self._sweep_rules = replace(self._rules, speed=counts_per_s(velocity))

    @property
    def trigger_step_deg(self) -> float:
        """Least distance between two triggers, one count; `ConfigError` if the controller has none."""
        if self.identity.model not in TRIGGERING_MODELS:
            raise ConfigError(
                f"this rig cannot sweep position-triggered: its stage's controller is a {self.identity.model}, which "
                'gives no triggers; set laser.sweep_mode = "free-running"'
            )
        return 1 / apt.COUNTS_PER_DEG

    def set_triggers(self, *, from_deg: float, to_deg: float, spacing_deg: float) -> Triggers:
        """Give triggers at its port 1 in the sweep that follows, and read back that it will; none at its very ends.

        They are taken away by `end_sweep`, by `stop` even where that raises, and by the next program that connects.
        Raises as `prepare_sweep`.
        """
        start, way = self._counts_of(from_deg), self._counts_of(to_deg) - self._counts_of(from_deg)
        interval = math.ceil(spacing_deg * apt.COUNTS_PER_DEG)
        # A stage that comes to rest at its end may stay a count or two before it.
        number = (abs(way) - _SAME_COUNTS) // interval
        if number < 1:
            raise ConfigError(
                f"sweep: two triggers are {spacing_deg:.2f} deg apart, which leaves none from {from_deg:.2f} to "
                f'{to_deg:g} deg; widen the search range, or set laser.sweep_mode = "free-running"'
            )
        step = interval if way > 0 else -interval
        # Noted first: half of a write may have reached it.
        self._has_triggers = True
        write_trigger_row(
            self._line,
            apt.TriggerRow(start=start + step, interval=interval, number=number),
            mode=apt.TRIGGER_STEPS_UP if way > 0 else apt.TRIGGER_STEPS_DOWN,
        )
        angles_deg = tuple(self._angle_of(start + step * index) for index in range(1, number + 1))
        return Triggers(angles_deg=angles_deg, sigma_deg=self.trigger_step_deg / math.sqrt(12))

    def begin_sweep(self, to_deg: float) -> None:
        """Begin to turn there; refused by `LimitError` as `move_to`."""
        if to_deg not in self.limits:
            raise self._outside(to_deg)
        # Not read again where it is known: the first reading of the sweep must come soon, and is compared with it.
        start = self._readback() if self._rest is None else self._rest
        self._rest = self._pushed = None
        self._sweep = SweepMove(
            line=self._line, clock=self._clock, rules=self._sweep_rules, target=self._counts_of(to_deg), start=start
        )
        self._move = self._sweep.move

    def read_sweep(self) -> StageReading:
        """Where it is, with the times of question and answer; gives it a target at most some degrees ahead.

        Raises `MoveError` if it is where a sound stage cannot be, or reports an error. Raises `LimitError` if it left
        its travel range. Raises `DeviceTimeoutError` if it does not answer in time.
        """
        if self._sweep is None:
            raise MoveError("the stage does not sweep: it was stopped; begin the sweep again")
        reading = self._sweep.read()
        return StageReading(
            angle_deg=self._angle_of(reading.counts), asked_s=reading.asked_s, answered_s=reading.answered_s
        )

    def brake(self) -> None:
        """Begin to brake, with its acceleration."""
        if self._sweep is not None:
            self._sweep.brake()

    def end_sweep(self) -> None:
        """Give no triggers any more, and restore the speed of moves; raises as `prepare_sweep`."""
        sweep, self._sweep, self._move = self._sweep, None, None
        if sweep is not None:
            self._rest = sweep.position
            pushed = abs(sweep.position - sweep.start) >= self._settings.approach_deg * apt.COUNTS_PER_DEG
            self._pushed = self._settings.sense * sweep.heading if pushed else None
        # First: a speed that is not kept must leave no trigger behind.
        self._end_triggers()
        if self._has_speed_of_sweep:
            write_velocity(self._line, self._velocity)
            self._has_speed_of_sweep = False

    def stop(self) -> None:
        """Stop at once, and check that it is at rest; allowed at any time, also twice.

        After a sweep it has the speed of moves again. Raises `MoveError` if it keeps moving. Raises
        `DeviceTimeoutError` if it does not report whether it moves.
        """
        try:
            status = self._come_to_rest()
        except DeviceError:
            # No later move may give triggers either; the error to report is that it keeps moving.
            with suppress(DeviceError):
                self._end_triggers()
            raise
        self.end_sweep()
        if self._rest is None or abs(status.position - self._rest) > _SAME_COUNTS:
            self._rest = self._pushed = None

    def _come_to_rest(self) -> apt.Status:
        """Stop, until two answers in a row say that it is at rest."""
        ends_s = self._clock.now_s() + _STOP_S
        before: int | None = None
        while True:
            # Sent again each time: without a checksum, a damaged stop is ignored and nobody reports it.
            self._line.send(apt.stop())
            status = self._line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status)
            at_rest = not (status.moving or status.homing)
            if at_rest and before is not None and abs(status.position - before) <= _SAME_COUNTS:
                return status
            if not self._clock.now_s() < ends_s:
                raise MoveError("the stage was told to stop and keeps moving; cut its power")
            before = status.position if at_rest else None
            self._clock.wait(_STOP_AGAIN_S)

    def _end_triggers(self) -> None:
        """Give no triggers any more."""
        if self._has_triggers:
            write_trigger_ports(self._line, mode=apt.TRIGGER_OFF)
            self._has_triggers = False

    def close(self) -> None:
        """Close the line; the stage stays where it is. Allowed twice."""
        self._line.close()

    def _stop_after_error(self) -> None:
        """Stop after an error; a second error here must not hide the first."""
        self._rest = self._pushed = None
        with suppress(DeviceError):
            self.stop()

    def _outside(self, angle_deg: float) -> LimitError:
        return LimitError(f"stage: {angle_deg:g} deg is outside its travel {self.limits}; nothing was moved")

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


def _open(settings: Kdc101Settings, opening: Opening) -> Kdc101Stage:
    stage = Kdc101Stage(port=opening.line, clock=opening.clock, settings=settings, travel=opening.limits.travel)
    opening.arm_with(stage.enable)
    return stage


def _describe(settings: Kdc101Settings, stage: Kdc101Stage) -> str:
    said = "" if stage.enabled else f" ({DISABLED})"
    return f"{stage.identity.model} {stage.identity.serial_number} at {settings.port}{said}"


ENTRY: Entry[Kdc101Settings, Kdc101Stage] = Entry(
    settings=Kdc101Settings,
    open=_open,
    describe=_describe,
    line=lambda settings: Line(name="stage", path=settings.port, safe_command=apt.stop(), rtscts=True),
    same=("zero_deg", "direction", "approach_from"),
    require_room=lambda settings, limits: require_room(
        limits, approach_from=settings.approach_from, approach_deg=settings.approach_deg
    ),
)
