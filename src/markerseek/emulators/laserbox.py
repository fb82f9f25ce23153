"""A laser box at the level of its bytes: lease, interlock, counter and photodiode, lighting a simulated world.

It is a `markerseek.emulators.ByteDevice`: on a pty in real time and in one process in virtual time it is the same. What
it really did stands in `pulses`, whatever it reports.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from markerseek.core import ConfigError
from markerseek.sim import SimulatedWorld
from markerseek.wire import laserbox as wire

IDENTITY = "emulator"
"""How the box calls itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pulse:
    """One pulse of light: when, in seconds, and where the probe really pointed, in degrees."""

    at_s: float
    angle_deg: float


@dataclass(slots=True, kw_only=True)
class LaserBoxFaults:
    """What is broken; may be changed while the box runs.

    Attributes
    ----------
    laser_dead
        The trigger is given and no light comes.
    photodiode_dead
        Light comes and is not seen.
    extra_pulses
        Pulses beyond the permit that a broken counter lets through.
    silent
        The box does all it should and answers nothing.
    """

    laser_dead: bool = False
    photodiode_dead: bool = False
    extra_pulses: int = 0
    silent: bool = False


class EmulatedLaserBox:
    """A laser box and the laser behind it.

    Parameters
    ----------
    world
        What is lit.
    on_triggers
        Told how many triggers the acquisition was given, once a train of them has ended.
    lease_ms
        Lease in milliseconds; at most `markerseek.wire.laserbox.LEASE_MS`.
    faults
        What is broken.
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        on_triggers: Callable[[int], None],
        lease_ms: int = wire.LEASE_MS,
        faults: LaserBoxFaults | None = None,
    ) -> None:
        if not 1 <= lease_ms <= wire.LEASE_MS:
            raise ConfigError(f"laser box: lease_ms is {lease_ms} ms, it must lie between 1 and {wire.LEASE_MS} ms")
        self.pulses: list[Pulse] = []
        self.faults = faults or LaserBoxFaults()
        self._world = world
        self._on_triggers = on_triggers
        self._lease_us = 1000 * lease_ms
        self._now_us = 0
        self._interlock_closed = True
        self.power_up()

    def power_up(self) -> None:
        """Begin as after power-up: nothing permitted, nothing remembered."""
        self._lines = wire.Lines()
        self._answers = b""
        self._last_token = 0
        self._last_step = 0
        self._permit: wire.PermitPulses | None = None
        self._ends_us = self._expires_us = self._due_us = 0
        self._firing = False
        self._triggers = self._sent = self._seen = 0

    @property
    def permitted(self) -> bool:
        """Whether a permit is held, so that the output could be driven."""
        return self._permit is not None

    def open_interlock(self) -> None:
        """Open the interlock: the output is low from now on."""
        self._interlock_closed = False
        self._let_go()

    def close_interlock(self) -> None:
        """Close the interlock; the permit that was held stays gone."""
        self._interlock_closed = True

    def advance(self, now_s: float) -> bytes:
        """Do what is due until that moment, in seconds, and return what is said; an earlier moment changes nothing."""
        self._now_us = max(self._now_us, round(now_s * 1e6))
        self._catch_up()
        return self._take()

    def feed(self, data: bytes) -> bytes:
        """Take in bytes from the host, at the moment last advanced to, and return what is said."""
        for line in self._lines.feed(data):
            answer = self._obey(wire.decode_command(line))
            if isinstance(answer, wire.Refusal):
                self._let_go()
            if answer is not None:
                self._answer(answer)
        return self._take()

    def _catch_up(self) -> None:
        if self._permit is None:
            return
        end_us = min(self._ends_us, self._expires_us)
        while self._firing and self._due_us <= self._now_us and self._due_us < end_us:
            self._trigger()
        if self._now_us >= end_us:
            self._let_go()

    def _take(self) -> bytes:
        answers, self._answers = self._answers, b""
        return answers

    def _answer(self, reply: wire.Reply) -> None:
        if not self.faults.silent:
            self._answers += wire.encode(reply)

    def _obey(self, command: wire.Command | wire.Refusal) -> wire.Reply | None:
        match command:
            case wire.Hello():
                self._let_go()
                self._last_step = 0
                return wire.Greeting(
                    identity=IDENTITY,
                    version=wire.VERSION,
                    lease_ms=self._lease_us // 1000,
                    last_token=self._last_token,
                )
            case wire.PermitPulses():
                return self._take_permit(command)
            case wire.Beat(step=step):
                return self._renew(step)
            case wire.Fire(token=token):
                return self._fire(token)
            case wire.Disarm():
                self._let_go()
                return wire.Disarmed()
            case wire.Refusal():
                return command

    def _take_permit(self, permit: wire.PermitPulses) -> wire.Reply:
        if self._firing:
            return wire.Refusal(reason="BUSY")
        if not self._interlock_closed:
            return wire.Refusal(reason="INTERLOCK")
        if permit.token <= self._last_token:
            return wire.Refusal(reason="TOKEN")
        self._last_token = permit.token
        self._permit = permit
        self._ends_us = self._now_us + self._lease_us
        self._expires_us = self._now_us + 1000 * permit.expiry_ms
        return wire.Permitted(token=permit.token)

    def _renew(self, step: int) -> wire.Reply | None:
        if step <= self._last_step:
            return wire.Refusal(reason="STEP")
        self._last_step = step
        self._ends_us = self._now_us + self._lease_us
        return None

    def _fire(self, token: int) -> wire.Reply | None:
        if self._permit is None or self._firing or token != self._permit.token:
            return wire.Refusal(reason="TOKEN")
        self._firing = True
        self._triggers = self._sent = self._seen = 0
        self._due_us = self._now_us
        self._catch_up()
        return None

    def _trigger(self) -> None:
        """Give one trigger to the acquisition, and to the laser while pulses are left."""
        permit = self._permit
        if permit is None:
            return
        self._triggers += 1
        if self._triggers <= permit.pulses + self.faults.extra_pulses:
            self._sent += 1
            if not self.faults.laser_dead:
                self.pulses.append(Pulse(at_s=self._due_us / 1e6, angle_deg=self._world.angle_deg))
                self._seen += not self.faults.photodiode_dead
        if self._triggers >= max(permit.triggers, permit.pulses + self.faults.extra_pulses):
            self._let_go()
        else:
            self._due_us += round(1e6 / permit.rate_hz)

    def _let_go(self) -> None:
        """Output low, permit gone; what was fired under it is told to the world, the acquisition and the host."""
        permit, firing = self._permit, self._firing
        self._permit, self._firing = None, False
        if permit is None or not firing:
            return
        if self._sent and not self.faults.laser_dead:
            self._world.flash(pulses=self._sent, at_s=self._due_us / 1e6)
        self._on_triggers(self._triggers)
        self._answer(wire.Done(token=permit.token, sent=self._sent, photodiode=self._seen))
