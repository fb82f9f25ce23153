"""The line to the laser box: commands, their answers, and the beats that renew its lease; which answers are refused.

In a sweep the box stamps each pulse by a clock of its own (`BoxSweep`). A question for that clock bounds, by the times
of question and answer, what it showed then; many of them bound it more closely than any one does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeGuard, TypeVar

from markerseek.core import Clock, DeviceTimeoutError, LaserError, NotConnectedError, Pulse
from markerseek.drivers._even import Even
from markerseek.drivers._exchanged import stage_at
from markerseek.drivers.serial_port import ANOTHER_PROGRAM, Unread
from markerseek.wire import Port
from markerseek.wire import laserbox as wire

RATE_ERROR = 0.01
"""Most by which the box's clock may be fast or slow against the computer's: a crystal is 1e-4 off, an RC oscillator as
much as this."""

STAMP_S = 1e-3
"""Most that the time of a pulse may be off, in seconds: 0.01 deg at the fastest speed of a sweep."""

PATIENCE_S = 2.0
"""Time within which the time of a pulse must be known that well: each question for the clock bounds it more closely."""

_TURN_US = wire.MAX_COUNT + 1
_ROUND_S = 1e-6


class BoxClock:
    """The box's clock on the rig's, by round trips: a time at which it was asked, one at which the answer was there."""

    def __init__(self) -> None:
        self._first_us: int | None = None
        self._even = Even()

    def add(self, clock_us: int, *, asked_s: float, answered_s: float) -> None:
        """Add a round trip.

        Raises `LaserError` if no rate of the clock explains it beside those before: the clock jumped.
        """
        if self._first_us is None:
            self._first_us = clock_us
        clock_s = self._since_first_s(clock_us)
        earliest_s = asked_s - _ROUND_S
        latest_s = answered_s + _ROUND_S
        jump_s = self._even.jump_s(clock_s, earliest_s=earliest_s, latest_s=latest_s)
        if jump_s > 0:
            raise LaserError(
                f"laser box: its clock jumped by {1e3 * jump_s:.1f} ms or more in mid-sweep; look for a restart of the "
                "box, or a loose cable"
            )
        self._even.add(clock_s, earliest_s=earliest_s, latest_s=latest_s)

    def bounds_s(self, stamp_us: int) -> tuple[float, float]:
        """Return the earliest and latest time at which it showed that stamp, by every round trip.

        Raises `LaserError` if its rate is too far off.
        """
        self._require_rate()
        slowest = max(self._even.slowest, 1 - RATE_ERROR)
        fastest = min(self._even.fastest, 1 + RATE_ERROR)
        return self._even.bounds_s(self._since_first_s(stamp_us), slowest=slowest, fastest=fastest)

    def _require_rate(self) -> None:
        """Refuse a clock that is too fast or too slow."""
        slowest = self._even.slowest
        fastest = self._even.fastest
        if slowest <= 1 + RATE_ERROR and fastest >= 1 - RATE_ERROR:
            return
        error = 2 / (slowest + fastest) - 1
        raise LaserError(
            f"laser box: its clock is {abs(error):.1%} {'fast' if error > 0 else 'slow'} against this computer's, the "
            f"limit is {RATE_ERROR:.0%}; give the box a crystal, or check the clock frequency in its firmware"
        )

    def _since_first_s(self, clock_us: int) -> float:
        """Return the seconds from the first round trip to what the clock shows.

        That starts at 0 again every 36 minutes.
        """
        first_us = self._first_us or 0
        return ((clock_us - first_us + _TURN_US // 2) % _TURN_US - _TURN_US // 2) / 1e6


@dataclass(slots=True, kw_only=True)
class BoxSweep:
    """The permitted sweep, and the answers of the box so far."""

    token: int
    pulses: int
    heard_s: float
    """Time of the last answer of the box."""
    stepped_s: float
    """Time of the control loop's last step."""
    clock: BoxClock = field(default_factory=BoxClock)
    asked_s: dict[int, float] = field(default_factory=dict)
    """Time of each question about the box's clock that has no answer yet, by its number."""
    usual_light: float | None = None
    """Reading of the light meter for a usual pulse; None: the light meter is not used."""
    stamped: list[wire.Stamped] = field(default_factory=list)
    """Pulses, in order."""
    returned: int = 0
    """Number of pulses that `new_pulses` has returned."""
    unknown_s: float | None = None
    """Time since which the next pulse waits for round trips that bound its time; None: none waits."""
    ending: bool = False
    """Whether the command to end the light was sent."""
    disarmed: bool = False
    dark: wire.Dark | None = None
    """Answer of the box after the end of the light, with the number of pulses; None until then."""

    def hear(self, reply: wire.Reply, *, now_s: float) -> None:
        """Take an answer of the box; `LaserError` if the box refuses, or if a pulse is missing or gave no light."""
        self.heard_s = now_s
        match reply:
            case wire.Time(number=number, clock_us=clock_us):
                asked_s = self.asked_s.pop(number, None)
                if asked_s is not None:
                    self.clock.add(clock_us, asked_s=asked_s, answered_s=now_s)
            case wire.Stamped(token=self.token, number=number, photodiode=1) if number == len(self.stamped) + 1:
                self.stamped.append(reply)
            case wire.Dark(token=self.token):
                self.dark = reply
            case wire.Disarmed():
                self.disarmed = True
            case wire.Done(token=self.token):
                pass
            case _:
                raise LaserError(
                    f"laser box: {reply} came after {len(self.stamped)} pulses of the sweep {self.token}, each of "
                    "which the photodiode must see once; check laser, photodiode and trigger"
                )

    def require_light(self) -> None:
        """Refuse a sweep whose light has ended without a command, and before all its pulses."""
        if self.dark is not None and not self.ending and self.dark.sent < self.pulses:
            raise LaserError(
                f"laser box: it ended the light after {self.dark.sent} of at most {self.pulses} pulses; check the "
                "interlock, and what held up this computer for longer than the box's lease"
            )

    def fired(self) -> int:
        """Return the pulses that were fired, once the light has ended.

        `LaserError` if box, photodiode and stamps differ.
        """
        dark = self.dark
        if dark is None or not dark.sent == dark.photodiode == len(self.stamped):
            raise LaserError(
                f"laser box: {dark} ended a sweep of {len(self.stamped)} stamped pulses; check laser, photodiode and "
                "trigger"
            )
        return dark.sent

    def new_pulses(self, *, now_s: float) -> list[Pulse]:
        """Return the pulses since the last call whose times on the rig's clock are known.

        Raises `LaserError` if that of one is not known in time.
        """
        new: list[Pulse] = []
        for stamped in self.stamped[self.returned :]:
            earliest_s, latest_s = self.clock.bounds_s(stamped.stamp_us)
            error_s = (latest_s - earliest_s) / 2
            if not error_s <= STAMP_S:
                self._require_patience(error_s, now_s=now_s)
                break
            energy = None if self.usual_light is None else stamped.light / self.usual_light
            at_s = (earliest_s + latest_s) / 2
            new.append(Pulse(at_s=at_s, sigma_s=error_s / math.sqrt(3), energy=energy))
            self.unknown_s = None
        self.returned += len(new)
        return new

    def _require_patience(self, error_s: float, *, now_s: float) -> None:
        """Let a pulse wait for its time, but not for long."""
        if self.unknown_s is None:
            self.unknown_s = now_s
        if not now_s - self.unknown_s <= PATIENCE_S:
            raise LaserError(
                f"laser box: the time of a pulse is known to {1e3 * error_s:.1f} ms only, the limit is "
                f"{1e3 * STAMP_S:g} ms; close other programs, or give the box a port of its own"
            )


