"""Triggered acquisitions of emulated receivers: what a simulated world gives for each trigger."""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import ChannelFrame, ConfigError, FrameHeader, Int16
from markerseek.sim import Flash, SimulatedWorld

_SPREAD_COUNTS = 8
"""Most counts by which a single pulse differs from the average."""

# 12-bit converter, signed.
_FULL_SCALE = 2047


@dataclass(frozen=True, slots=True, kw_only=True)
class Train:
    """A train of triggers: a copy of the world, and the light that came with the first of them."""

    world: SimulatedWorld
    flash: Flash | None
    triggers: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptTrain:
    """The triggers of a sweep: a copy of the world, the light that came with the first of them, each at its angle."""

    world: SimulatedWorld
    flashes: tuple[Flash, ...]
    triggers: int


class Trains:
    """Trains of triggers in a simulated world, and the pulses that each gives.

    ``world``: world whose sound is recorded; it must simulate frames. ``rng``: source of randomness for the differences
    between pulses.
    """

    def __init__(self, *, world: SimulatedWorld, rng: np.random.Generator) -> None:
        self._world, self._rng = world, rng
        self._flashes = len(world.flashes)

    def begin(self, count: int) -> Train | SweptTrain:
        """A train of triggers at the present angle of the probe, or at those of the flashes of a sweep.

        Where there were fewer pulses of light than triggers, as in a train cut short, the light came with the first.
        """
        new = self._world.flashes[self._flashes :]
        self._flashes = len(self._world.flashes)
        if new and new[0].angle_deg is not None:
            return SweptTrain(world=copy(self._world), flashes=tuple(new), triggers=count)
        # A shallow copy keeps its angle while the world's probe is turned further.
        return Train(world=copy(self._world), flash=new[-1] if new else None, triggers=count)

    def trial(self) -> Train:
        """One trigger with light in a copy of the world, whose random numbers do not change."""
        return Train(world=deepcopy(self._world), flash=Flash(at_s=0.0, pulses=1, energy=1.0), triggers=1)

    def pulses(self, train: Train | SweptTrain) -> Int16[np.ndarray, "pulses channels samples"]:
        """Channel data of each trigger; pairs differ by opposite amounts, so that their average stays exact."""
        if isinstance(train, SweptTrain):
            return self._singles(train)
        averaged, count = self.average(train), train.triggers
        pulses = np.repeat(averaged[np.newaxis], count, axis=0)
        for pair in range(count // 2):
            apart = self._rng.integers(-_SPREAD_COUNTS, _SPREAD_COUNTS + 1, averaged.shape, dtype=np.int16)
            # Near full scale no difference: a clipped pulse would change the average.
            apart[np.abs(averaged) > _FULL_SCALE - _SPREAD_COUNTS] = 0
            pulses[2 * pair] += apart
            pulses[2 * pair + 1] -= apart
        return pulses

    @staticmethod
    def _singles(train: SweptTrain) -> Int16[np.ndarray, "pulses channels samples"]:
        """Channel data of each trigger of a sweep, with the probe where it was, and the noise of a single pulse."""
        dark = Flash(at_s=train.flashes[-1].at_s, pulses=1, energy=0.0, angle_deg=train.world.angle_deg)
        pulses = []
        for flash in train.flashes + (dark,) * (train.triggers - len(train.flashes)):
            train.world.angle_deg = train.world.angle_deg if flash.angle_deg is None else flash.angle_deg
            pulses.append(_samples(train.world, flash, pulses=1))
        return np.stack(pulses)

    @staticmethod
    def average(train: Train) -> Int16[np.ndarray, "channels samples"]:
        """Average frame of a train."""
        flash = train.flash
        if flash is not None and flash.pulses < train.triggers:
            flash = replace(flash, energy=flash.energy * flash.pulses / train.triggers)
        return _samples(train.world, flash, pulses=train.triggers)


def _samples(world: SimulatedWorld, flash: Flash | None, *, pulses: int) -> Int16[np.ndarray, "channels samples"]:
    # Only the samples are used; the driver makes the header that the guard checks.
    header = FrameHeader(sequence=0, token="", pulses=pulses, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
    frame = world.frame(flash, header=header)
    if not isinstance(frame, ChannelFrame):
        raise ConfigError("receiver: this world gives intensities only; emulate a world of frames")
    return frame.samples
