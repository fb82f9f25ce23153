"""The rotation stage: a Thorlabs PRM1Z8 on a KDC101 or TDC001.

It never homes: homing ignores the soft limits and turns through whatever is in the way.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from typing import Annotated, Literal, TypeVar

from markerseek.core import (
    Clock,
    DeviceError,
    DeviceTimeoutError,
    Interval,
    LimitError,
    MoveError,
    NotConnectedError,
    Within,
)
from markerseek.drivers._exchanged import box_at
from markerseek.drivers._stage_rules import StageRules, StageStatus
from markerseek.drivers.entry import Entry, MotorKeys, Opening
from markerseek.drivers.serial_port import Unread
from markerseek.drivers.standard_stage import StandardSweepingStage, require_wide
from markerseek.files import Line
from markerseek.guard import Limits
from markerseek.wire import Port, apt

_SETTLE_DEG = 0.05
"""How far the servo of a PRM1Z8 swings at the end of a move: 0.02 to 0.05 deg."""

_TRIES = 3
_WITH_PORTS = ("KDC101",)
"""Controllers with trigger ports."""

_MAX_COUNTS = 2**30
"""Farthest from home that a stage can be: from there, targets still have 32 bits."""

DISABLED = "its channel is disabled, and its motor gets no current: arming the rig enables it"

_ANSWER_S = 0.1
_POLL_S = 1e-3
"""Time for an answer before the request is repeated, and between two looks for it, in seconds."""
_READ_BYTES = 4096
_LOST_AGES = 2
"""Multiple of the age allowed after which a question counts as lost."""

_AnswerT = TypeVar("_AnswerT", bound=apt.ControllerAnswer)


class AptLine:
    """A line to one controller.

    APT numbers neither requests nor answers. What arrived before a request is dropped; a later answer may still answer
    an earlier request, which was repeated because this computer or the line was slow. Answers keep the order of their
    requests, so each is at most as old as the first request that was open when it came. Where none comes within the age
    allowed, a late one is not waited for.

    ``clock``: all waiting is done on it. ``answer_s``: how long an answer may take before the request is repeated.
    ``age_s``: how old an answer may be: after that, silence is an error. ``since_s``: earliest time at which the
    request of the last answer can have been sent.
    """

    def __init__(self, *, port: Port, clock: Clock, answer_s: float, age_s: float) -> None:
        self._port = port
        self._clock = clock
        self.since_s = clock.now_s()
        self._answer_s = answer_s
        self._age_s = age_s
        self._framer = apt.AptFramer()
        self._open: defaultdict[int, deque[float]] = defaultdict(deque)
        self._garbled = False
        self._unread = Unread()

    def send(self, message: bytes) -> float:
        """Send a message that has no answer, and return the time just before, in seconds."""
        now_s = self._clock.now_s()
        self._port.write(message)
        return now_s

    def ask(self, question: bytes, ident: int, kind: type[_AnswerT]) -> _AnswerT:
        """Send a request and return its answer.

        ``ident``: identity of the message that answers. Raises `DeviceTimeoutError` if no answer comes in time.
        """
        self._take(ident)
        self._unread.clear()
        first_s = self._clock.now_s()
        while (asked_s := self._clock.now_s()) - first_s < self._age_s:
            self._open[ident].append(asked_s)
            self._port.write(question)
            again_s = min(asked_s + self._answer_s, first_s + self._age_s)
            while True:
                answer = self._take(ident)
                if isinstance(answer, kind):
                    return answer
                if not self._clock.now_s() < again_s:
                    break
                self._clock.wait(_POLL_S)
            # A message that began and did not end is garbled: its missing bytes would be taken from the next answer.
            self._framer.forget()
            if self._garbled and self._open[ident]:
                self._open[ident].popleft()
            self._garbled = False
        raise DeviceTimeoutError(
            f"the stage's controller gave no answer in {self._age_s:g} s: "
            + self._unread.said(cure="check its cable and its power, and that stage.port is its port")
        )

    def greet(self) -> apt.Info:
        """Return the identity of the controller; an error names the other device that answers at its port."""
        try:
            return self.ask(apt.ask(apt.INFO), apt.INFO, apt.Info)
        except DeviceTimeoutError as error:
            raise DeviceTimeoutError(f"{error}{box_at(self._port, self._clock)}") from None

    def close(self) -> None:
        """Close the line; allowed twice."""
        self._port.close()

    def _take(self, ident: int) -> apt.ControllerAnswer | None:
        """Return the last answer of that kind among the bytes that have arrived; None if there is none."""
        taken = None
        now_s = self._clock.now_s()
        data = self._port.read(_READ_BYTES, timeout_s=0.0)
        self._garbled = self._garbled or bool(data)
        self._unread.add(data)
        for message in self._framer.feed(data):
            self._garbled = False
            asked_s = self._open[message.ident].popleft() if self._open[message.ident] else now_s - self._age_s
            if message.ident == ident:
                try:
                    taken = apt.decode(message)
                except DeviceError:
                    # APT has no checksum: a damaged answer is dropped, and the request is repeated.
                    continue
                self.since_s = asked_s
        # A question this old was lost on the line.
        while self._open[ident] and now_s - self._open[ident][0] > _LOST_AGES * self._age_s:
            self._open[ident].popleft()
        return taken


class Kdc101Settings(MotorKeys, frozen=True, kw_only=True, tag="kdc101"):
    """Keys of the stage in a rig file."""

    port: str
    """Serial port of its controller."""
    approach_from: Literal["below", "above"] = "below"
    """Side, by the probe's angle, from which every target is approached."""
    play_deg: Annotated[float, Within(0, 5, "deg")] = 0.1
    """Backlash of the gears: by so much the probe lags in a sweep away from the side of approach, as ``markerseek
    calibrate --delay`` measures it."""
    age_s: Annotated[float, Within(0.01, 1, "s")] = 0.3
    """Greatest age of the controller's answer."""


