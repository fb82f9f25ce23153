"""A simulated pulsed laser behind a pulse counter: it fires the pulses of a permit, once, or those of a sweep."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from markerseek.core import Clock, ConfigError, LaserError, Permit, Pulse, SweepPermit
from markerseek.sim.world import SimulatedWorld

DELAY_SIGMA_S = 10e-3
"""Standard deviation of the delay between the laser's stamps and the stage's readings, where nobody has measured it."""

CLOCK_DRIFT = 20e-6
"""By how much the clock of the stamps is fast, where it is compared with the rig's at the beginning of a sweep."""


class SimulatedLaser:
    """Laser of a simulated world.

    ``rate_hz``: pulses per second. ``energy_spread``: standard deviation of ln energy from one acquisition to the next,
    beside that of the pulses. ``energy_drift_per_min``: change of ln energy in a minute. ``true_delay_s``: time from
    the stamp of a pulse to its light. ``delay_sigma_s``: standard deviation to which the rig knows it; None: nobody has
    measured it. ``stamp_jitter_s``: standard deviation of a stamp by itself. ``without_light``: share of the pulses
    that give no light. ``probe_deg``: true angle of the probe at a time of a sweep; None: at rest.
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        clock: Clock,
        rate_hz: float = 100.0,
        energy_spread: float = 0.0,
        energy_drift_per_min: float = 0.0,
        true_delay_s: float = 0.0,
        delay_sigma_s: float | None = None,
        stamp_jitter_s: float = 0.0,
        without_light: float = 0.0,
        probe_deg: Callable[[float], float] | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        if max(energy_spread, stamp_jitter_s, without_light, delay_sigma_s or 0.0) > 0 and rng is None:
            raise ConfigError(
                "laser: its energies, stamps, pulses without light and known delay are drawn, and there is no rng to "
                "draw them from"
            )
        if not 0 < rate_hz < math.inf:
            raise ConfigError(f"laser: rate_hz is {rate_hz} Hz, it must be positive and finite")
        self._world = world
        self._clock = clock
        self._rate_hz = rate_hz
        self._energy_spread, self._energy_drift_per_min = energy_spread, energy_drift_per_min
        self._true_delay_s, self._stamp_jitter_s = true_delay_s, stamp_jitter_s
        self._without_light = without_light
        self._delay_sigma_s = delay_sigma_s
        # Delay as a calibration of the rig states it: the true delay, with the error of the measurement.
        self.stamp_delay_s = 0.0
        if rng is not None and delay_sigma_s is not None:
            self.stamp_delay_s = true_delay_s + delay_sigma_s * float(rng.standard_normal())
        self._probe_deg = probe_deg
        self._rng = rng
        self._used: set[str] = set()
        self._sweep: SweepPermit | None = None
        self._began_s, self._fired = 0.0, 0
        self._untold: list[Pulse] = []

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses and return how many were; a permit of 0 pulses only triggers.

        Raises `LaserError` if the permit was used before or has expired; nothing is fired.
        """
        self._use(permit)
        if permit.pulses > 0:
            # One flash for the whole train, at its beginning: a frame is the average of its pulses.
            self._flash(permit.pulses, self._clock.now_s(), angle_deg=None)
        self._clock.wait(permit.pulses / self._rate_hz)
        return permit.pulses

    @property
    def sweep_period_s(self) -> float:
        """Time between two pulses, in seconds."""
        return 1 / self._rate_hz

    @property
    def delay_sigma_s(self) -> float:
        """Standard deviation of the unknown delay of all pulses, in seconds."""
        return DELAY_SIGMA_S if self._delay_sigma_s is None else self._delay_sigma_s

    def begin_sweep(self, permit: SweepPermit) -> None:
        """Begin to fire single pulses; refused as by `fire`."""
        self._use(permit)
        self._sweep, self._began_s, self._fired, self._untold = permit, self._clock.now_s(), 0, []

    def pulses(self) -> Sequence[Pulse]:
        """Pulses since the last call; they are fired here, at their times that have gone by."""
        self._fire_until(self._clock.now_s())
        told, self._untold = self._untold, []
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
        stamp_s = at_s - self._true_delay_s + CLOCK_DRIFT * (at_s - self._began_s)
        if self._rng is not None and self._stamp_jitter_s > 0:
            stamp_s += self._stamp_jitter_s * float(self._rng.standard_normal())
        self._untold.append(Pulse(at_s=stamp_s))

    def _flash(self, pulses: int, at_s: float, *, angle_deg: float | None) -> None:
        """Light the tissue with the energy that the laser has then."""
        self._world.flash(pulses=pulses, at_s=at_s)
        vary_last_flash(
            self._world, spread=self._energy_spread, drift_per_min=self._energy_drift_per_min, now_s=at_s, rng=self._rng
        )
        if self._rng is not None and self._without_light > 0:
            flash = self._world.flashes[-1]
            lit = pulses - int(self._rng.binomial(pulses, self._without_light))
            self._world.flashes[-1] = replace(flash, energy=flash.energy * lit / pulses)
        if angle_deg is not None:
            self._world.flashes[-1] = replace(self._world.flashes[-1], angle_deg=angle_deg)


def vary_last_flash(
    world: SimulatedWorld, *, spread: float, drift_per_min: float, now_s: float, rng: np.random.Generator | None
) -> None:
    """Give the last flash of a world the energy that a laser has now.

    ``spread``: standard deviation of ln energy from one acquisition to the next. ``drift_per_min``: change of ln energy
    in a minute.
    """
    log_energy = drift_per_min * now_s / 60
    if rng is not None and spread > 0:
        log_energy += spread * float(rng.standard_normal())
    if log_energy != 0:
        flash = world.flashes[-1]
        world.flashes[-1] = replace(flash, energy=flash.energy * math.exp(log_energy))
