"""The truth of a simulation: what sounds, where the probe really points, and what was really fired.

Devices of this package act on the world and report what they believe. Tests and the guard's campaigns look here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from markerseek.acoustics import Absorber, AcousticModel, Digitiser, Noise
from markerseek.core import ChannelFrame, Frame, FrameHeader
from markerseek.core.shapes import Float32, Int16


@dataclass(frozen=True, slots=True, kw_only=True)
class Flash:
    """Light that fell on the tissue: when, how many pulses, and how strong relative to the usual."""

    at_s: float
    pulses: int
    energy: float


def flash_of(rng: np.random.Generator, *, pulses: int, at_s: float, energy_jitter: float) -> Flash:
    """A flash of so many pulses, its energy their mean, each with its jitter."""
    energy = 1.0 + energy_jitter * rng.standard_normal() / np.sqrt(pulses)
    return Flash(at_s=at_s, pulses=pulses, energy=max(energy, 0.0))


class Surroundings(Protocol):
    """What simulated devices act on: they turn its probe, light it, and hear it."""

    angle_deg: float
    flashes: list[Flash]

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Let light fall on the tissue."""

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> Frame:
        """What is heard after a flash, or without one, under this header."""


class World:
    """Tissue under a probe.

    Parameters
    ----------
    model
        How absorbers are heard.
    absorbers
        What sounds under light; none is a world without a marker.
    noise
        Noise of one acquisition, after averaging, in the unit of the channel data.
    digitiser
        The converter.
    energy_jitter
        Standard deviation of a pulse's energy over its mean.
    start_deg
        Where the probe points at first, in degrees.
    rng
        Source of randomness.
    """

    def __init__(
        self,
        *,
        model: AcousticModel,
        absorbers: Sequence[Absorber],
        noise: Noise,
        digitiser: Digitiser,
        energy_jitter: float,
        start_deg: float,
        rng: np.random.Generator,
    ) -> None:
        self.model = model
        self.angle_deg = start_deg
        self.flashes: list[Flash] = []
        self._absorbers = tuple(absorbers)
        self._noise = noise
        self._digitiser = digitiser
        self._energy_jitter = energy_jitter
        self._rng = rng

    def flash(self, *, pulses: int, at_s: float) -> None:
        """Let light fall on the tissue: the mean energy of so many pulses, each with its jitter."""
        self.flashes.append(flash_of(self._rng, pulses=pulses, at_s=at_s, energy_jitter=self._energy_jitter))

    def frame(self, flash: Flash | None, *, header: FrameHeader) -> ChannelFrame:
        """Frame of channel data after a flash; after none, noise alone."""
        return ChannelFrame(header=header, samples=self.listen(flash), sampling_hz=self.model.sampling_hz)

    def listen(self, flash: Flash | None) -> Int16[np.ndarray, "channels samples"]:
        """Averaged channel data in counts, shape (channels, samples), after a flash; after none, noise alone.

        The average is rounded and held at full scale once, as if one trigger with the average's noise had been taken.
        """
        model = self.model
        heard = self._noise.sample(
            self._rng, channels=model.probe.array.elements, samples=model.samples, sampling_hz=model.sampling_hz
        )
        if flash is not None:
            heard += np.float32(flash.energy) * _without_noise(model, self._absorbers, self.angle_deg)
        return self._digitiser.digitise(heard)


@lru_cache(maxsize=1)
def _without_noise(
    model: AcousticModel, absorbers: tuple[Absorber, ...], angle_deg: float
) -> Float32[np.ndarray, "channels samples"]:
    """Channel data of the absorbers; kept, since worlds that differ in their noise alone are heard in turn."""
    heard = model.channel_data(absorbers, angle_deg=angle_deg)
    heard.flags.writeable = False
    return heard
