"""Driver of the laser box (`markerseek.wire.laserbox`), which triggers laser and acquisition under a lease.

While a permit is held, `beat` renews the lease; it counts the control loop's own steps and must be called from there,
never from a timer. A clock that waits calls it (`markerseek.drivers.clock.SystemClock`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from typing import TypeGuard, TypeVar

from markerseek.core import (
    Clock,
    ConfigError,
    DeviceTimeoutError,
    LaserError,
    NotConnectedError,
    Permit,
    require_range,
)
from markerseek.drivers.entry import Entry, LaserSettings, Opening
from markerseek.files import Line
from markerseek.wire import Port
from markerseek.wire import laserbox as wire

_BEAT_S = 0.02
"""Time between two beats, in seconds: five of them in the longest lease."""

_POLL_S = 0.002

_MIN_LEASE_MS = 50
"""Shortest lease in milliseconds that survives one lost beat."""

_SPARE_S = 0.5
"""Time from the last pulse to the end of its permit, in seconds."""

_BUSY_POLL_S = 0.05

_LONGEST_TRAIN_S = wire.MAX_EXPIRY_MS / 1e3 + 1
"""Longest time for which a box completes the triggers of an earlier firing, in seconds."""

_MAX_TOKENS = wire.MAX_COUNT - 1_000_000
"""Highest token that a box may have used before: enough are left for a session."""

_Kind = TypeVar("_Kind", bound=wire.Reply)

_CURES = {
    "CRC": "a line was damaged on its way: check cable and earthing",
    "FORM": "it does not know the command: check its firmware's version",
    "TOKEN": "the permit is gone, by a lapsed lease or a restart of the box: arm and start again",
    "STEP": "a beat came twice: does another program use it?",
    "INTERLOCK": "the interlock is open: close it, then arm again",
    "BUSY": "it still sends the triggers of another firing: does another program use it?",
    "BUDGET": f"it sends at most {wire.MAX_PULSES_PER_MINUTE} pulses a minute: wait a minute, or average fewer",
}


class LaserBoxSettings(
    LaserSettings, frozen=True, kw_only=True, forbid_unknown_fields=True, tag_field="driver", tag="laserbox"
):
    """Keys of the laser box in a rig file."""

    port: str
    """Serial port of the laser box."""
    answer_s: float = 0.5
    """Longest time for its answer."""


class LaserBox:
    """A laser that a laser box triggers.

    ``rate_hz``: pulses per second, a whole number. ``dark_triggers``: how often the acquisition is triggered for a dark
    frame: as often as for a lit one, so that both average alike. ``answer_s``: longest time for an answer. Raises
    `NotConnectedError` if no box of this protocol answers, or it keeps triggering for longer than any firing takes.

    ``metered``: whether its photodiode measures the light of the pulses as well. ``light_per_pulse``: what it read of a
    pulse of the last firing in the mean, in counts of its own; None where it does not measure, or there was no light.
    """

    def __init__(
        self, *, port: Port, clock: Clock, rate_hz: float = 100.0, dark_triggers: int = 16, answer_s: float = 0.5
    ) -> None:
        if not 1 <= rate_hz <= wire.MAX_RATE_HZ or rate_hz != round(rate_hz):
            raise ConfigError(
                f"laser box: rate_hz is {rate_hz} Hz, it must be a whole number from 1 to {wire.MAX_RATE_HZ}"
            )
        require_range("laser box: dark_triggers", dark_triggers, low=1, high=wire.MAX_PULSES)
        if not dark_triggers / rate_hz <= wire.MAX_EXPIRY_MS / 1e3:
            raise ConfigError(
                f"laser box: {dark_triggers} triggers at {rate_hz} Hz take {dark_triggers / rate_hz:g} s, the limit is "
                f"{wire.MAX_EXPIRY_MS / 1e3:g} s; average fewer pulses, or raise rate_hz"
            )
        require_range("laser box: answer_s", answer_s, low=0.1, high=5, unit="s")
        self._port = port
        self._clock = clock
        self._rate_hz = round(rate_hz)
        self._dark_triggers = dark_triggers
        self._answer_s = answer_s
        self._lines = wire.Lines()
        self._replies: list[bytes] = []
        self._used: set[str] = set()
        self._step = 0
        self._beaten_s = -math.inf
        self._holds_permit = False
        self._settled = False
        self.metered = False
        self.light_per_pulse: float | None = None
        self._settle()

    @property
    def emulated(self) -> bool:
        """Whether the box says that it is an emulator."""
        return self.identity == wire.EMULATOR

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses and return how many the photodiode saw; 0 pulses trigger the acquisition alone.

        Raises `LaserError` if the permit was used or is too short, if the box refuses, if pulses permitted, sent and
        seen differ, or if the photodiode has seen light outside of firings. Raises `DeviceTimeoutError` if the box does
        not answer in time. Whatever is raised, the box was told to disarm.
        """
        if permit.token in self._used:
            raise LaserError(f"laser box: the permit {permit.token!r} was used before; nothing was fired")
        if not self._settled:
            self._settle()
        left_s = permit.expires_s - self._clock.now_s()
        triggers = permit.pulses or self._dark_triggers
        needed_s = triggers / self._rate_hz
        # Refused here: the box would cut the train at the expiry, after pulses on the skin that no frame uses.
        if not left_s >= needed_s:
            raise LaserError(
                f"laser box: the permit {permit.token!r} is good for {left_s:.2f} s more and its pulses take "
                f"{needed_s:.2f} s; nothing was fired"
            )
        # Used up before the first byte is sent: a permit whose firing failed half-way must never be tried again.
        self._used.add(permit.token)
        try:
            return self._fire(permit.pulses, triggers, expiry_s=min(left_s, needed_s + _SPARE_S))
        except BaseException:
            self._settled = False
            # If even this cannot be sent, the lease ends by itself; the first error is the one to report.
            with suppress(NotConnectedError):
                self._port.write(wire.encode(wire.Disarm()))
            raise
        finally:
            self._holds_permit = False

    def beat(self) -> None:
        """Renew the lease if a permit is held and the last beat is old enough; call it often, from the control loop."""
        if self._holds_permit and self._clock.now_s() - self._beaten_s >= _BEAT_S:
            self._step += 1
            self._beaten_s = self._clock.now_s()
            self._port.write(wire.encode(wire.Beat(step=self._step)))

    def disarm(self) -> None:
        """Take any permit away from the box.

        Raises `DeviceTimeoutError` if the box does not confirm it.
        """
        # Beats end first, also if the line fails now: without a permit there is no lease to renew.
        self._holds_permit = False
        self._port.write(wire.encode(wire.Disarm()))
        self._skip_to(_answers_disarm, after="DISARM")

    def _settle(self) -> None:
        """Wait until an earlier firing's triggers have ended, and count tokens and light from there."""
        greeting = self._greet()
        self.identity = greeting.identity
        self.metered = greeting.version == wire.METERED_VERSION
        self._token = greeting.last_token
        self._seen = greeting.seen
        self._step = 0
        self._settled = True

    def _greet(self) -> wire.Greeting:
        """Answer to HELLO, once the box has ended an earlier train; `NotConnectedError` if it does not fit."""
        ends_s = self._clock.now_s() + _LONGEST_TRAIN_S
        while isinstance(greeting := self._hello(), wire.Refusal):
            if not self._clock.now_s() <= ends_s:
                raise NotConnectedError(
                    f"laser box: it still sends the triggers of an earlier firing after {_LONGEST_TRAIN_S:g} s; "
                    "switch it off and on, or check its firmware"
                )
            self._clock.wait(_BUSY_POLL_S)
        if greeting.version not in (wire.VERSION, wire.METERED_VERSION):
            raise NotConnectedError(
                f"laser box: it has version {greeting.version} of the protocol, {wire.VERSION} or "
                f"{wire.METERED_VERSION} is needed; "
                "load the firmware that came with this program"
            )
        if not _MIN_LEASE_MS <= greeting.lease_ms <= wire.LEASE_MS:
            raise NotConnectedError(
                f"laser box: its lease is {greeting.lease_ms} ms, it must lie between {_MIN_LEASE_MS} and "
                f"{wire.LEASE_MS} ms; set it in its firmware"
            )
        if greeting.last_token > _MAX_TOKENS:
            raise NotConnectedError(
                f"laser box: it has used the token {greeting.last_token}, and {wire.MAX_COUNT} is the last; switch it "
                "off and on, or check its firmware"
            )
        return greeting

    def _hello(self) -> wire.Greeting | wire.Refusal:
        """Answer to HELLO, or BUSY."""
        # The line end first: it completes a half line that another program left, which would garble HELLO.
        self._port.write(b"\n" + wire.encode(wire.Hello()))
        try:
            return self._skip_to(_answers_hello, after="HELLO")
        except DeviceTimeoutError as error:
            raise NotConnectedError(
                "laser box: nothing answers HELLO; is the port right, and is the box powered?"
            ) from error

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
        # Replies of an earlier command must not be taken for the answer to this permit.
        self._receive()
        self._replies.clear()
        self._port.write(wire.encode(ask))
        answer = self._next(within_s=self._answer_s, after="PERMIT")
        if not (isinstance(answer, wire.Permitted) and answer.token == self._token):
            raise LaserError(f"laser box: {answer} answers the permit {self._token}; {_cure(answer)}")
        if answer.seen != self._seen:
            raise LaserError(
                f"laser box: its photodiode counts {answer.seen} pulses of light since power-up, {self._seen} up to "
                "the last firing: there was light without a permit, or the box was switched off and on; nothing "
                "was fired; check the laser and its trigger line"
            )
        # A beat before FIRE: PERMIT began the lease, and the answer may have taken most of it.
        self._holds_permit = True
        self.beat()
        self._port.write(wire.encode(wire.Fire(token=self._token)))
        done = self._next(within_s=triggers / self._rate_hz + self._answer_s, after="FIRE")
        if not (isinstance(done, wire.Done) and done.token == self._token and self._is_measured(done)):
            raise LaserError(f"laser box: {done} answers the firing of {self._token}; {_cure(done)}")
        # The photodiode's count has 31 bits and wraps around.
        self._seen = (self._seen + done.photodiode) & wire.MAX_COUNT
        if not done.sent == done.photodiode == pulses:
            raise LaserError(
                f"laser box: {pulses} pulses were permitted, {done.sent} sent and {done.photodiode} seen by the "
                "photodiode; check lease, interlock, laser and photodiode"
            )
        if isinstance(done, wire.MeteredDone) and pulses:
            self.light_per_pulse = done.light / pulses
        return done.photodiode

    def _is_measured(self, done: wire.Done) -> bool:
        """Whether the answer has the number of the light meter if the box has one, and only then."""
        return isinstance(done, wire.MeteredDone) == self.metered

    def _skip_to(self, wanted: Callable[[wire.Reply], TypeGuard[_Kind]], *, after: str) -> _Kind:
        """Next reply that is wanted; others, and damaged lines, belong to earlier commands and are skipped."""
        ends_s = self._clock.now_s() + self._answer_s
        while True:
            try:
                reply = self._next(within_s=ends_s - self._clock.now_s(), after=after)
            except LaserError:
                continue
            if wanted(reply):
                return reply

    def _next(self, *, within_s: float, after: str) -> wire.Reply:
        """Next reply; the lease is renewed meanwhile."""
        ends_s = self._clock.now_s() + within_s
        while not self._replies:
            if not self._clock.now_s() <= ends_s:
                raise DeviceTimeoutError(f"laser box: no answer to {after} in time; check its cable and its power")
            self.beat()
            self._clock.wait(_POLL_S)
            self._receive()
        return wire.decode_reply(self._replies.pop(0))

    def _receive(self) -> None:
        self._replies += self._lines.feed(self._port.read(256, timeout_s=0.0))


def _answers_hello(reply: wire.Reply) -> TypeGuard[wire.Greeting | wire.Refusal]:
    return isinstance(reply, wire.Greeting) or (isinstance(reply, wire.Refusal) and reply.reason == "BUSY")


def _answers_disarm(reply: wire.Reply) -> TypeGuard[wire.Disarmed]:
    return isinstance(reply, wire.Disarmed)


def _cure(reply: wire.Reply) -> str:
    return _CURES[reply.reason] if isinstance(reply, wire.Refusal) else "check its firmware"


def _open(settings: LaserBoxSettings, opening: Opening) -> LaserBox:
    return LaserBox(
        port=opening.line,
        clock=opening.clock,
        rate_hz=settings.rate_hz,
        dark_triggers=opening.pulses,
        answer_s=settings.answer_s,
    )


ENTRY: Entry[LaserBoxSettings, LaserBox] = Entry(
    settings=LaserBoxSettings,
    open=_open,
    describe=lambda settings, _laser: f"laserbox at {settings.port}",
    line=lambda settings: Line(name="laser", path=settings.port, safe_command=wire.encode(wire.Disarm())),
)
