"""A laser that fails on request, around the simulated one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from markerseek.core import DeviceTimeoutError, LaserError, Permit, Pulse, SweepPermit
from markerseek.sim import SimulatedLaser, VirtualClock

from .faulty import SLOWER, Faulty
from .vocabulary import Fault
from .world import WatchedWorld

DARK_S = 1.0
"""Time in light after which a sweep without a pulse is refused, in seconds, with some room."""


class FaultyLaser(Faulty):
    """A laser box as its driver shows it."""

    device = "laser"

    def __init__(
        self,
        inner: SimulatedLaser,
        world: WatchedWorld,
        clock: VirtualClock,
        faults: tuple[Fault, ...],
        rng: np.random.Generator,
        *,
        send: Callable[[Permit], None],
        stage_rests: Callable[[], None],
        readout_s: float,
    ) -> None:
        super().__init__(inner, clock, faults, rng)
        self._world = world
        self._send = send
        self._stage_rests = stage_rests
        self._readout_s = readout_s
        self.due: tuple[float, Permit] | None = None
        self.sweeps: list[tuple[SweepPermit, float]] = []
        self._dark: Fault | None = None

    def _take(self, permit: Permit | SweepPermit) -> None:
        """A permit comes, to an energy that may have dropped."""
        self.step += 1
        self.reach()
        if self.has("busy"):
            raise LaserError("laser: BUSY")
        self._send(permit)
        drop = self.has("energy drops")
        self._world.energy = 1.0 if drop is None else drop.amount

    def fire(self, permit: Permit) -> int:
        self._take(permit)
        fired, reported = self._train(permit)
        self._stage_rests()
        if self.has("silent"):
            self.no_answer()
        if (late := self.has("late answer")) is not None:
            self.no_answer(after_s=late.amount)
        if (slow := self.has("slow", silently=True)) is not None and fired:
            self._clock.wait(slow.amount * fired / 100)
            if slow.amount > SLOWER:
                self.act(slow)
                raise DeviceTimeoutError("laser: the train did not end in time; its lease has lapsed")
        return self._garbled(permit.pulses) if self.has("garbled count") else reported

    def _garbled(self, pulses: int) -> int:
        garbage: list[Any] = [-1, 10**9, math.nan, None, pulses + 0.5]
        return garbage[int(self._rng.integers(len(garbage)))]  # type: ignore[no-any-return]

    def lapse(self, until_s: float) -> None:
        """Fire on without a host until a time, at which the lease has lapsed."""
        if self._dark is None:
            self._inner._fire_until(until_s)
        self._inner.disarm()

    def disarm(self) -> None:
        self.due = None
        self.reach(silently=True)
        self._inner.disarm()

    def prepare_sweep(self) -> None:
        self._inner.prepare_sweep()

    def begin_sweep(self, permit: SweepPermit) -> None:
        self._take(permit)
        self.sweeps.append((permit, self._clock.now_s()))
        self._until = int(self._rng.integers(2, 60))
        self._step_s = 0.0
        self._more = 0
        self._dark = self.has("dead lamp", silently=True)
        if self._dark is None:
            self._inner.begin_sweep(permit)
        if (late := self.has("late answer")) is not None:
            self.no_answer(after_s=late.amount)

    def pulses(self) -> Sequence[Pulse]:
        self.reach()
        if self.has("silent"):
            self.no_answer()
        told = [] if self._dark is not None else list(self._inner.pulses())
        for each in range(len(told)):
            self._until -= 1
            if self._until == 0:
                self._break_sweep()
            told[each] = replace(told[each], at_s=told[each].at_s + self._step_s)
        return told

    def _break_sweep(self) -> None:
        """What goes wrong at one pulse of a sweep, once, and is not told."""
        if (step := self.has("clock step")) is not None:
            self._step_s = step.amount
        if self.has("hidden misfire"):
            del self._world.flashes[-1], self._world.lights[-1]
        if self.has("interlock", silently=True):
            self._inner.disarm()
        if (more := self.has("extra pulses")) is not None:
            self._more = max(1, round(more.amount))
            self._world.flashes += self._more * self._world.flashes[-1:]
            self._world.lights += self._more * self._world.lights[-1:]

    def end_sweep(self) -> int:
        if self._dark is not None:
            if self._clock.now_s() - self.sweeps[-1][1] > DARK_S:
                self.act(self._dark)
            return 0
        fired = self._inner.end_sweep() + self._more
        return self._garbled(fired) if self.has("garbled count") else fired

    def stage_moves(self) -> None:
        """Called while the stage moves."""
        if self.step and (alone := self.has("fires by itself")) is not None:
            self._world.flash(pulses=max(1, round(alone.amount)), at_s=self._clock.now_s())

    def due_light(self) -> None:
        """Light that comes too late, once its moment has come."""
        if self.due is not None and self._clock.now_s() >= self.due[0]:
            self._world.flash(pulses=self.due[1].pulses, at_s=self.due[0])
            self.due = None

    def _train(self, permit: Permit) -> tuple[int, int]:
        """Pulses that were really fired, and those it reports."""
        pulses = permit.pulses
        if pulses == 0:
            dark = self.has("light in the dark")
            if dark is None:
                return self._inner.fire(permit), 0
            return self._flash(permit, max(1, round(dark.amount))), 0
        if self.has("dead lamp"):
            return self._flash(permit, 0), 0
        if (late := self.has("late light")) is not None:
            self._clock.wait(pulses / 100)
            self.due = (self._clock.now_s() + late.amount * self._readout_s, permit)
            return pulses, pulses
        if (opened := self.has("interlock")) is not None:
            fired = self._flash(permit, int(opened.amount * pulses))
            return fired, fired
        if (more := self.has("extra pulses")) is not None:
            fired = self._flash(permit, pulses + max(1, round(more.amount)))
            return fired, fired
        for name in ("fewer pulses", "hidden misfire", "misfires"):
            fault = self.has(name, silently=True)
            if fault is None or (name == "misfires" and not self.chance(fault.amount)):
                continue
            self.act(fault)
            missing = 1 if name == "misfires" else round(fault.amount)
            fired = self._flash(permit, max(0, pulses - missing))
            return fired, pulses if name == "hidden misfire" else fired
        fired = self._inner.fire(permit)
        return fired, fired

    def _flash(self, permit: Permit, pulses: int) -> int:
        if pulses:
            self._world.flash(pulses=pulses, at_s=self._clock.now_s())
        self._clock.wait(permit.pulses / 100)
        return pulses
