"""Triggered acquisitions of emulated receivers: what a simulated world gives for each trigger."""

from __future__ import annotations

from copy import copy, deepcopy
from dataclasses import dataclass, replace

import numpy as np

from markerseek.core import ChannelFrame, ConfigError, FrameHeader, Int16
from markerseek.sim import Flash, SimulatedWorld


@dataclass(frozen=True, slots=True, kw_only=True)
class Train:
    """A train of triggers: a copy of the world, and the light that came with the first of them."""

    world: SimulatedWorld
    flashes: tuple[Flash, ...]
    """One for all pulses, or one for each pulse of a sweep, with its angle."""
    triggers: int

    @property
    def swept(self) -> bool:
        """Whether the triggers are those of a sweep."""
        return bool(self.flashes) and self.flashes[0].angle_deg is not None


class Trains:
    """Trains of triggers in a simulated world, which must simulate frames, and the pulses that each gives."""

    def __init__(self, world: SimulatedWorld) -> None:
        self._world = world
        self._flashes = len(world.flashes)

    def begin(self, count: int) -> Train:
        """A train of triggers at the present angle of the probe, or at those of the flashes of a sweep."""
        new = self._world.flashes[self._flashes :]
        self._flashes = len(self._world.flashes)
        # A shallow copy keeps its angle while the world's probe is turned further.
        return Train(world=copy(self._world), flashes=tuple(new), triggers=count)

    def trial(self) -> Train:
        """One trigger with light in a copy of the world, whose random numbers do not change."""
        return Train(world=deepcopy(self._world), flashes=(Flash(at_s=0.0, pulses=1, energy=1.0),), triggers=1)

    def pulses(self, train: Train) -> Int16[np.ndarray, "pulses channels samples"]:
        """Channel data of each trigger: of a sweep with the noise of a single pulse, else their average each time."""
        return self._singles(train) if train.swept else np.stack([self.average(train)] * train.triggers)

    @staticmethod
    def _singles(train: Train) -> Int16[np.ndarray, "pulses channels samples"]:
        """Channel data of each trigger of a sweep, with the probe where it was."""
        dark = Flash(at_s=train.flashes[-1].at_s, pulses=1, energy=0.0, angle_deg=train.world.angle_deg)
        pulses = []
        for flash in train.flashes + (dark,) * (train.triggers - len(train.flashes)):
            train.world.angle_deg = train.world.angle_deg if flash.angle_deg is None else flash.angle_deg
            pulses.append(_samples(train.world, flash, pulses=1))
        return np.stack(pulses)

    @staticmethod
    def average(train: Train) -> Int16[np.ndarray, "channels samples"]:
        """Average frame of a train; where it was cut short, the light came with the first triggers."""
        flash = train.flashes[-1] if train.flashes else None
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
