"""A simulated pulsed laser behind a pulse counter: it fires the pulses of a permit, once, or those of a sweep."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from markerseek.core import Clock, ConfigError, LaserError, Permit, Pulse, SweepPermit
from markerseek.sim.settings import LaserSettings
from markerseek.sim.world import SimulatedWorld

DELAY_SIGMA_S = 10e-3
"""Standard deviation of the delay between the laser's stamps and the stage's readings, where nobody has measured it."""

CLOCK_DRIFT = 20e-6
"""By how much the clock of the stamps is fast, where it is compared with the rig's at the beginning of a sweep."""


class SimulatedLaser:
    """Laser of a simulated world.

    ``light``: its rate, and how its energies and stamps vary; None: the defaults. ``probe_deg``: true angle of the
    probe at a time of a sweep; None: at rest. ``rng``: needed where something of the light is drawn.
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        clock: Clock,
        light: LaserSettings | None = None,
        probe_deg: Callable[[float], float] | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        light = light or LaserSettings()
        self._light = light
        delay_sigma_s = light.stamp_delay_sigma_s
        if (
            max(light.energy_spread, light.stamp_jitter_s, light.without_light, delay_sigma_s or 0.0) > 0
            and rng is None
        ):
            raise ConfigError(
                "laser: its energies, stamps, pulses without light and known delay are drawn, and there is no rng to "
                "draw them from"
            )
        self._world = world
        self._clock = clock
        self._probe_deg = probe_deg
        self._rng = rng
        self.delay_sigma_s = DELAY_SIGMA_S if delay_sigma_s is None else delay_sigma_s
        """Standard deviation of the unknown delay of all pulses, in seconds."""
        self.stamp_delay_s = 0.0
        """Delay as a calibration of the rig states it: the true delay, with the error of the measurement."""
        if rng is not None and delay_sigma_s is not None:
            self.stamp_delay_s = light.stamp_delay_s + delay_sigma_s * float(rng.standard_normal())
        self.sweep_period_s = 1 / light.rate_hz
        """Time between two pulses, in seconds."""
        self._used: set[str] = set()
        self._sweep: SweepPermit | None = None
        self._began_s = 0.0
        self._fired = 0
        self._untold: list[Pulse] = []

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses and return how many were; a permit of 0 pulses only triggers.

        Raises `LaserError` if the permit was used before or has expired; nothing is fired.
        """
        self._use(permit)
        if permit.pulses > 0:
            # One flash for the whole train, at its beginning: a frame is the average of its pulses.
            self._flash(permit.pulses, self._clock.now_s(), angle_deg=None)
        self._clock.wait(permit.pulses / self._light.rate_hz)
        return permit.pulses

    def prepare_sweep(self) -> None:
        """Nothing to get ready."""

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Begin to fire single pulses; refused as by `fire`."""
        self._use(permit)
        self._sweep = permit
        self._began_s = self._clock.now_s()
        self._fired = 0
        self._untold = []

    def pulses(self) -> Sequence[Pulse]:
        """Return the pulses since the last call; they are fired here, at their times that have gone by."""
        self._fire_until(self._clock.now_s())
        told = self._untold
        self._untold = []
        return told

    def end_sweep(self) -> int:
        """End the light, and return how many pulses were fired in all."""
        self._fire_until(self._clock.now_s())
        self._sweep = None
        return self._fired

    def disarm(self) -> None:
        """End the light of a sweep; no other permit is held between two calls."""
        self._sweep = None

    def _use(self, permit: Permit) -> None:
        if permit.token in self._used:
            raise LaserError(f"laser: the permit {permit.token!r} was used before; nothing was fired")
        # Not ">", which would let a NaN pass.
        if not self._clock.now_s() <= permit.expires_s:
            raise LaserError(f"laser: the permit {permit.token!r} has expired; nothing was fired")
        # Noted before the flash: a permit that failed half-way must not fire again.
        self._used.add(permit.token)

    def _fire_until(self, now_s: float) -> None:
        sweep = self._sweep
        if sweep is None:
            return
        until_s = min(now_s, sweep.expires_s)
        while self._fired < sweep.pulses and (at_s := self._began_s + self._fired * sweep.period_s) <= until_s:
            self._fire_one(at_s)

    def _fire_one(self, at_s: float) -> None:
        """One pulse of a sweep, and its stamp."""
        self._flash(1, at_s, angle_deg=None if self._probe_deg is None else self._probe_deg(at_s))
        self._fired += 1
        stamp_s = at_s - self._light.stamp_delay_s + CLOCK_DRIFT * (at_s - self._began_s)
        if self._rng is not None and self._light.stamp_jitter_s > 0:
            stamp_s += self._light.stamp_jitter_s * float(self._rng.standard_normal())
        self._untold.append(Pulse(at_s=stamp_s))

    def _flash(self, pulses: int, at_s: float, *, angle_deg: float | None) -> None:
        """Light the tissue with the energy that the laser has then."""
        self._world.flash(pulses=pulses, at_s=at_s)
        vary_last_flash(self._world, self._light, now_s=at_s, rng=self._rng)
        if self._rng is not None and self._light.without_light > 0:
            flash = self._world.flashes[-1]
            lit = pulses - int(self._rng.binomial(pulses, self._light.without_light))
            self._world.flashes[-1] = replace(flash, energy=flash.energy * lit / pulses)
        if angle_deg is not None:
            self._world.flashes[-1] = replace(self._world.flashes[-1], angle_deg=angle_deg)


def vary_last_flash(
    world: SimulatedWorld, light: LaserSettings, *, now_s: float, rng: np.random.Generator | None
) -> None:
    """Give the last flash of a world the energy that a laser has now."""
    log_energy = light.energy_drift_per_min * now_s / 60
    if rng is not None and light.energy_spread > 0:
        log_energy += light.energy_spread * float(rng.standard_normal())
    if log_energy != 0:
        flash = world.flashes[-1]
        world.flashes[-1] = replace(flash, energy=flash.energy * math.exp(log_energy))
