"""Driver of the laser box (`markerseek.wire.laserbox`), which triggers laser and acquisition under a lease.

While the box has a permit, `beat` renews the lease. Only the control loop may call `beat`, never a timer:
`markerseek.drivers.clock.SystemClock` calls it during each wait. In a sweep `beat` renews the lease only while the loop
asks for the pulses often enough. If the loop waits for a silent stage, the light ends.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Annotated

from markerseek.core import (
    SWEEP_READING_S,
    Clock,
    ConfigError,
    DeviceTimeoutError,
    LaserError,
    NotConnectedError,
    Permit,
    Pulse,
    SweepPermit,
    Within,
)
from markerseek.drivers._laserbox_line import POLL_S, BoxLine, BoxSweep, cure, require_known, stray_light
from markerseek.drivers.clock import polls
from markerseek.drivers.entry import Entry, LaserKeys, Opening
from markerseek.drivers.standard_laser import LaserPermits
from markerseek.files import Line
from markerseek.wire import Port
from markerseek.wire import laserbox as wire

_SPARE_S = 0.5
"""Time from the last pulse to the end of its permit, in seconds."""

_BUSY_POLL_S = 0.05

_BOOT_S = 3.0
"""Longest time without an answer from a board that restarts when its port is opened, in seconds."""

_LONGEST_TRAIN_S = wire.MAX_EXPIRY_MS / 1e3 + 1
"""Longest time for which a box completes the triggers of an earlier firing, in seconds."""

_LAST_WAIT_S = 0.03
"""Time for which a box that seems silent is waited for once more in a sweep, in seconds."""

_TIME_S = 0.01
"""Longest wait for the time of the box's clock in a sweep, in seconds: a later answer bounds nothing closely enough,
and the stage must be read in time."""


class LaserBoxSettings(LaserKeys, frozen=True, kw_only=True, tag="laserbox"):
    """Keys of the laser box in a rig file."""

    port: str
    """Serial port of the laser box."""
    answer_s: Annotated[float, Within(0.1, 5, "s")] = 0.5
    """Longest time for an answer of the box."""
    stamp_delay_s: Annotated[float, Within(-0.1, 0.1, "s")] = 0.0
    """Delay from the stamp of a pulse to its light, relative to the stage's readings. ``markerseek calibrate --delay``
    measures it."""
    stamp_delay_sigma_s: Annotated[float, Within(1e-4, 0.1, "s")] = 10e-3
    """Standard deviation of that delay; the default is for a rig on which nobody has measured the delay."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.rate_hz <= wire.MAX_RATE_HZ or self.rate_hz != round(self.rate_hz):
            raise ConfigError(
                f"laser: rate_hz is {self.rate_hz} Hz, it must be a whole number from 1 to {wire.MAX_RATE_HZ}"
            )
        if not self.pulses / self.rate_hz <= wire.MAX_EXPIRY_MS / 1e3:
            raise ConfigError(
                f"laser: {self.pulses} pulses at {self.rate_hz} Hz take {self.pulses / self.rate_hz:g} s, the limit is "
                f"{wire.MAX_EXPIRY_MS / 1e3:g} s; average fewer pulses, or raise rate_hz"
            )