class Kdc101Logic:
    """The verbs of the controller. Making one connects, checks and configures it; nothing moves."""

    def __init__(self, *, line: AptLine, settings: Kdc101Settings, travel: Interval) -> None:
        self._line = line
        self._settings = settings
        self._sense = settings.sense
        # Another program may have left the controller sending its status unasked, which would pass for answers.
        line.send(apt.stop_updates())
        self.identity = line.greet()
        self._require_device()
        status = self._status()
        _require_ready(status)
        self.enabled = status.enabled
        # A rotary stage may have been turned any number of times: the probe's zero is the one in this turn.
        turns = round((apt.degrees_of(status.position) - settings.zero_deg - self._sense * travel.centre_deg) / 360)
        self._zero = apt.counts_of(settings.zero_deg + 360 * turns)
        # With a reversed probe, the lowest reading of the stage belongs to the highest angle of the probe.
        low_deg, high_deg = sorted((self._sense * travel.low_deg, self._sense * travel.high_deg))
        # Rounded inwards: half a count too far would be outside the travel range.
        low = math.ceil(low_deg * apt.COUNTS_PER_DEG)
        high = math.floor(high_deg * apt.COUNTS_PER_DEG)
        limits = apt.SoftLimits(low=self._zero + low, high=self._zero + high)
        self._limits = limits
        if not limits.low <= status.position <= limits.high:
            raise LimitError(
                f"the stage is at {self._angle_of(status.position):.2f} deg, outside its travel {travel}; with the "
                "probe outside the patient, turn it back by the controller's wheel, or correct zero_deg or direction"
            )
        if self.identity.model in _WITH_PORTS:
            # First: another program may have left a trigger port that begins moves.
            ports = apt.TriggerPorts()
            self._keep("trigger ports", ports, apt.set_trigger_ports(ports), apt.TRIGGER_PORTS)
        self.velocity = apt.Velocity(
            acceleration=apt.acceleration_word(settings.acceleration_deg_s2),
            speed=apt.speed_word(settings.speed_deg_s),
        )
        self.set_speed(None)
        # The approach is the driver's: the controller's own overshoot could leave the travel range.
        self._keep("backlash", apt.Counts(counts=0), apt.set_backlash(0), apt.BACKLASH)
        self._keep("limits", limits, apt.set_limits(limits), apt.LIMITS)

    @property
    def emulated(self) -> bool:
        """Whether the controller says that it is an emulator."""
        return self.identity.emulated

    def read(self) -> StageStatus:
        """Return the status of the controller; an error that it reports, or a lost home, is a problem."""
        status = self._status()
        problem = ""
        if status.faults:
            problem = f"the stage reports: {', '.join(status.faults)}; look for an obstacle"
        elif not status.homed or status.homing:
            problem = (
                "the stage is not homed any more: it lost power, or was commanded to home; take the probe out of the "
                "patient and home it by the controller's menu"
            )
        return StageStatus(
            angle_deg=self._angle_of(status.position),
            moving=status.moving or status.homing,
            problem=problem,
            since_s=self._line.since_s,
            cure="look for an obstacle" if status.enabled else DISABLED,
        )

    def go(self, angle_deg: float) -> float:
        """Give a target, and let it go there only once the controller is known to have understood it."""
        target = apt.Counts(counts=self._counts_of(angle_deg))
        self._keep("target", target, apt.set_target(target.counts), apt.TARGET)
        return self._line.send(apt.move())

    def stop(self) -> None:
        """Stop at once, without deceleration."""
        self._line.send(apt.stop())

    def brake(self) -> None:
        """Stop with the deceleration that was set."""
        self._line.send(apt.stop(profiled=True))

    def enable(self) -> None:
        """Give its motor current if it has none, as after it was switched on with its channel disabled; nothing moves.

        Raises `MoveError` if the controller stays disabled. Raises `DeviceTimeoutError` if it does not answer.
        """
        # Its status says so, and not the answer to 0x0211: some controllers give none.
        for _ in range(_TRIES):
            self.enabled = self._status().enabled
            if self.enabled:
                return
            self._line.send(apt.enable_channel())
        self.enabled = self._status().enabled
        if not self.enabled:
            raise MoveError("the stage does not keep its channel enabled; enable it by the controller's menu")

    def set_speed(self, speed_deg_s: float | None) -> float:
        """Write the speed of what follows, and read it back; None: that of moves. The next start sets that again."""
        speed = self.velocity.speed if speed_deg_s is None else apt.speed_word(speed_deg_s)
        velocity = apt.Velocity(acceleration=self.velocity.acceleration, speed=speed)
        self._keep("speed and acceleration", velocity, apt.set_velocity(velocity), apt.VELOCITY)
        return speed / apt.SPEED_WORD

    def close(self) -> None:
        """Close the line; the stage stays where it is. Allowed twice."""
        self._line.close()

    def _status(self) -> apt.Status:
        return self._line.ask(apt.ask(apt.STATUS), apt.STATUS, apt.Status)

    def _keep(self, name: str, value: _AnswerT, message: bytes, ident: int) -> None:
        """Write a parameter and read it back, more than once if bytes get lost."""
        for _ in range(_TRIES):
            # Written and requested together: whichever is lost, both are sent again.
            read = self._line.ask(message + apt.ask(ident), ident, type(value))
            if read == value:
                return
        raise MoveError(f"the stage does not keep its {name}: {value} was written, {read} read back; check its type")

    def _require_device(self) -> None:
        info = self.identity
        wanted = self._settings.serial_number
        if info.model not in apt.CONTROLLERS:
            known = ", ".join(apt.CONTROLLERS)
            raise NotConnectedError(f"a {info.model} is at the stage's port, expected one of: {known}")
        if wanted is not None and info.serial_number != wanted:
            raise NotConnectedError(
                f"the stage's controller has the serial number {info.serial_number}, expected {wanted}; correct "
                "serial_number or the port"
            )

    def _angle_of(self, counts: int) -> float:
        return self._sense * apt.degrees_of(counts - self._zero)

    def _counts_of(self, angle_deg: float) -> int:
        """Return the nearest counts of an angle that are inside the travel range."""
        counts = self._zero + apt.counts_of(self._sense * angle_deg)
        return min(max(counts, self._limits.low), self._limits.high)


