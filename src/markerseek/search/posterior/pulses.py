"""Pulses of sweeps before they count: pulses without light are left out, and the delay that two ways show is removed.

The angle of a pulse is the stage's when it was stamped. If the light comes later by a
delay d, the probe has turned on by v·d at the speed v. So a curve that is swept there and back has two centres,

    c_down − c_up = (|v_up| + |v_down|)·d.                                                                     (11)

Whatever shifts all angles of a sweep alike (stamps, answers of the stage, frames that are late by one) is such a delay.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from markerseek.core import Float64, Sample
from markerseek.search.floor import noise_factor
from markerseek.search.posterior.likelihood import Observation

LIT_RATIO = 1.3
"""A pulse at the noise had no light if the pulses before and after exceed the largest noise by this factor."""

NOISE_SHARE = 0.01
"""Probability with which noise alone has a larger peak in one frame than a pulse without light."""

UNEXPLAINED_SIGMAS = 3.0
"""Largest difference of the two ways, in standard deviations of the delay that the rig states."""

DOUBTFUL_SIGMAS = 2.0
"""Difference of the two ways, in the same standard deviations, from which a burst is swept again.

A trigger that is lost before one way and doubled before the other looks like a delay of half a period, but not in the
next burst.
"""

LEAST_FLANK = 0.5
"""Distance from the centre up to which both flanks must be swept, over the full width at half maximum."""


def with_light(samples: Sequence[Sample]) -> list[Sample]:
    """Return the samples without the pulses of sweeps that gave no light.

    Such a pulse is no higher than noise, and the pulses before and after it in its sweep are clear of the noise.
    """
    kept: list[Sample] = []
    for sweep, group in groupby(samples, key=lambda sample: None if sample.sweep is None else sample.sweep.number):
        own = list(group)
        kept += own if sweep is None else _lit(own)
    return kept


def _lit(swept: Sequence[Sample]) -> list[Sample]:
    """The pulses of one sweep that gave light."""
    level = np.array([_noise_level(sample) for sample in swept])
    height = np.array([sample.reading.intensity for sample in swept])
    quiet, clear = height <= level, height >= LIT_RATIO * level
    dark = np.zeros(len(swept), dtype=bool)
    dark[1:-1] = quiet[1:-1] & clear[:-2] & clear[2:]
    return [sample for sample, off in zip(swept, dark, strict=True) if not off]


def _noise_level(sample: Sample) -> float:
    """Height that noise seldom exceeds; 0 where the noise is not known."""
    reading = sample.reading
    if reading.noise_sigma is None or reading.cells is None:
        return 0.0
    return reading.noise_sigma * noise_factor(cells=reading.cells, frames=1, false_found=NOISE_SHARE)


def later(samples: Sequence[Sample], delay_s: float) -> list[Sample]:
    """Return the samples with the angles at which the light comes if it is later by this delay."""
    return [
        sample
        if sample.sweep is None
        else replace(sample, angle_deg=sample.angle_deg + sample.sweep.speed_deg_s * delay_s)
        for sample in samples
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """The centre of the curve by the pulses of one direction, and its standard deviation, in degrees."""

    centre_deg: float
    sigma_deg: float
    speed_deg_s: float
    """Mean speed, positive."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """Delay beyond the one that the rig states, by the difference of the two ways, in seconds."""

    measured_s: float
    sigma_s: float
    """Standard deviation of the measurement."""
    prior_s: float
    """Standard deviation of what the rig states."""

    @property
    def mean_s(self) -> float:
        """Mean of the delay, by measurement and prior together."""
        return self.measured_s * self.prior_s**2 / (self.prior_s**2 + self.sigma_s**2)

    @property
    def unexplained(self) -> bool:
        """Whether no delay of such a rig explains the difference."""
        return abs(self.measured_s) > UNEXPLAINED_SIGMAS * math.hypot(self.prior_s, self.sigma_s)

    @property
    def doubtful(self) -> bool:
        """Whether it is a delay that few rigs have."""
        return abs(self.measured_s) > DOUBTFUL_SIGMAS * self.prior_s

    def differs_from(self, other: Delay) -> bool:
        """Whether two bursts of one rig show different delays."""
        return abs(self.measured_s - other.measured_s) > UNEXPLAINED_SIGMAS * math.hypot(self.sigma_s, other.sigma_s)


Centre = tuple[float, float, float]
"""Centre of a curve, its standard deviation, and its full width at half maximum, in degrees."""


def delay_of(samples: Sequence[Sample], centre_of: Callable[[Sequence[Sample]], Centre | None]) -> Delay | None:
    """Return the delay by (11); None unless both flanks were swept both ways.

    ``samples``: all samples with light. ``centre_of``: fits a curve to samples; None if they show no curve.
    """
    swept = [(sample, sample.sweep) for sample in samples if sample.sweep is not None]
    ways = [way_of([sample for sample, sweep in swept if sign * sweep.speed_deg_s > 0], centre_of) for sign in (1, -1)]
    if None in ways:
        return None
    up, down = (way for way in ways if way is not None)
    speed = up.speed_deg_s + down.speed_deg_s
    backlash_deg = max(sweep.play_sigma_deg for _, sweep in swept)
    return Delay(
        measured_s=(down.centre_deg - up.centre_deg) / speed,
        sigma_s=math.hypot(up.sigma_deg, down.sigma_deg, backlash_deg) / speed,
        prior_s=max(sweep.delay_sigma_s for _, sweep in swept),
    )


def way_of(samples: Sequence[Sample], centre_of: Callable[[Sequence[Sample]], Centre | None]) -> Way | None:
    """Return the centre by the pulses of one direction; None unless both flanks are among them.

    ``samples``: samples of sweeps in one direction. ``centre_of``: see `delay_of`.
    """
    # Without the errors that they share with the other direction: these are what the comparison shows.
    alone = [
        (sample, replace(sample.sweep, delay_sigma_s=0.0, play_sigma_deg=0.0))
        for sample in samples
        if sample.sweep is not None
    ]
    centre = centre_of([replace(sample, sweep=sweep) for sample, sweep in alone]) if alone else None
    if centre is None:
        return None
    mean_deg, sigma_deg, fwhm_deg = centre
    angles_deg = [sample.angle_deg for sample, _ in alone]
    if not min(angles_deg) + LEAST_FLANK * fwhm_deg <= mean_deg <= max(angles_deg) - LEAST_FLANK * fwhm_deg:
        return None
    near = [sweep for sample, sweep in alone if abs(sample.angle_deg - mean_deg) <= fwhm_deg] or [alone[0][1]]
    speed = float(np.mean([abs(sweep.speed_deg_s) for sweep in near]))
    return Way(centre_deg=mean_deg, sigma_deg=sigma_deg, speed_deg_s=speed)


def delay_sigma_deg(observations: Sequence[Observation]) -> float:
    """By how much the delay of sweeps may shift the angle: ways there and back shift it against one another."""
    swept = [(each.noise**-2, each.sweep) for each in observations if each.sweep is not None]
    if not swept:
        return 0.0
    shift_deg = sum(weight * sweep.speed_deg_s * sweep.delay_sigma_s for weight, sweep in swept)
    return abs(shift_deg) / sum(weight for weight, _ in swept)


def blurred(
    angles_deg: Float64[np.ndarray, " angles"], probability: Float64[np.ndarray, " angles"], *, sigma_deg: float
) -> tuple[Float64[np.ndarray, " wider"], Float64[np.ndarray, " wider"]]:
    """Angles and probabilities after a normal error of this standard deviation was added."""
    step_deg = float(angles_deg[1] - angles_deg[0])
    reach = math.ceil(4 * sigma_deg / step_deg)
    if reach < 2:
        return angles_deg, probability
    kernel = np.exp(-0.5 * (step_deg * np.arange(-reach, reach + 1) / sigma_deg) ** 2)
    wider_deg = angles_deg[0] + step_deg * np.arange(-reach, angles_deg.size + reach)
    return wider_deg, np.convolve(probability, kernel / kernel.sum())
