"""Stage, laser and receiver that fail as they are told, around the simulated ones: the truth stays in the world.

A step of the stage is a move, of the laser a firing, of the receiver an acquisition, each counted from 1. ``acted``
holds the faults that changed something that a healthy device would not have done.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from markerseek.core import (
    AcquisitionError,
    ChannelFrame,
    DeviceTimeoutError,
    Frame,
    Interval,
    LaserError,
    MoveError,
    Permit,
    Reader,
    Reading,
    ReadingFrame,
)
from markerseek.sim import SimulatedLaser, SimulatedReceiver, SimulatedStage, StageMotion, VirtualClock
from markerseek.sim.faults import Fault

from .world import WatchedWorld

ANSWER_S = 0.5
"""How long a driver waits for an answer."""

COUNTS_PER_DEG = StageMotion().counts_per_deg

SLOWER = 3.0
"""How many times the usual a driver allows for a move, a train of pulses, or a readout."""


class Faulty:
    """The faults of one device, and its steps."""

    def __init__(self, faults: tuple[Fault, ...], rng: np.random.Generator) -> None:
        self.step = 0
        self.acted: list[Fault] = []
        self._faults = faults
        self._rng = rng

    def has(self, name: str, *, silently: bool = False) -> Fault | None:
        """The fault of that name if it holds now; it acts unless it is only asked for."""
        for fault in self._faults:
            if fault.name == name and fault.holds_at(self.step):
                if not silently:
                    self.act(fault)
                return fault
        return None

    def act(self, fault: Fault) -> None:
        """Note that the fault did something."""
        if fault not in self.acted:
            self.acted.append(fault)

    def chance(self, share: float) -> bool:
        return bool(self._rng.random() < share)


class FaultyStage(Faulty):
    """A stage as its driver shows it."""

    def __init__(
        self,
        inner: SimulatedStage,
        world: WatchedWorld,
        clock: VirtualClock,
        faults: tuple[Fault, ...],
        rng: np.random.Generator,
        turning: Callable[[], None],
    ) -> None:
        super().__init__(faults, rng)
        self.limits: Interval = inner.limits
        self._inner = inner
        self._world = world
        self._clock = clock
        self._turning = turning
        self._frozen_deg: float | None = None
        self._before_deg = inner.angle_deg
        self._told_deg: float | None = None
        self._creep_deg = 0.0

    @property
    def angle_deg(self) -> float:
        if self.has("unplugged"):
            raise OSError("device disconnected")
        if self.has("silent") or ((lost := self.has("drop-outs", silently=True)) and self._lost(lost)):
            self._clock.wait(ANSWER_S)
            raise DeviceTimeoutError(f"stage: no answer within {ANSWER_S} s")
        told_deg = self._told(self._inner.angle_deg)
        return self._stale(told_deg) if told_deg == self._inner.angle_deg else told_deg

    def _told(self, true_deg: float) -> float:
        """What it makes of its angle."""
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
        """An angle of another moment, where it tells one."""
        for name, told_deg in (
            ("says it is there", self._told_deg),
            ("frozen readback", self._frozen_deg),
            ("late readback", self._before_deg),
        ):
            if (fault := self.has(name, silently=True)) is not None and told_deg is not None:
                if abs(told_deg - true_deg) > 0.1:
                    self.act(fault)
                return told_deg
        return true_deg

    def move_to(self, angle_deg: float) -> float:
        self.step += 1
        self._creep_deg = 0.0
        self._before_deg = self._inner.angle_deg
        if self.has("frozen readback", silently=True) and self._frozen_deg is None:
            self._frozen_deg = self._inner.angle_deg
        if self.has("unplugged"):
            raise OSError("device disconnected")
        self._world.moving = True
        try:
            self._turn(angle_deg)
        finally:
            self._world.moving = False
        self._told_deg = angle_deg
        self._loosen()
        return self.angle_deg

    def stop(self) -> None:
        if self.has("unplugged", silently=True):
            raise OSError("device disconnected")

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

    def _lost(self, fault: Fault) -> bool:
        if not self.chance(fault.amount):
            return False
        self.act(fault)
        return True


class FaultyLaser(Faulty):
    """A laser box as its driver shows it."""

    def __init__(
        self,
        inner: SimulatedLaser,
        world: WatchedWorld,
        clock: VirtualClock,
        faults: tuple[Fault, ...],
        rng: np.random.Generator,
        *,
        tell: Callable[[Permit], None],
        stage_rests: Callable[[], None],
        readout_s: float,
    ) -> None:
        super().__init__(faults, rng)
        self._inner = inner
        self._world = world
        self._clock = clock
        self._tell = tell
        self._stage_rests = stage_rests
        self._readout_s = readout_s
        self.due: tuple[float, Permit] | None = None

    def fire(self, permit: Permit) -> int:
        self.step += 1
        if self.has("unplugged"):
            raise OSError("device disconnected")
        if self.has("busy"):
            raise LaserError("laser: BUSY")
        self._tell(permit)
        drop = self.has("energy drops")
        self._world.energy = 1.0 if drop is None else drop.amount
        fired, told = self._train(permit)
        self._stage_rests()
        if self.has("silent"):
            self._clock.wait(ANSWER_S)
            raise DeviceTimeoutError(f"laser: no answer within {ANSWER_S} s")
        if (late := self.has("late answer")) is not None:
            self._clock.wait(late.amount)
            raise DeviceTimeoutError(f"laser: no answer within {ANSWER_S} s")
        if (slow := self.has("slow", silently=True)) is not None and fired:
            self._clock.wait(slow.amount * fired / 100)
            if slow.amount > SLOWER:
                self.act(slow)
                raise DeviceTimeoutError("laser: the train did not end in time; its lease has lapsed")
        if self.has("garbled count"):
            garbage: list[Any] = [-1, 10**9, math.nan, None, permit.pulses + 0.5]
            return garbage[int(self._rng.integers(len(garbage)))]  # type: ignore[no-any-return]
        return told

    def disarm(self) -> None:
        self.due = None
        if self.has("unplugged", silently=True):
            raise OSError("device disconnected")

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
        """Pulses that were really fired, and those it tells."""
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


class FaultyReceiver(Faulty):
    """A data acquisition and its reader as the search sees them."""

    def __init__(
        self,
        inner: SimulatedReceiver,
        reader: Reader,
        clock: VirtualClock,
        faults: tuple[Fault, ...],
        rng: np.random.Generator,
        *,
        while_reading: Callable[[], None],
        readout_s: float,
    ) -> None:
        super().__init__(faults, rng)
        self._inner = inner
        self._reader = reader
        self._clock = clock
        self._while_reading = while_reading
        self._readout_s = readout_s
        self._last: ReadingFrame | None = None
        self._held: float | None = None

    def arm(self, permit: Permit) -> None:
        if self.has("unplugged", silently=True):
            raise OSError("device disconnected")
        self._inner.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        self.step += 1
        if self.has("unplugged"):
            raise OSError("device disconnected")
        slow = self.has("slow", silently=True)
        if slow is not None:
            self._clock.wait(min(slow.amount, SLOWER) * self._readout_s)
        frame = self._inner.acquire(permit)
        self._while_reading()
        if self.has("off") or (slow is not None and slow.amount > SLOWER):
            if slow is not None:
                self.act(slow)
            raise AcquisitionError("receiver: no frame came in time; check it and start again")
        if not isinstance(frame, ReadingFrame):
            raise TypeError("a world of readings was asked for")
        if (lost := self.has("lost frames", silently=True)) is not None and self.chance(lost.amount):
            self.act(lost)
            raise AcquisitionError("receiver: files are missing")
        spoilt = self._spoilt(frame, self._last)
        self._last = frame
        return spoilt

    def read(self, frame: Frame) -> Reading:
        reading = self._reader.read(frame)
        if (full := self.has("saturated")) is not None:
            return replace(reading, saturated_fraction=full.amount)
        if (burst := self.has("burst")) is not None:
            sigma = (reading.noise_sigma or 0.0) * burst.amount
            noise = sigma * float(self._rng.uniform(4, 6))
            return replace(reading, intensity=max(reading.intensity, noise), noise_sigma=sigma)
        if self.has("garbled feature"):
            return replace(reading, noise_sigma=math.nan)
        return reading

    def _spoilt(self, frame: ReadingFrame, last: ReadingFrame | None) -> Frame:
        header = frame.header
        if last is not None and (self.has("stuck") or self.has("late frames")):
            return last
        if last is not None and self.has("same data"):
            self._held = last.intensity if self._held is None else self._held
            return replace(frame, intensity=self._held)
        self._held = None
        if last is not None and self.has("one behind"):
            return replace(frame, intensity=last.intensity)
        for name, intensity in (("dead", 0.0), ("NaN", math.nan), ("infinite", math.inf), ("negative", -1.0)):
            if self.has(name):
                return replace(frame, intensity=intensity)
        if (gain := self.has("gain drops")) is not None:
            return replace(frame, intensity=frame.intensity * gain.amount)
        if (times := self.has("garbage at times", silently=True)) is not None and self.chance(times.amount):
            self.act(times)
            return replace(frame, intensity=math.nan)
        if self.has("other kind"):
            return ChannelFrame(header=header, samples=np.arange(8, dtype=np.int16).reshape(2, 4), sampling_hz=4e7)
        return replace(frame, header=self._spoilt_header(frame))

    def _spoilt_header(self, frame: ReadingFrame) -> Any:
        header = frame.header
        if self.has("other token"):
            return replace(header, token=f"{header.token}0")
        if header.sequence > 1 and self.has("out of order"):
            return replace(header, sequence=header.sequence - 1)
        if (pulses := self.has("other pulses")) is not None:
            return replace(header, pulses=header.pulses + max(1, round(pulses.amount)))
        if (angle := self.has("other angle")) is not None:
            return replace(header, commanded_deg=header.commanded_deg + angle.amount)
        if (old := self.has("old frames")) is not None:
            return replace(header, started_s=header.started_s - old.amount, ended_s=header.ended_s - old.amount)
        if (future := self.has("frames of the future")) is not None:
            return replace(header, started_s=header.started_s + future.amount, ended_s=header.ended_s + future.amount)
        return header