def _require_ready(status: apt.Status) -> None:
    if status.faults:
        raise MoveError(f"the stage reports: {', '.join(status.faults)}; switch it off and on, and home it")
    if status.moving or status.homing:
        raise MoveError("the stage is moving; wait until it is at rest, and end other programs that use it")
    # Never homed from here: homing ignores the soft limits.
    if not status.homed:
        raise MoveError(
            "the stage has not been homed since it was switched on and does not know its angle; homing turns it up to "
            "a whole turn whatever its limits: take the probe out of the patient, home it by the controller's menu, "
            "and start again"
        )
    if not abs(status.position) <= _MAX_COUNTS:
        raise MoveError(
            f"the stage reads {status.position} counts, more than a thousand turns from home; switch "
            "it off and on, and home it with the probe outside the patient"
        )


class Kdc101Stage(StandardSweepingStage[Kdc101Logic]):
    """A stage over APT. Making one connects, checks and configures it; nothing moves.

    - ``port``: the line to the controller, for instance a `markerseek.drivers.serial_port.SerialPort`.
    - ``clock``: all waiting is done on it, so that each wait renews a lease.
    - ``settings``: None: those of a controller whose zero is the probe's.
    - ``travel``: angles at which the probe may be; written to the controller as its soft limits.

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
    ) -> None:
        settings = settings or Kdc101Settings(port="", zero_deg=0.0)
        travel = travel or Limits().travel
        require_wide(travel, approach_deg=settings.approach_deg)
        line = AptLine(port=port, clock=clock, answer_s=_ANSWER_S, age_s=settings.age_s)
        logic = Kdc101Logic(line=line, settings=settings, travel=travel)
        rules = StageRules(
            # As rounded to the controller's words, not as set: small accelerations are off by up to a third.
            speed_deg_s=logic.velocity.speed / apt.SPEED_WORD,
            acceleration_deg_s2=logic.velocity.acceleration / apt.ACCELERATION_WORD,
            resolution_deg=1 / apt.COUNTS_PER_DEG,
            settle_deg=_SETTLE_DEG,
            begin_s=settings.begin_s,
            approach_from=settings.approach_from,
            approach_deg=settings.approach_deg,
        )
        super().__init__(logic, clock=clock, travel=travel, rules=rules, play=settings.play_deg)


def _open(settings: Kdc101Settings, opening: Opening) -> Kdc101Stage:
    stage = Kdc101Stage(port=opening.line, clock=opening.clock, settings=settings, travel=opening.limits.travel)
    opening.enables.append(stage.logic.enable)
    return stage


def _describe(settings: Kdc101Settings, stage: Kdc101Stage) -> str:
    identity = stage.logic.identity
    said = "" if stage.logic.enabled else f" ({DISABLED})"
    return f"{identity.model} {identity.serial_number} at {settings.port}{said}"


ENTRY: Entry[Kdc101Settings, Kdc101Stage] = Entry(
    settings=Kdc101Settings,
    open=_open,
    describe=_describe,
    line=lambda settings: Line(name="stage", path=settings.port, safe_command=apt.stop(), rtscts=True),
    same=("zero_deg", "direction", "approach_from"),
)
