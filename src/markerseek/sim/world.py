"""The true state of a simulation: absorbers, the angle of the probe, the flashes that were fired, and virtual time.

Devices of this package act on the world and report what their sensors read. Tests and the guard's campaigns compare
those reports with this state. Waiting takes no real time, unless a pace is set for someone who watches.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, Noise, digitise
from markerseek.core import ChannelFrame, ConfigError, Float32, Frame, FrameHeader, Int16, require_pace
from markerseek.sim.motion import TissueMotion, displaced, moments_s

_SLICE_S = 0.02
"""Longest time between two beats of a wait, in seconds."""


class VirtualClock:
    """A clock that a wait sets forward.

    ``pace``: real seconds that a virtual second takes; 0 takes none, 1 runs at real speed; at most `MAX_PACE`.
    ``beat``: called in each wait, and every 20 ms of real time, or of virtual time without a pace; None calls nothing.
    """

    def __init__(self, *, pace: float = 0.0, beat: Callable[[], None] | None = None) -> None:
        require_pace(pace)
        self._pace = pace
        self._beat = beat
        self._now_s = 0.0

    def now_s(self) -> float:
        """Return the virtual seconds since the clock was made."""
        return self._now_s

    def wait(self, duration_s: float) -> None:
        """Jump that many virtual seconds ahead."""
        if not 0 <= duration_s < math.inf:
            raise ConfigError(f"a wait of {duration_s} s; it must be finite and not negative")
        if self._beat is not None:
            self._wait_with_beats(duration_s, self._beat)
            return
        self._now_s += duration_s
        # Without a pace no sleep at all: even one of 0 s gives the processor away.
        if self._pace > 0:
            time.sleep(duration_s * self._pace)  # noqa: TID251  only here and below does virtual time take real time

    def _wait_with_beats(self, duration_s: float, beat: Callable[[], None]) -> None:
        began_s = self._now_s
        if self._pace == 0:
            for number in range(max(1, math.ceil(duration_s / _SLICE_S))):
                self._now_s = began_s + number * _SLICE_S
                beat()
            self._now_s = began_s + duration_s
            return
        ends_s = time.monotonic() + duration_s * self._pace
        beat()
        while (left_s := ends_s - time.monotonic()) > 0:
            # A beat may end the wait by an exception: the time is then that of the moment.
            self._now_s = began_s + duration_s - left_s / self._pace
            time.sleep(min(left_s, _SLICE_S))  # noqa: TID251  as above
            beat()
        self._now_s = began_s + duration_s


@dataclass(frozen=True, slots=True, kw_only=True)
class Flash:
    """Light on the tissue: its time, number of pulses, and energy over the nominal energy."""

    at_s: float
    pulses: int
    energy: float
    angle_deg: float | None = None
    """True angle of the probe then, where it turns; None if it is at rest until its frame is read."""


def flash_of(rng: np.random.Generator, *, pulses: int, at_s: float, energy_jitter: float) -> Flash:
    """Return a flash with the mean energy of this number of pulses, each with its jitter."""
    # The mean of n independent pulses scatters by 1/sqrt(n) of one; a draw below 0 would be light of negative energy.
    energy = 1.0 + energy_jitter * rng.standard_normal() / np.sqrt(pulses)
    return Flash(at_s=at_s, pulses=pulses, energy=max(energy, 0.0))


def noise_gain(averaged: int | None, flash: Flash) -> float:
    """Return the noise of a frame of this flash over that of an average of so many pulses; 1 where None."""
    return 1.0 if averaged is None else math.sqrt(averaged / flash.pulses)


class SimulatedWorld(Protocol):
    """What simulated devices act on: they turn its probe, light it, and receive its sound."""

    angle_deg: float
    flashes: list[Flash]

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue."""

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> Frame:
        """Return the frame after a flash, or without one, with this header."""