_BEAT_S = 0.02
"""Time between two beats, in seconds: five of them in the longest lease."""

POLL_S = 0.002

_AGAIN_S = 0.5
_BURST_S = 0.1
"""Time after which HELLO is sent to a deaf board again, and in which it answers those that it kept, in seconds."""

_MIN_LEASE_MS = 50
"""Shortest lease in milliseconds that survives one lost beat."""

_MAX_TOKENS = wire.MAX_COUNT - 1_000_000
"""Highest token that a box may have used before: enough are left for a session."""

_CURES = {
    "CRC": f"a line was damaged on its way: {ANOTHER_PROGRAM}; else check cable and earthing",
    "FORM": f"it does not know the command: check its firmware's version, or {ANOTHER_PROGRAM}",
    "TOKEN": "the permit is gone, by a lapsed lease or a restart of the box: arm and start again",
    "STEP": "a beat came twice: does another program use it?",
    "INTERLOCK": "the interlock is open: close it, then arm again",
    "BUSY": "it still sends the triggers of another firing: does another program use it?",
    "BUDGET": f"it sends at most {wire.MAX_PULSES_PER_MINUTE} pulses a minute: wait a minute, or average fewer",
}

_Kind = TypeVar("_Kind", bound=wire.Reply)


class BoxLine:
    """A line to one box; while a permit is held, its lease is renewed in each wait for an answer.

    ``holds_permit``: whether the box may hold a permit, so that beats are sent.
    """

    def __init__(self, *, port: Port, clock: Clock, answer_s: float) -> None:
        self._port = port
        self._clock = clock
        self._answer_s = answer_s
        self._lines = wire.Lines()
        self._replies: list[bytes] = []
        self._step = 0
        self._beaten_s = -math.inf
        self.holds_permit = False
        self._unread = Unread()

    def send(self, command: wire.Command) -> None:
        """Send a command."""
        self._unread.clear()
        self._port.write(wire.encode(command))

    def beat(self) -> None:
        """Renew the lease if a permit is held and the last beat is old enough."""
        now_s = self._clock.now_s()
        if self.holds_permit and now_s - self._beaten_s >= _BEAT_S:
            self._step += 1
            self._beaten_s = now_s
            self._port.write(wire.encode(wire.Beat(step=self._step)))

    def greet(self, *, within_s: float = 0.0) -> wire.Greeting | wire.Refusal:
        """Send HELLO, and return its answer, after which steps begin at 1 again; or BUSY.

        ``within_s``: HELLO is sent again until then: many boards restart when their port is opened, and are deaf for a
        second or two.
        """
        self._unread.clear()
        ends_s = self._clock.now_s() + max(within_s, self._answer_s)
        tries = 0
        while True:
            tries += 1
            # The line end first: it completes a half line that another program left, which would garble HELLO.
            self._port.write(b"\n" + wire.encode(wire.Hello()))
            left_s = ends_s - self._clock.now_s()
            try:
                wait_s = min(left_s, _AGAIN_S) if within_s else left_s
                answer = self._skip_to(_answers_hello, after="HELLO", within_s=wait_s)
                break
            except DeviceTimeoutError:
                if not self._clock.now_s() < ends_s:
                    raise
        if tries > 1:
            # It may have kept the others, and answers each.
            self._clock.wait(_BURST_S)
            self.drop_replies()
        if isinstance(answer, wire.Greeting):
            self._step = 0
        return answer

    def stage_at(self) -> str:
        """Return the end of an error that names the stage that answers instead of a box; empty if none does."""
        return stage_at(self._port, self._clock)

    def await_disarmed(self) -> None:
        """Wait for the answer to DISARM."""
        self._skip_to(_answers_disarm, after="DISARM", within_s=self._answer_s)

    def next(self, *, within_s: float, after: str) -> wire.Reply:
        """Return the next reply; the lease is renewed meanwhile. Raises `DeviceTimeoutError` if none comes in time."""
        ends_s = self._clock.now_s() + within_s
        while not self._replies:
            if not self._clock.now_s() <= ends_s:
                raise DeviceTimeoutError(
                    f"laser box: no answer to {after} in time: "
                    + self._unread.said(cure="check its cable and its power, and that laser.port is its port")
                )
            self.beat()
            # Before each look: time passes however fast a box sends.
            self._clock.wait(POLL_S)
            self._receive()
        return wire.decode_reply(self._replies.pop(0))

    def drop_replies(self) -> None:
        """Drop all that has come so far."""
        self._receive()
        self._replies.clear()

    def hear(self, sweep: BoxSweep, *, within_s: float) -> None:
        """Take all that the box says of a sweep until it pauses; the first of it may take that long."""
        # A single byte, because a port waits for as many as it is asked for.
        data = self._port.read(1, timeout_s=within_s)
        data += self._port.read(4096, timeout_s=0.0)
        # After both: what comes between them must not seem to be answered before it came.
        now_s = self._clock.now_s()
        for line in self._lines.feed(data):
            sweep.hear(wire.decode_reply(line), now_s=now_s)

    def _skip_to(self, wanted: Callable[[wire.Reply], TypeGuard[_Kind]], *, after: str, within_s: float) -> _Kind:
        """Return the next reply that is wanted.

        Others, and damaged lines, belong to earlier commands and are skipped.
        """
        ends_s = self._clock.now_s() + within_s
        while True:
            try:
                reply = self.next(within_s=ends_s - self._clock.now_s(), after=after)
            except LaserError:
                continue
            if wanted(reply):
                return reply

    def _receive(self) -> None:
        data = self._port.read(256, timeout_s=0.0)
        self._unread.add(data)
        self._replies += self._lines.feed(data)


def _answers_hello(reply: wire.Reply) -> TypeGuard[wire.Greeting | wire.Refusal]:
    return isinstance(reply, wire.Greeting) or (isinstance(reply, wire.Refusal) and reply.reason == "BUSY")


def _answers_disarm(reply: wire.Reply) -> TypeGuard[wire.Disarmed]:
    return isinstance(reply, wire.Disarmed)


def require_known(greeting: wire.Greeting) -> None:
    """Refuse a box whose version, lease or token this program cannot use."""
    if greeting.version != wire.VERSION:
        raise NotConnectedError(
            f"laser box: it has version {greeting.version} of the protocol, {wire.VERSION} is known; load the firmware "
            "that came with this program"
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


def stray_light(seen: int, expected: int) -> LaserError:
    """Return the error of a photodiode that has seen another number of pulses than were fired."""
    return LaserError(
        f"laser box: its photodiode counts {seen} pulses of light since power-up, {expected} up to the last firing: "
        "there was light without a permit, or the box was switched off and on; nothing was fired; check the laser and "
        "its trigger line"
    )


def cure(reply: wire.Reply) -> str:
    """Return what a person can do where this is no answer."""
    return _CURES[reply.reason] if isinstance(reply, wire.Refusal) else "check its firmware"
