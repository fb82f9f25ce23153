"""Whether samples are as strong as the posterior predicts: of a confirmation, and of the curve as a whole.

The prediction of a sample is that of the markers drawn from the posterior, ln A + ln S(t). The spread of the prediction
is theirs, the error of the curve (`symmetry.TEMPLATE_SIGMAS`), the laser's, and noise, added as squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from markerseek.core import Float64, Interval, Sample
from markerseek.search.floor import MAX_CELLS
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.likelihood import FAR_TAIL, FAR_TAIL_ERROR, displaced_sigma_deg, radius_m
from markerseek.search.posterior.rivals import top_beside_deg
from markerseek.search.posterior.sources import RIVAL_DB, Candidate, samples_at
from markerseek.search.posterior.symmetry import TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS

PREDICTION_SIGMAS = 3.0
"""Standard deviations of the prediction by which a confirmation may be weaker."""

MISFIT_SIGMAS = 2.5
USUAL_SAMPLES = 12
"""Standard deviations of the prediction beyond which the curve does not explain the worst of so many samples, as a
search at rest has: of more samples one is farther by chance."""

TAIL_SHARE = 0.5
"""Share of the highest prediction below which a curve may have nulls."""

LASER_ERROR = 0.04
"""Relative error of a sample by itself, the laser's energy; of a single pulse of a sweep what the samples show."""


def height_of(sample: Sample, posterior: AnglePosterior) -> float:
    """Return the height of a sample on the curve of a source: of a strong one by its energy, else its intensity."""
    spot = sample.reading.spot
    if spot is None or posterior.energy_gain is None:
        return sample.reading.intensity
    return posterior.energy_gain * spot.amplitude


def weaker_than_predicted(source: Candidate, confirmation: Sample) -> str | None:
    """Return why an acquisition at the angle of a source does not confirm it, with both numbers; None if it does.

    ``source``: the source, with its posterior before that acquisition.
    """
    here = confirmation
    if source.source is not None:
        own, bounds = samples_at([confirmation], [source.source], source.source)
        (here,) = own or bounds
    height, spread = _prediction(source.posterior, [here])
    measured = height_of(here, source.posterior)
    if measured >= height[0] - PREDICTION_SIGMAS * spread[0]:
        return None
    return (
        f"the acquisition at the angle found has an intensity of {measured:.4g}, {height[0]:.4g} ± "
        f"{spread[0]:.2g} was predicted; search again, and check laser, receiver and probe"
    )


def predictive_check(source: Candidate, measured_deg: Sequence[float], *, limits: Interval) -> str | None:
    """Return why the curve of a source does not explain its samples, in words; None if the curve does.

    ``measured_deg``: angles measured so far, in degrees.
    """
    height, spread = _prediction(source.posterior, source.samples)
    measured = np.array([height_of(sample, source.posterior) for sample in source.samples])
    away = np.abs(measured - height) / spread
    # The family has no nulls, but the tails of a real curve do: a dip there is no second peak.
    away[(measured < height) & (height < TAIL_SHARE * height.max())] = 0.0
    # The worst of many is farther off than that of a few, also where the curve is right; more so of single pulses.
    swept = sum(sample.sweep is not None for sample in source.samples)
    many = max(1.0, away.size / USUAL_SAMPLES) * max(1.0, swept / USUAL_SAMPLES)
    allowed = -float(ndtri(ndtr(-MISFIT_SIGMAS) / many))
    # What another source adds to the curve there, at most.
    weak = measured - height < height.max() * 10 ** (-RIVAL_DB / 20)
    for k in map(int, np.argsort(-away)):
        if away[k] <= allowed:
            return None
        sample = source.samples[k]
        # If a second source as strong has no room beside a sample, the sample may be weaker, because a dip would show,
        # or stronger by what a weak source adds.
        if not weak[k] or top_beside_deg(source, source, [sample], measured_deg, limits=limits) is not None:
            return (
                f"one curve does not explain the sample at {sample.angle_deg:.2f} deg: its intensity is "
                f"{measured[k]:.4g}, {height[k]:.4g} ± {spread[k]:.2g} was predicted; there may be two sources"
            )
    return None


def _prediction(
    posterior: AnglePosterior, samples: Sequence[Sample]
) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Return the intensity that a posterior predicts of samples, and its standard deviation."""
    log_height = posterior.log_heights(np.array([sample.angle_deg for sample in samples]))
    mean = log_height.mean(axis=0)
    fallen = float(np.mean(posterior.log_snr)) - mean
    error = np.interp(fallen, -TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS)
    signal = np.exp(np.minimum(mean, 50.0))
    # A weak sample is as high as noise is by itself.
    noise = np.array([math.sqrt(2 * math.log(max(2, sample.reading.cells or MAX_CELLS))) for sample in samples])
    height = np.hypot(signal, noise)
    laser = np.array([LASER_ERROR if sample.sweep is None else posterior.sample_error for sample in samples])
    # As in the likelihood: the form of deep tails is known that well at best.
    deep = np.where(fallen > -math.log(FAR_TAIL), FAR_TAIL_ERROR * math.exp(float(np.mean(posterior.log_snr))), 0.0)
    moved = _moved(posterior, samples, mean=mean)
    own = (signal * log_height.std(axis=0)) ** 2 + (error**2 + laser**2 + moved**2) * height**2
    spread = np.sqrt(own + np.maximum(deep, 1.0) ** 2)
    return posterior.sigma * height, posterior.sigma * spread


def _moved(
    posterior: AnglePosterior, samples: Sequence[Sample], *, mean: Float64[np.ndarray, " samples"]
) -> Float64[np.ndarray, " samples"]:
    """Return the standard deviation of ln of the prediction by the motion of the marker."""
    strongest = max(samples, key=lambda sample: sample.reading.intensity)
    from_axis_m = radius_m(strongest.reading.depth_m)
    left_deg = np.array([displaced_sigma_deg(sample, radius_m=from_axis_m) for sample in samples])
    sigma_deg = np.hypot(posterior.moved_sigma_deg, left_deg)
    if not sigma_deg.any():
        return np.zeros(len(samples))
    angles_deg = np.array([sample.angle_deg for sample in samples])
    sides = [posterior.log_heights(angles_deg + side * sigma_deg).mean(axis=0) for side in (-1, 1)]
    # To second order: beside the top the curve falls to both sides.
    return np.asarray(np.maximum(np.abs(sides[1] - sides[0]) / 2, np.abs(np.mean(sides, axis=0) - mean)))
