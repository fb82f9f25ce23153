"""An emulated laser box at the level of bytes: lease, interlock, counter and photodiode, lighting a simulated world.

It is a `markerseek.emulators.ByteDevice`, the same on a pty in real time and in one process in virtual time. `pulses`
holds what it fired in truth, whatever it reports.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from markerseek.core import require_range
from markerseek.emulators.faults import Faults
from markerseek.sim import LaserSettings, SimulatedWorld, vary_last_flash
from markerseek.wire import laserbox as wire

_NEVER_US = 1 << 62
_LEASE_US = 1000 * wire.LEASE_MS

_BOOT_TEXT = b"MicroPython v1.22.2 on 2024-02-22; laser box with RP2040\r\n"
"""What a board prints when it starts."""

LIGHT_COUNTS = 20_000
"""What the light meter reads of a usual pulse, in counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pulse:
    """One pulse of light: its time in seconds, and the true angle of the probe in degrees."""

    at_s: float
    angle_deg: float


_AnyPermit: TypeAlias = wire.PermitPulses | wire.PermitSweep


def _period_us(train: _AnyPermit) -> int:
    if isinstance(train, wire.PermitSweep):
        return train.period_us
    return (2_000_000 + train.rate_hz) // (2 * train.rate_hz)


class EmulatedLaserBox:
    """A laser box and its laser; it reads its inputs once per turn of a loop, as the firmware does.

    ``on_triggers``: called at the end of a train with the number of triggers sent to the acquisition, those without
    light after a permit was taken away included. ``turn_us``: time between two turns of its loop. ``laser``: how the
    energy of an acquisition varies, and the noise of the light meter, without which it has none. ``rng``: source of
    randomness for both. ``moment``: called with the box's time in seconds at a stamp, turns the probe to where it is
    then, and returns what an ideal clock shows; None: the probe is there.
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        on_triggers: Callable[[int], None],
        turn_us: int = 200,
        laser: LaserSettings | None = None,
        rng: np.random.Generator | None = None,
        moment: Callable[[float], float] | None = None,
    ) -> None:
        require_range("laser box: turn_us", turn_us, low=1, high=50_000, unit="us")
        self.pulses: list[_Pulse] = []
        self.faults = Faults("laser")
        self._world = world
        self._on_triggers = on_triggers
        self._turn_us = turn_us
        self._now_us = 0
        self._until_us = 0
        self._interlock_closed = True
        self._laser = laser or LaserSettings()
        self._rng = rng
        self._boots_until_us: int | None = None
        self.moment = moment or float
        self.power_up()

    def power_up(self) -> None:
        """Start as after power-up: no permit, and all counters at 0."""
        self._lines = wire.Lines()
        self._answers = b""
        self._last_token = 0
        self._last_step = 0
        self._interlock_opened = False
        self._permit: _AnyPermit | None = None
        self._ends_us = 0
        self._expires_us = 0
        self._due_us = 0
        self._train: _AnyPermit | None = None
        self._triggers = 0
        self._sent = 0
        self._seen_before = 0
        self._last_trigger_us = 0
        self._untold: tuple[int, int] | None = None
        """Stamp of the last pulse of a sweep, and the photodiode's count before it."""
        self._dark_told = True
        self._fired: deque[int] = deque()
        """Seconds in which pulses were sent."""
        self._light_us: deque[int] = deque()
        """Times at which light of earlier triggers will come."""
        self._seen = 0

    @property
    def permitted(self) -> bool:
        """Whether a permit is held, so that the laser could be triggered."""
        return self._permit is not None

    def open_interlock(self) -> None:
        """Open the interlock; an interrupt notes it for the next turn of the loop."""
        self._interlock_closed = False
        self._interlock_opened = True

    def close_interlock(self) -> None:
        """Close the interlock; an earlier permit stays void."""
        self._interlock_closed = True

    def stray_light(self, pulses: int = 1) -> None:
        """Make the laser fire now without a trigger."""
        for _ in range(pulses):
            self._light_us.appendleft(self._now_us)
        self._shine()

    def advance(self, now_s: float) -> bytes:
        """Advance to that time in seconds, and return the bytes sent; an earlier time changes nothing."""
        # Whole microseconds, as the firmware counts: sums of float seconds would depend on the size of the steps.
        until_us = max(self._now_us, round(now_s * 1e6))
        self._until_us = until_us
        while (turn_us := self._next_turn_us()) <= until_us:
            self._now_us = turn_us
            self._turn()
        # One more turn at the end, so that light due since the last whole turn is counted now.
        self._now_us = until_us
        self._turn()
        return self._take()

    def feed(self, data: bytes) -> bytes:
        """Receive bytes from the host at the present time, and return the answer."""
        if self._boots_until_us is None and (boot_s := self.faults.amount("restart")):
            self.power_up()
            self._boots_until_us = self._now_us + round(1e6 * boot_s)
            return _BOOT_TEXT
        if self._boots_until_us is not None and self._now_us < self._boots_until_us:
            return b""
        for line in self._lines.feed(data):
            answer = self._execute(wire.decode_command(line))
            # Fail safe: after any refusal the host's view of the box is wrong, and no permit may remain.
            if isinstance(answer, wire.Refusal):
                self._void()
            if answer is not None:
                self._answer(answer)
        return self._take()

    def _next_turn_us(self) -> int:
        """Return the time of the next turn that can change anything.

        Virtual time is fast because the others are skipped.
        """
        due_us = []
        if self._permit is not None:
            due_us.append(min(self._ends_us, self._expires_us))
        if self._train is not None:
            due_us.append(self._due_us if self._triggers < self._given else self._last_trigger_us + wire.LIGHT_LATE_US)
            if self._untold is not None:
                due_us.append(self._last_trigger_us + wire.LIGHT_LATE_US)
        if not due_us:
            return _NEVER_US
        return max(-(-min(due_us) // self._turn_us), self._now_us // self._turn_us + 1) * self._turn_us

    def _turn(self) -> None:
        """One turn of the loop."""
        self._shine()
        if self._interlock_open() or (
            self._permit is not None and self._now_us >= min(self._ends_us, self._expires_us)
        ):
            self._void()
        if self._train is None:
            return
        self._tell_light(self._train)
        if self._triggers < self._given:
            if self._due_us <= self._now_us:
                self._trigger(self._train)
                self._tell_light(self._train)
        elif self._now_us >= self._last_trigger_us + wire.LIGHT_LATE_US:
            self._end_train(self._train)

    @property
    def _given(self) -> int:
        """Triggers of the train: more than permitted if the counter is broken."""
        train = self._train
        if train is None:
            return 0
        # That of a sweep is completed to what was permitted.
        triggers = train.pulses if isinstance(train, wire.PermitSweep) else train.triggers
        return max(triggers, train.pulses + round(self.faults.amount("extra pulses")))

    def _interlock_open(self) -> bool:
        """Return whether the interlock is open, or was since the last turn."""
        opened = self._interlock_opened
        self._interlock_opened = False
        return opened or not self._interlock_closed

    def _shine(self) -> None:
        """Emit the light that is due; the photodiode's interrupt counts it."""
        while self._light_us and self._light_us[0] <= self._now_us:
            self.pulses.append(_Pulse(at_s=self._light_us.popleft() / 1e6, angle_deg=self._world.angle_deg))
            self._seen += self.faults("blind photodiode") is None

    def _take(self) -> bytes:
        answers = self._answers
        self._answers = b""
        return answers

    def _answer(self, reply: wire.Reply) -> None:
        if not self.faults("silent"):
            self._answers += wire.encode(reply)

    def _execute(self, command: wire.Command | wire.Refusal) -> wire.Reply | None:
        match command:
            case wire.Hello():
                return self._greet()
            case wire.PermitPulses() | wire.PermitSweep():
                return self._take_permit(command)
            case wire.AskTime(number=number):
                return wire.Time(number=number, clock_us=self._clock_us())
            case wire.Beat(step=step):
                return self._renew(step)
            case wire.Fire(token=token):
                return self._fire(token)
            case wire.Disarm():
                self._void()
                return wire.Disarmed()
            case wire.Refusal():
                return command

    def _greet(self) -> wire.Reply:
        if self._train is not None:
            return wire.Refusal(reason="BUSY")
        self._void()
        self._last_step = 0
        return wire.Greeting(
            identity=wire.EMULATOR,
            version=wire.VERSION,
            lease_ms=wire.LEASE_MS,
            last_token=self._last_token,
            seen=self._seen & wire.MAX_COUNT,
            meter=int(self._laser.energy_meter_noise is not None),
        )

    def _clock_us(self) -> int:
        """Return what its own clock shows now."""
        at_s = self.moment(self._now_us / 1e6)
        return (
            round(1e6 * at_s * (1 + self.faults.amount("clock drift")) + self.faults.amount("clock step"))
            & wire.MAX_COUNT
        )

    def _take_permit(self, permit: _AnyPermit) -> wire.Reply:
        if self._train is not None:
            return wire.Refusal(reason="BUSY")
        if self._interlock_open():
            return wire.Refusal(reason="INTERLOCK")
        if permit.token <= self._last_token:
            return wire.Refusal(reason="TOKEN")
        if self._pulses_of_last_minute() + permit.pulses > wire.MAX_PULSES_PER_MINUTE:
            return wire.Refusal(reason="BUDGET")
        self._last_token = permit.token
        self._permit = permit
        self._ends_us = self._now_us + _LEASE_US
        self._expires_us = self._now_us + 1000 * permit.expiry_ms
        answer = wire.SweepPermitted if isinstance(permit, wire.PermitSweep) else wire.Permitted
        return answer(token=permit.token, seen=self._seen & wire.MAX_COUNT)

    def _pulses_of_last_minute(self) -> int:
        """Return the pulses of the last 60 s, counted by whole seconds: never too few, at most a second too many."""
        while self._fired and self._fired[0] < self._now_us // 1_000_000 - 60:
            self._fired.popleft()
        return len(self._fired)

    def _renew(self, step: int) -> wire.Reply | None:
        if step <= self._last_step:
            return wire.Refusal(reason="STEP")
        self._last_step = step
        self._ends_us = self._now_us + _LEASE_US
        return None

    def _fire(self, token: int) -> wire.Reply | None:
        if self._permit is None or self._train is not None or token != self._permit.token:
            return wire.Refusal(reason="TOKEN")
        self._train = self._permit
        self._triggers = 0
        self._sent = 0
        self._dark_told = not isinstance(self._train, wire.PermitSweep)
        self._seen_before = self._seen
        self._due_us = self._now_us
        self._turn()
        return None

    def _trigger(self, train: _AnyPermit) -> None:
        """Give one trigger to the acquisition, and to the laser while the permit holds and pulses are left."""
        swept = isinstance(train, wire.PermitSweep)
        lit = self._permit is not None and self._triggers < train.pulses + round(self.faults.amount("extra pulses"))
        self._triggers += 1
        self._last_trigger_us = self._now_us
        if lit:
            self._sent += 1
            self._fired.append(self._now_us // 1_000_000)
            if swept:
                self._untold = self._clock_us(), self._seen
            if not self.faults("dead lamp"):
                if swept:
                    self._light_world(pulses=1, angle_deg=self._world.angle_deg)
                twice = swept and self._sent == self.faults.amount("double pulse")
                self._light_us.extend([self._now_us + round(self.faults.amount("late light"))] * (1 + twice))
                self._shine()
        if self._triggers >= self._given:
            self._void()
        # A pulse that is late by half a period delays the next ones, so that two never come in a burst. In a sweep any
        # does, also one that is late because this process was delayed.
        period_us = _period_us(train)
        self._due_us = max(
            self._due_us + period_us, self._until_us + period_us if swept else self._now_us + period_us // 2
        )

    def _tell_light(self, train: _AnyPermit) -> None:
        """Report the last pulse of a sweep once its light has been seen, and once the end of the light."""
        if self._untold is not None and self._now_us >= self._last_trigger_us + wire.LIGHT_LATE_US:
            stamp_us, before = self._untold
            self._untold = None
            seen = self._seen - before
            self._answer(
                wire.Stamped(
                    token=train.token,
                    number=self._sent,
                    stamp_us=stamp_us,
                    photodiode=seen,
                    light=self._read_light(seen),
                )
            )
        if self._permit is None and self._untold is None and not self._dark_told:
            self._dark_told = True
            seen = self._seen - self._seen_before
            self._answer(wire.Dark(token=train.token, sent=self._sent, photodiode=seen))

    def _read_light(self, photodiode: int) -> int:
        """Return what the light meter read of pulses that the photodiode saw; 0 without one."""
        noise = self._laser.energy_meter_noise
        if noise is None or not photodiode:
            return 0
        energy = self._world.flashes[-1].energy if self._sent else 1.0
        error = 0.0 if self._rng is None else noise * float(self._rng.standard_normal())
        return max(0, min(round(LIGHT_COUNTS * photodiode * energy * (1 + error)), wire.MAX_COUNT))

    def _void(self) -> None:
        """Void the permit: no light from now on; a train that has begun is completed without light."""
        self._permit = None

    def _light_world(self, *, pulses: int, angle_deg: float | None = None) -> None:
        """Light the world, with the probe at an angle; None: where it is."""
        at_s = self._last_trigger_us / 1e6
        self._world.flash(pulses=pulses, at_s=at_s)
        vary_last_flash(self._world, self._laser, now_s=at_s, rng=self._rng)
        if angle_deg is not None:
            self._world.flashes[-1] = replace(self._world.flashes[-1], angle_deg=angle_deg)

    def _end_train(self, train: _AnyPermit) -> None:
        """Report the train to the world, the acquisition and the host."""
        self._train = None
        # One flash per train of averaged pulses: the world needs only their number. Those of a sweep were given one by
        # one.
        if self._sent and not self.faults("dead lamp") and not isinstance(train, wire.PermitSweep):
            self._light_world(pulses=self._sent)
        self._on_triggers(self._triggers)
        seen = self._seen - self._seen_before
        self._answer(wire.Done(token=train.token, sent=self._sent, photodiode=seen, light=self._read_light(seen)))