class World:
    """Tissue under a probe.

    ``absorbers``: absorbers; none is a world without a marker. ``noise``: noise of one acquisition, after averaging, in
    counts, the unit of the channel data. ``energy_jitter``: standard deviation of a pulse's energy over its mean.
    ``averaged``: pulses over which that noise is averaged; None: it is the same for any number. ``motion``: how the
    tissue moves, its phase drawn. ``pulse_period_s``: time from pulse to pulse of one acquisition.
    """

    def __init__(
        self,
        *,
        model: AcousticModel,
        absorbers: Sequence[Absorber],
        noise: Noise,
        energy_jitter: float,
        start_deg: float,
        rng: np.random.Generator,
        averaged: int | None = None,
        motion: TissueMotion | None = None,
        pulse_period_s: float = 0.0,
    ) -> None:
        self.model = model
        self.motion = motion or TissueMotion()
        """How the tissue moves."""
        self.angle_deg = start_deg
        self.flashes: list[Flash] = []
        self._absorbers = tuple(absorbers)
        self._noise = noise
        self._energy_jitter = energy_jitter
        self._rng = rng
        self._averaged = averaged
        self._pulse_period_s = pulse_period_s

    def replace_absorbers(self, absorbers: Sequence[Absorber]) -> None:
        """Put other absorbers into the tissue: the spot of light has moved."""
        self._absorbers = tuple(absorbers)

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Light the tissue with the mean energy of this number of pulses, each with its jitter."""
        self.flashes.append(flash_of(self._rng, pulses=pulses, at_s=at_s, energy_jitter=self._energy_jitter))

    def is_lit(self, from_s: float, until_s: float) -> bool:
        """Return whether a pulse was fired after one time of the rig's clock, and until another."""
        for flash in reversed(self.flashes):
            last_s = flash.at_s + (flash.pulses - 1) * self._pulse_period_s
            if last_s <= from_s:
                return False
            pulses_s = flash.at_s + self._pulse_period_s * np.arange(flash.pulses)
            if ((pulses_s > from_s) & (pulses_s <= until_s)).any():
                return True
        return False

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ChannelFrame:
        """Return the frame of channel data after a flash; after none, noise alone."""
        return ChannelFrame(header=header, samples=self.counts(flash), sampling_hz=self.model.sampling_hz)

    def counts(self, flash: Flash | None) -> Int16[np.ndarray, "channels samples"]:
        """Return the averaged channel data in counts, shape (channels, samples), after a flash.

        After none, noise alone.

        The average is rounded and held at full scale once, as if one trigger with the average's noise had been taken.
        """
        model = self.model
        data = self._noise.sample(
            self._rng, channels=model.probe.array.elements, samples=model.samples, sampling_hz=model.sampling_hz
        )
        if flash is not None:
            data *= np.float32(noise_gain(self._averaged, flash))
            # In single precision: a NumPy double would make the product, of the size of a frame, a double one.
            data += np.float32(flash.energy) * self._lit(flash)
        return digitise(data)

    def _lit(self, flash: Flash) -> Float32[np.ndarray, "channels samples"]:
        """Return the channel data of the absorbers without noise, where the tissue is at the pulses of a flash."""
        if not self.motion.moves:
            return _without_noise(self.model, self._absorbers, self.angle_deg)
        moments = moments_s(self.motion, first_s=flash.at_s, pulses=flash.pulses, period_s=self._pulse_period_s)
        frames = [
            self.model.channel_data([displaced(each, by_m) for each in self._absorbers], angle_deg=self.angle_deg)
            for by_m in self.motion.displacement_m(moments)
        ]
        return np.asarray(np.mean(frames, axis=0, dtype=np.float32))


@lru_cache(maxsize=1)
def _without_noise(
    model: AcousticModel, absorbers: tuple[Absorber, ...], angle_deg: float
) -> Float32[np.ndarray, "channels samples"]:
    """Return the channel data of the absorbers.

    Cached, because studies search worlds in turn that differ in their noise alone.
    """
    data = model.channel_data(absorbers, angle_deg=angle_deg)
    # All callers share the cached array.
    data.flags.writeable = False
    return data
