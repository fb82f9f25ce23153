"""A stage that fails on request, around the simulated one."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import structs

from markerseek.core import DeviceTimeoutError, MoveError, StageReading
from markerseek.scan.sweeping import SLOWEST
from markerseek.sim import SimulatedStage, StageMotion, VirtualClock

from .faulty import SLOWER, Faulty
from .vocabulary import Fault
from .world import WatchedWorld

COUNTS_PER_DEG = StageMotion().counts_per_deg

TOO_SLOW = 1.1 / SLOWEST
FASTER = 1.25
ARRIVAL_DEG = 0.1
BEYOND_DEG = 0.15
"""How many times as slowly as the probe can turn on its way a sweep is never lit; how many times as fast, and by how
much more in degrees, a reading is refused; and how far beyond its end one is, in degrees, with some room."""


class FaultyStage(Faulty):
    """A stage as its driver shows it."""

    device = "stage"

    def __init__(
        self,
        inner: SimulatedStage,
        world: WatchedWorld,
        clock: VirtualClock,
        faults: tuple[Fault, ...],
        rng: np.random.Generator,
        turning: Callable[[], None],
    ) -> None:
        super().__init__(inner, clock, faults, rng)
        self._world = world
        self._turning = turning
        self._frozen_deg: float | None = None
        self._before_deg = inner.angle_deg
        self._target_deg: float | None = None
        self._creep_deg = 0.0
        self._until = 0
        self._forth = 1.0
        self._asked_deg_s = 0.0
        self._read = StageReading(angle_deg=inner.angle_deg, asked_s=0.0, answered_s=0.0)

    @property
    def angle_deg(self) -> float:
        self._answer()
        return self._told_deg(self._inner.angle_deg)

    def _reported_deg(self, true_deg: float) -> float:
        """The angle that it reports for a true one."""
        if self.has("NaN readback"):
            return math.nan
        if wild := self.has("wild readback"):
            return float(self._rng.uniform(-wild.amount, wild.amount))
        if (turned := self.has("turned readback", silently=True)) and true_deg < 0:
            self.act(turned)
            return true_deg % 360
        if (jump := self.has("readback jump")) is not None:
            return true_deg + jump.amount
        return true_deg

    def _stale(self, true_deg: float) -> float:
        """An angle of another moment, if a fault has it report one."""
        for name, reported_deg in (
            ("says it is there", self._target_deg),
            ("frozen readback", self._frozen_deg),
            ("late readback", self._before_deg),
        ):
            if (fault := self.has(name, silently=True)) is not None and reported_deg is not None:
                if abs(reported_deg - true_deg) > 0.1:
                    self.act(fault)
                return reported_deg
        return true_deg

    def move_to(self, angle_deg: float) -> float:
        self.step += 1
        self._creep_deg = 0.0
        self._begin()
        self._world.moving = True
        try:
            self._turn(angle_deg)
        finally:
            self._world.moving = False
        self._target_deg = angle_deg
        self._loosen()
        return self.angle_deg

    def stop(self) -> None:
        self.reach(silently=True)
        self._inner.stop()

    def prepare_sweep(self, *, speed_deg_s: float) -> None:
        self.step += 1
        self._asked_deg_s = speed_deg_s
        if (fast := self.has("fast", silently=True)) is not None:
            speed_deg_s *= fast.amount
        if (slow := self.has("slow", silently=True)) is not None:
            speed_deg_s /= slow.amount
        self._inner.prepare_sweep(speed_deg_s=speed_deg_s)

    def begin_sweep(self, to_deg: float) -> None:
        self._begin()
        self._target_deg = to_deg
        self._until = int(self._rng.integers(2, 60))
        self._forth = math.copysign(1.0, to_deg - self._before_deg)
        if self.has("frozen motor"):
            return
        if (slow := self.has("slow", silently=True)) is not None:
            reached_deg_s = math.sqrt(abs(to_deg - self._before_deg) * self._inner.acceleration_deg_s2)
            if self._asked_deg_s / slow.amount < min(self._asked_deg_s, reached_deg_s) / TOO_SLOW:
                self.act(slow)
        self._inner.begin_sweep(to_deg)
        now_s = self._clock.now_s()
        self._read = StageReading(angle_deg=self._before_deg, asked_s=now_s, answered_s=now_s)
        self._loosen()
        for name in ("overshoot", "runaway"):
            if (beyond := self.has(name, silently=True)) is not None:
                # Beyond the limits, too: that is the fault.
                self._inner._sweep_to_deg += self._forth * beyond.amount
                # Its way was planned to the target before.
                self._inner._legs = [self._inner._leg(self._inner.angle_deg, 0.0)]

    def read_sweep(self) -> StageReading:
        self.host.read()
        self._answer()
        reading = self._inner.read_sweep()
        self._until -= 1
        if self._until == 0:
            if self.has("stall", silently=True):
                self._inner.brake()
            if (jump := self.has("jump on its way")) is not None:
                raise MoveError(f"stage: its counter jumped by {jump.amount:.2f} deg on its way")
        wall = self.has("obstacle", silently=True)
        begun = self._forth * self._before_deg
        here = self._forth * reading.angle_deg
        if wall is not None and begun < self._forth * wall.amount <= here:
            self._inner.brake()
        self._notice(reading)
        if (late := self.has("late readings")) is not None:
            self._clock.wait(late.amount)
            reading = structs.replace(reading, answered_s=self._clock.now_s())
        return structs.replace(reading, angle_deg=self._told_deg(reading.angle_deg))

    def _notice(self, reading: StageReading) -> None:
        """Note that it turns too fast, or too far: only then has it done something wrong."""
        elapsed_s = reading.at_s - self._read.at_s
        fast = self.has("fast", silently=True)
        if (
            fast
            and abs(reading.angle_deg - self._read.angle_deg) > FASTER * self._asked_deg_s * elapsed_s + ARRIVAL_DEG
        ):
            self.act(fast)
        self._read = reading
        for name in ("overshoot", "runaway"):
            beyond = self.has(name, silently=True)
            if beyond is not None and self._forth * (reading.angle_deg - (self._target_deg or 0.0)) > BEYOND_DEG:
                self.act(beyond)

    def _told_deg(self, true_deg: float) -> float:
        """The angle that it tells for a true one."""
        reported_deg = self._reported_deg(true_deg)
        return self._stale(true_deg) if reported_deg == true_deg else reported_deg

    def brake(self) -> None:
        self.reach(silently=True)
        self._inner.brake()

    def end_sweep(self) -> None:
        self._inner.end_sweep()
        self._world.settle()

    def rest(self) -> None:
        """What a stage does that should rest, while the laser fires."""
        if self._creep_deg:
            self._world.angle_deg += self._creep_deg
            self._inner.counts = round(self._world.angle_deg * COUNTS_PER_DEG)
            self._creep_deg = 0.0

    def _turn(self, angle_deg: float) -> None:
        start_deg = self._inner.angle_deg
        way_deg = angle_deg - start_deg
        self._turning()
        if self.has("says it is there", silently=True) or (abs(way_deg) > 0.1 and self.has("frozen motor")):
            self._clock.wait(0.5)
            return
        if (slow := self.has("slow", silently=True)) is not None:
            usual_s = 0.3 * abs(way_deg)
            self._clock.wait(min(slow.amount, SLOWER) * usual_s)
            if slow.amount > SLOWER and abs(way_deg) > 0.1:
                self.act(slow)
                self._go(start_deg + way_deg * SLOWER / slow.amount)
                raise DeviceTimeoutError("stage: it has not arrived in time, and was stopped")
        if abs(way_deg) > 0.1 and self.has("stall"):
            self._go(start_deg + self._rng.uniform(0, 1) * way_deg)
            raise MoveError("stage: it stalled")
        if abs(way_deg) > 0.1 and (jump := self.has("jump on its way")) is not None:
            # The counter is off from here on; what the driver makes of it is measured over bytes.
            self._go(start_deg + self._rng.uniform(0, 1) * way_deg)
            self._inner.counts += round(jump.amount * COUNTS_PER_DEG)
            raise MoveError(f"stage: its counter jumped by {jump.amount:.2f} deg on its way")
        target_deg = self._target(angle_deg, way_deg)
        self._go(target_deg)

    def _target(self, angle_deg: float, way_deg: float) -> float:
        """Where it really goes."""
        forth = math.copysign(1.0, way_deg)
        if (wall := self.has("obstacle", silently=True)) is not None:
            start_deg = angle_deg - way_deg
            if min(start_deg, angle_deg) < wall.amount < max(start_deg, angle_deg):
                if abs(wall.amount - angle_deg) > 0.1:
                    self.act(wall)
                return wall.amount
        if (short := self.has("stops short", silently=True)) is not None and abs(way_deg) > short.amount:
            self.act(short)
            return angle_deg - forth * short.amount
        for name in ("overshoot", "runaway"):
            if (beyond := self.has(name)) is not None:
                return angle_deg + forth * beyond.amount
        if (late := self.has("late rest", silently=True)) is not None and abs(way_deg) > late.amount:
            self.act(late)
            self._creep_deg = forth * late.amount
            return angle_deg - self._creep_deg
        return angle_deg

    def _go(self, angle_deg: float) -> None:
        if angle_deg in self.limits:
            self._inner.move_to(angle_deg)
            return
        # The motor obeys no limits here: that is the fault.
        self._clock.wait(1.0)
        self._inner.counts = round(angle_deg * COUNTS_PER_DEG)
        self._world.angle_deg = angle_deg

    def _loosen(self) -> None:
        """What lies between the encoder and the probe."""
        if (slip := self.has("slip")) is not None:
            self._world.slip_deg = slip.amount
        if (scale := self.has("scale")) is not None:
            self._world.scale = 1 + scale.amount
        if (play := self.has("more play")) is not None:
            self._world.slip_deg = play.amount
        self._world.settle()

    def _answer(self) -> None:
        """Raise if no answer comes to a question for the angle."""
        self.reach()
        if self.has("silent"):
            self.no_answer()
        if (lost := self.has("drop-outs", silently=True)) and self.chance(lost.amount):
            self.act(lost)
            self.no_answer()

    def _begin(self) -> None:
        """Begin to turn from where it is."""
        self._before_deg = self._inner.angle_deg
        if self.has("frozen readback", silently=True) and self._frozen_deg is None:
            self._frozen_deg = self._inner.angle_deg
        self.reach()
