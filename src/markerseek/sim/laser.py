"""A simulated pulsed laser behind a pulse counter: it fires the pulses of a permit, once."""

from __future__ import annotations

import math

from markerseek.core import Clock, ConfigError, LaserError, Permit
from markerseek.sim.world import SimulatedWorld


class SimulatedLaser:
    """Laser of a simulated world.

    Parameters
    ----------
    world
        The world that it lights.
    clock
        Virtual time.
    rate_hz
        Pulses per second.
    """

    def __init__(self, *, world: SimulatedWorld, clock: Clock, rate_hz: float = 100.0) -> None:
        if not 0 < rate_hz < math.inf:
            raise ConfigError(f"laser: rate_hz is {rate_hz} Hz, it must be positive and finite")
        self._world = world
        self._clock = clock
        self._rate_hz = rate_hz
        self._used: set[str] = set()

    def fire(self, permit: Permit) -> int:
        """Fire the permitted pulses and return how many were; a permit of 0 pulses only triggers.

        Raises
        ------
        LaserError
            If the permit was used before or has expired; nothing is fired.
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
        self._clock.wait(permit.pulses / self._rate_hz)
        return permit.pulses

    def disarm(self) -> None:
        """Nothing to do: this laser holds no permit between two calls of `fire`."""