class LaserBox:
    """A laser that a laser box triggers.

    ``settings``: the defaults if None. Raises `NotConnectedError` if no box of this protocol answers, or if the box
    still triggers after the longest time that a firing can take.

    ``metered``: whether the photodiode also measures the light of the pulses. ``light_per_pulse``: mean light per pulse
    in the last firing, in counts of the photodiode; None before the first firing, or if the light is not measured.
    """

    def __init__(self, *, port: Port, clock: Clock, settings: LaserBoxSettings | None = None) -> None:
        settings = settings or LaserBoxSettings(port="")
        self._settings = settings
        self._line = BoxLine(port=port, clock=clock, answer_s=settings.answer_s)
        self._clock = clock
        self._rate_hz = round(settings.rate_hz)
        # A dark frame has as many triggers as a lit one, so that both are averages over the same number.
        self._dark_triggers = settings.pulses
        self._usual_light = settings.usual_energy if settings.energy_from == "photodiode" else None
        self._permits = LaserPermits("laser box", clock)
        self._settled = False
        self._seen = 0
        self._sweep: BoxSweep | None = None
        self._questions = 0
        self.metered = False
        self.light_per_pulse: float | None = None
        self._settle(boot_s=_BOOT_S)

    @property
    def emulated(self) -> bool:
        """Whether the box says that it is an emulator."""
        return self.identity == wire.EMULATOR

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses and return how many the photodiode saw; 0 pulses trigger the acquisition alone.

        Raises `LaserError` if the permit was used or is too short, if the box refuses, if pulses permitted, sent and
        seen differ, or if the photodiode has seen light outside of firings. Raises `DeviceTimeoutError` if the box does
        not answer in time. An error during the firing also sends DISARM.
        """
        self._permits.require_unused(permit)
        if not self._settled:
            self._settle()
        self._finish_sweep(within_s=_LONGEST_TRAIN_S)
        triggers = permit.pulses or self._dark_triggers
        needed_s = triggers / self._rate_hz
        left_s = self._permits.use(permit, needed_s=needed_s)
        try:
            with self._disarmed_by_errors():
                return self._fire(permit.pulses, triggers, expiry_s=min(left_s, needed_s + _SPARE_S))
        finally:
            self._line.holds_permit = False

    @property
    def sweep_period_s(self) -> float:
        """Least time between two pulses of a sweep, in seconds."""
        return max(1 / self._rate_hz, wire.MIN_PERIOD_US / 1e6)

    @property
    def delay_sigma_s(self) -> float:
        """Standard deviation of the delay of all pulses, in seconds."""
        return self._settings.stamp_delay_sigma_s

    @property
    def stamp_delay_s(self) -> float:
        """Time from the stamp of a pulse to its light, in seconds."""
        return self._settings.stamp_delay_s

    def prepare_sweep(self) -> None:
        """Greet the box, if it must be greeted.

        Raises `NotConnectedError` if it still sends the dark triggers of the last sweep.
        """
        with self._disarmed_by_errors():
            if not self._settled:
                self._settle(patience_s=0.0)
            self._finish_sweep(within_s=0.0)

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Begin to fire single pulses; refused as `fire` and `prepare_sweep` are."""
        left_s = self._permits.use(permit, needed_s=0.0)
        self.prepare_sweep()
        with self._disarmed_by_errors():
            self._token += 1
            now_s = self._clock.now_s()
            sweep = BoxSweep(
                token=self._token,
                pulses=permit.pulses,
                heard_s=now_s,
                stepped_s=now_s,
                usual_light=self._usual_light if self.metered else None,
            )
            self._use_permit(
                wire.PermitSweep(
                    token=self._token,
                    pulses=permit.pulses,
                    # Rounded up: two pulses are never nearer than permitted.
                    period_us=math.ceil(1e6 * permit.period_s - 1e-3),
                    expiry_ms=math.floor(min(1e3 * left_s, wire.MAX_EXPIRY_MS)),
                )
            )
            sweep.stepped_s = self._clock.now_s()
            self._sweep = sweep

    def pulses(self) -> Sequence[Pulse]:
        """Return the pulses of the sweep since the last call.

        Raises `LaserError` if a pulse is missing or double, if the box has ended the light by itself, or if its clock
        jumped. Raises `DeviceTimeoutError` if the box does not answer.
        """
        sweep = self._sweep
        if sweep is None:
            return ()
        with self._disarmed_by_errors():
            sweep.stepped_s = self._clock.now_s()
            if sweep.dark is None:
                self._ask_time(sweep)
                if not self._clock.now_s() - sweep.heard_s <= SWEEP_READING_S:
                    self._line.hear(sweep, within_s=_LAST_WAIT_S)
                if not self._clock.now_s() - sweep.heard_s <= SWEEP_READING_S:
                    raise DeviceTimeoutError("laser box: no answer during the sweep; check its cable and its power")
            sweep.require_light()
            new = sweep.new_pulses(now_s=self._clock.now_s())
            while sweep.ending and sweep.returned < len(sweep.stamped):
                # The light has ended, and nothing turns: the last pulses are known by more questions.
                self._ask_time(sweep)
                new += sweep.new_pulses(now_s=self._clock.now_s())
            return new

    def end_sweep(self) -> int:
        """End the light, and return how many pulses were fired; each has a stamp.

        Raises `LaserError` if pulses sent, seen and stamped differ. Raises `DeviceTimeoutError` if the box does not
        confirm the end.
        """
        sweep = self._sweep
        if sweep is None:
            return 0
        with self._disarmed_by_errors():
            if sweep.ending:
                return sweep.fired()
            sweep.require_light()
            sweep.ending = True
            self._line.holds_permit = False
            self._line.send(wire.Disarm())
            ends_s = self._clock.now_s() + self._settings.answer_s
            while not (sweep.disarmed and sweep.dark is not None):
                if not self._clock.now_s() <= ends_s:
                    raise DeviceTimeoutError("laser box: it does not confirm the end of the light; cut its power")
                self._line.hear(sweep, within_s=POLL_S)
            fired = sweep.fired()
            self._seen = (self._seen + fired) & wire.MAX_COUNT
            return fired

    def beat(self) -> None:
        """Renew the lease if the box has a permit and the last beat is old enough; the control loop calls it often."""
        now_s = self._clock.now_s()
        if self._sweep is None or now_s - self._sweep.stepped_s <= SWEEP_READING_S:
            self._line.beat()

    def disarm(self) -> None:
        """Take any permit away from the box.

        Raises `DeviceTimeoutError` if the box does not confirm it.
        """
        # Stop the beats first, even if the line fails now: without a permit there is no lease to renew.
        self._line.holds_permit = False
        if self._sweep is not None and not self._sweep.ending:
            self._sweep = None
            self._settled = False
        self._line.send(wire.Disarm())
        self._line.await_disarmed()

    @contextmanager
    def _disarmed_by_errors(self) -> Iterator[None]:
        """Send DISARM at any error, and greet the box again before the next command."""
        try:
            yield
        except BaseException:
            self._settled = False
            self._line.holds_permit = False
            self._sweep = None
            # If even this cannot be sent, the lease ends by itself; the first error is the one to report.
            with suppress(NotConnectedError):
                self._line.send(wire.Disarm())
            raise

    def _ask_time(self, sweep: BoxSweep) -> None:
        """Ask for the box's clock, and read all lines until the answer has come or is late."""
        self._questions += 1
        number = self._questions
        asked_s = self._clock.now_s()
        sweep.asked_s[number] = asked_s
        self._line.send(wire.AskTime(number=number))
        while number in sweep.asked_s and self._clock.now_s() - asked_s < _TIME_S:
            self._line.hear(sweep, within_s=_TIME_S)

    def _finish_sweep(self, *, within_s: float) -> None:
        """Wait until the box has sent the dark triggers of the last sweep; `LaserError` if there was light in them."""
        if self._sweep is None:
            return
        self._sweep = None
        seen = self._seen
        self._settle(patience_s=within_s)
        if self._seen != seen:
            raise stray_light(self._seen, seen)

    def _settle(self, *, patience_s: float = _LONGEST_TRAIN_S, boot_s: float = 0.0) -> None:
        """Greet the box, wait for the end of an earlier firing's triggers, and take over its token and its light count.

        Raises `NotConnectedError` if the box does not answer, still triggers after ``patience_s``, or is not known.
        """
        for _ in polls(self._clock, within_s=patience_s, every_s=_BUSY_POLL_S):
            try:
                greeting = self._line.greet(within_s=boot_s)
            except DeviceTimeoutError as error:
                raise NotConnectedError(f"{error}{self._line.stage_at()}") from error
            if isinstance(greeting, wire.Greeting):
                break
        else:
            raise NotConnectedError(
                f"laser box: it still sends the triggers of an earlier firing after {patience_s:g} s; switch it off "
                "and on, or check its firmware"
            )
        require_known(greeting)
        self.identity = greeting.identity
        self.metered = bool(greeting.meter)
        self._token = greeting.last_token
        self._seen = greeting.seen
        self._settled = True

    def _fire(self, pulses: int, triggers: int, *, expiry_s: float) -> int:
        self._token += 1
        ask = wire.PermitPulses(
            token=self._token,
            pulses=pulses,
            rate_hz=self._rate_hz,
            # Rounded down: the box's expiry must not be later than the permit's.
            expiry_ms=math.floor(min(1e3 * expiry_s, wire.MAX_EXPIRY_MS)),
            triggers=triggers,
        )
        self._use_permit(ask)
        done = self._line.next(within_s=triggers / self._rate_hz + self._settings.answer_s, after="FIRE")
        if not (isinstance(done, wire.Done) and done.token == self._token):
            raise LaserError(f"laser box: {done} answers the firing of {self._token}; {cure(done)}")
        # The photodiode's count has 31 bits and wraps around.
        self._seen = (self._seen + done.photodiode) & wire.MAX_COUNT
        if not done.sent == done.photodiode == pulses:
            raise LaserError(
                f"laser box: {pulses} pulses were permitted, {done.sent} sent and {done.photodiode} seen by the "
                "photodiode; check lease, interlock, laser and photodiode"
            )
        if self.metered and pulses:
            self.light_per_pulse = done.light / pulses
        return done.photodiode

    def _use_permit(self, ask: wire.PermitPulses | wire.PermitSweep) -> None:
        """Ask the box for a permit, and fire under it."""
        # Replies of an earlier command must not be taken for the answer to this permit.
        self._line.drop_replies()
        self._line.send(ask)
        answer = self._line.next(within_s=self._settings.answer_s, after=ask.head)
        # Skip late answers to earlier questions about the clock.
        while isinstance(answer, wire.Time):
            answer = self._line.next(within_s=self._settings.answer_s, after=ask.head)
        if not (isinstance(answer, wire.Permitted | wire.SweepPermitted) and answer.token == self._token):
            raise LaserError(f"laser box: {answer} answers the permit {self._token}; {cure(answer)}")
        if answer.seen != self._seen:
            raise stray_light(answer.seen, self._seen)
        # A beat before FIRE: PERMIT began the lease, and the answer may have taken most of it.
        self._line.holds_permit = True
        self.beat()
        self._line.send(wire.Fire(token=self._token))


def _open(settings: LaserBoxSettings, opening: Opening) -> LaserBox:
    box = LaserBox(port=opening.line, clock=opening.clock, settings=settings)
    opening.beats.append(box.beat)
    return box


ENTRY: Entry[LaserBoxSettings, LaserBox] = Entry(
    settings=LaserBoxSettings,
    open=_open,
    describe=lambda settings, _laser: f"laserbox at {settings.port}",
    line=lambda settings: Line(name="laser", path=settings.port, safe_command=wire.encode(wire.Disarm())),
)
