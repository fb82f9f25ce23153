"""A simulated pulsed laser behind a pulse counter: it fires the pulses of a permit, once."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from markerseek.core import Clock, ConfigError, LaserError, Permit
from markerseek.sim.world import SimulatedWorld


class SimulatedLaser:
    """Laser of a simulated world.

    ``rate_hz``: pulses per second. ``energy_spread``: standard deviation of ln energy from one acquisition to the next,
    beside that of the pulses. ``energy_drift_per_min``: change of ln energy in a minute.
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        clock: Clock,
        rate_hz: float = 100.0,
        energy_spread: float = 0.0,
        energy_drift_per_min: float = 0.0,
        rng: np.random.Generator | None = None,
    ) -> None:
        if energy_spread > 0 and rng is None:
            raise ConfigError(f"laser: energy_spread is {energy_spread}, and there is no rng to draw the energies from")
        if not 0 < rate_hz < math.inf:
            raise ConfigError(f"laser: rate_hz is {rate_hz} Hz, it must be positive and finite")
        self._world = world
        self._clock = clock
        self._rate_hz = rate_hz
        self._energy_spread, self._energy_drift_per_min = energy_spread, energy_drift_per_min
        self._rng = rng
        self._used: set[str] = set()

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses and return how many were; a permit of 0 pulses only triggers.

        Raises `LaserError` if the permit was used before or has expired; nothing is fired.
        """
        if permit.token in self._used:
            raise LaserError(f"laser: the permit {permit.token!r} was used before; nothing was fired")
        # Not ">", which would let a NaN pass.
        if not self._clock.now_s() <= permit.expires_s:
            raise LaserError(f"laser: the permit {permit.token!r} has expired; nothing was fired")
        # Noted before the flash: a permit that failed half-way must not fire again.
        self._used.add(permit.token)
        if permit.pulses > 0:
            # One flash for the whole train, at its beginning: a frame is the average of its pulses.
            self._world.flash(pulses=permit.pulses, at_s=self._clock.now_s())
            vary_last_flash(
                self._world,
                spread=self._energy_spread,
                drift_per_min=self._energy_drift_per_min,
                now_s=self._clock.now_s(),
                rng=self._rng,
            )
        self._clock.wait(permit.pulses / self._rate_hz)
        return permit.pulses

    def disarm(self) -> None:
        """Nothing to do: this laser holds no permit between two calls of `fire`."""


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
