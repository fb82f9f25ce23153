"""A receiver and its reader that fail on request, around the simulated ones."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from msgspec import structs

from markerseek.core import AcquisitionError, ChannelFrame, Frame, Permit, Reader, Reading, ReadingFrame, SweepPermit
from markerseek.sim import SimulatedReceiver, VirtualClock

from .faulty import SLOWER, Faulty
from .vocabulary import Fault


class FaultyReceiver(Faulty):
    """A data acquisition and its reader as the search sees them."""

    device = "receiver"

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
        sweeps: bool,
    ) -> None:
        super().__init__(inner, clock, faults, rng)
        self._reader = reader
        self._while_reading = while_reading
        self._readout_s = readout_s
        self._last: ReadingFrame | None = None
        self._held: float | None = None
        self._stale = True
        self._until = 0
        self._unread = 0
        self._shift = 0
        self._sweeps = sweeps
        self._quiet = set[int]()

    def settle(self) -> None:
        """Wait for a readout; files of a search before land in that time, and are gone then."""
        self._clock.wait(self._readout_s)
        if self._stale and (late := self.has("late files", silently=True, ever=True)) is not None:
            self._stale = False
            self.act(late)
            raise AcquisitionError("receiver: stale files landed although nothing was triggered; they are not used")

    def arm(self, permit: Permit) -> None:
        self.reach(silently=True)
        self._inner.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        self.step += 1
        self._unread = 0
        self.reach()
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
        faulty = self._faulty_frame(frame, self._last)
        self._last = frame
        return faulty

    def begin_sweep(self, permit: SweepPermit) -> None:
        self.step += 1
        self._until = int(self._rng.integers(2, 60))
        self._unread = self._until
        self._shift = 0
        self.reach()
        self._inner.begin_sweep(permit)

    def frames(self) -> Sequence[Frame]:
        self.reach()
        return self._swept(self._inner.frames())

    def end_sweep(self, *, pulses: int) -> Sequence[Frame]:
        self.reach()
        slow = self.has("slow", silently=True)
        if slow is not None:
            self._clock.wait(min(slow.amount, SLOWER) * self._readout_s)
            if slow.amount > SLOWER:
                self.act(slow)
                raise AcquisitionError("receiver: no frames came in time; check it and start again")
        return self._swept(self._inner.end_sweep(pulses=pulses))

    def _swept(self, frames: Sequence[Frame]) -> Sequence[Frame]:
        """Frames of a sweep as it hands them over."""
        handed_over: list[Frame] = []
        for each in frames:
            self._until -= 1
            if not isinstance(each, ReadingFrame):
                raise TypeError("a world of readings was asked for")
            if self.has("off"):
                continue
            if (lost := self.has("lost frames", silently=True)) is not None and self.chance(lost.amount):
                # Counted: the next frame's number shows it, and where none comes any more their number does.
                self.act(lost)
                continue
            if self._until == 0 and self.has("trigger lost"):
                self._shift -= 1
                continue
            frame = structs.replace(
                each, header=structs.replace(each.header, sequence=each.header.sequence + self._shift)
            )
            handed_over.append(self._faulty_frame(frame, self._last))
            if self._until == 0 and self.has("trigger doubled"):
                self._shift += 1
                handed_over.append(
                    structs.replace(each, header=structs.replace(frame.header, sequence=frame.header.sequence + 1))
                )
            self._last = frame
        return handed_over

    def read(self, frame: Frame) -> Reading:
        reading = self._reader.read(frame)
        if (full := self.has("saturated")) is not None:
            return structs.replace(reading, saturated_fraction=full.amount)
        self._unread -= 1
        pulses = frame.header.pulses
        # In a run with sweeps not in the first frame of as many pulses: that is a noisy rig.
        early = self._unread >= 0 or (self._sweeps and pulses not in self._quiet)
        if not early and (burst := self.has("burst")) is not None:
            sigma = (reading.noise_sigma or 0.0) * burst.amount
            noise = sigma * float(self._rng.uniform(4, 6))
            return structs.replace(reading, intensity=max(reading.intensity, noise), noise_sigma=sigma)
        self._quiet.add(pulses)
        if self.has("garbled feature"):
            # past the reading's own check: the guard's is tried
            reading = structs.replace(reading)
            structs.force_setattr(reading, "noise_sigma", math.nan)
            return reading
        return reading

    def _faulty_frame(self, frame: ReadingFrame, last: ReadingFrame | None) -> Frame:
        header = frame.header
        if last is not None and (self.has("stuck") or self.has("late frames")):
            return last
        if last is not None and self.has("same data"):
            self._held = last.intensity if self._held is None else self._held
            return structs.replace(frame, intensity=self._held)
        self._held = None
        if last is not None and (mixed := self.has("mixed triggers")) is not None:
            intensity = (1 - mixed.amount) * frame.intensity + mixed.amount * last.intensity
            return structs.replace(frame, intensity=intensity)
        if last is not None and self.has("one behind"):
            return structs.replace(frame, intensity=last.intensity)
        for name, intensity in (("dead", 0.0), ("NaN", math.nan), ("infinite", math.inf), ("negative", -1.0)):
            if self.has(name):
                return structs.replace(frame, intensity=intensity)
        if (gain := self.has("gain drops")) is not None:
            return structs.replace(frame, intensity=frame.intensity * gain.amount)
        if (times := self.has("garbage at times", silently=True)) is not None and self.chance(times.amount):
            self.act(times)
            return structs.replace(frame, intensity=math.nan)
        if self.has("other kind"):
            return ChannelFrame(header=header, samples=np.arange(8, dtype=np.int16).reshape(2, 4), sampling_hz=4e7)
        return structs.replace(frame, header=self._faulty_header(frame))

    def _faulty_header(self, frame: ReadingFrame) -> Any:
        header = frame.header
        if self.has("other token"):
            return structs.replace(header, token=f"{header.token}0")
        if header.sequence > 1 and self.has("out of order"):
            return structs.replace(header, sequence=header.sequence - 1)
        if (pulses := self.has("other pulses")) is not None:
            return structs.replace(header, pulses=header.pulses + max(1, round(pulses.amount)))
        if (angle := self.has("other angle")) is not None:
            return structs.replace(header, commanded_deg=header.commanded_deg + angle.amount)
        if (old := self.has("old frames")) is not None:
            return structs.replace(header, started_s=header.started_s - old.amount, ended_s=header.ended_s - old.amount)
        if (future := self.has("frames of the future")) is not None:
            return structs.replace(
                header, started_s=header.started_s + future.amount, ended_s=header.ended_s + future.amount
            )
        return header
