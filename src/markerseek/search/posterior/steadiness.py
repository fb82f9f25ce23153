"""How steady the laser is from one acquisition to the next, as the rig measures it or as a curve's samples show it."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence

from markerseek.core import Interval, Sample
from markerseek.search.floor import noise_of
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.loading import loaded_family

MIN_SAMPLES = 6
"""Samples of the marker from which its curve, which is not known either, shows how they differ."""


def energy_spread(lit: Sequence[Sample], dark: Sequence[Sample] = (), *, limits: Interval) -> float | None:
    """Return the relative standard deviation of an acquisition's energy; None where too few samples show it.

    ``lit``, ``dark``: samples of one marker, with the laser on and off.
    """
    energies = [sample.frame.header.energy for sample in lit if sample.frame is not None]
    measured = [math.log(energy) for energy in energies if energy is not None]
    if len(measured) >= MIN_SAMPLES:
        return statistics.stdev(measured)
    noise = noise_of(lit, dark=dark)
    level = math.inf if noise.floor.level is None else noise.floor.level
    if sum(sample.reading.intensity > level for sample in lit) < MIN_SAMPLES:
        return None
    inference = Inference(limits=limits, shapes=loaded_family(), cues=frozenset({"intensity"}))
    return inference.posterior(lit, noise, particles=8).sample_error
