"""The posterior predictive check: whether samples are as strong as the posterior of their source predicts.

The intensity that is predicted at an angle is that of the markers drawn from the posterior, ln A + ln S(t); its spread
is theirs, the error of the curve (`symmetry.TEMPLATE_SIGMAS`), the laser's, and noise, added as squares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import ndtr, ndtri

from markerseek.core import Float64, Sample
from markerseek.search.floor import MAX_CELLS
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.candidates import RIVAL_DB, Candidate
from markerseek.search.posterior.likelihood import DEEP, DEEP_ERROR
from markerseek.search.posterior.shapes import STEP_DEG, Shapes
from markerseek.search.posterior.sources import samples_at
from markerseek.search.posterior.symmetry import TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS

PREDICTION_SIGMAS = 3.0
"""Standard deviations of the prediction by which a confirmation may be weaker."""

DOUBT_SIGMAS, MISFIT_SIGMAS = 2.0, 2.5
"""Standard deviations of the prediction beyond which a sample makes the curve doubtful, and is not explained by it,
where the worst of `USUAL_SAMPLES` is taken."""

TAIL_SHARE = 0.5
"""Share of the highest prediction below which a curve may have nulls."""

LASER_ERROR = 0.04
"""Relative error of a sample by itself, the laser's energy; of a single pulse of a sweep what the samples show."""

USUAL_SAMPLES = 12
"""Samples of a search at rest: of more than these one is farther from the prediction by chance."""


def predicted(
    posterior: AnglePosterior, shapes: Shapes, angles_deg: Float64[np.ndarray, " angles"]
) -> Float64[np.ndarray, "particles angles"]:
    """Return ln of the intensity over σ that each marker drawn from a posterior has at angles of the probe."""
    steps = np.rint(np.abs(angles_deg - posterior.theta_deg[:, None]) / STEP_DEG).astype(np.int64)
    away = np.minimum(steps, shapes.log_curve.shape[1] - 1)
    return np.asarray(posterior.log_snr[:, None] + shapes.log_curve[posterior.member[:, None], away])


def height_of(sample: Sample, posterior: AnglePosterior) -> float:
    """Return the height of a sample on the curve of a source: of a strong one by its energy, else its intensity."""
    spot = sample.reading.spot
    if spot is None or posterior.energy_gain is None:
        return sample.reading.intensity
    return posterior.energy_gain * spot.amplitude


def weaker_than_predicted(source: Candidate, confirmation: Sample, shapes: Shapes) -> str | None:
    """Return why an acquisition at the angle of a source does not confirm it, with both numbers; None if it does.

    ``source``: the source, with its posterior before that acquisition.
    """
    here = confirmation
    if source.source is not None:
        own, bounds = samples_at([confirmation], [source.source], source.source)
        (here,) = own or bounds
    height, spread = _prediction(source.posterior, shapes, [here])
    measured = height_of(here, source.posterior)
    if measured >= height[0] - PREDICTION_SIGMAS * spread[0]:
        return None
    return (
        f"the acquisition at the angle found has an intensity of {measured:.4g}, {height[0]:.4g} ± "
        f"{spread[0]:.2g} was predicted; search again, and check laser, receiver and probe"
    )


def _open(_sample: Sample) -> bool:
    return False


def discrepant_sample(
    source: Candidate, shapes: Shapes, *, sigmas: float, closed: Callable[[Sample], bool] = _open
) -> Sample | None:
    """Return the sample that fits the curve of a source worst; None if the curve explains all samples.

    ``sigmas``: standard deviations of the prediction that are allowed. ``closed``: whether a second source as loud
    has no room beside a sample: then it may be weaker, for a dip would show, or stronger by what a weak one adds.
    """
    height, spread = _prediction(source.posterior, shapes, source.samples)
    measured = np.array([height_of(sample, source.posterior) for sample in source.samples])
    away = np.abs(measured - height) / spread
    # The family has no nulls, but the tails of a real curve do: what is missing there is no second hump.
    away[(measured < height) & (height < TAIL_SHARE * height.max())] = 0.0
    swept = sum(sample.sweep is not None for sample in source.samples)
    # Of the many samples of a sweep some are farther by chance: all together no more often than of so many at rest.
    allowed = float(ndtri(1 - (1 - ndtr(sigmas)) * min(1.0, USUAL_SAMPLES / max(swept, 1))))
    # What another source adds to the curve there, at most.
    weak = measured - height < height.max() * 10 ** (-RIVAL_DB / 20)
    for k in map(int, np.argsort(-away)):
        if away[k] <= allowed:
            break
        if not (weak[k] and closed(source.samples[k])):
            return source.samples[k]
    return None


def predictive_check(source: Candidate, shapes: Shapes, *, closed: Callable[[Sample], bool] = _open) -> str | None:
    """Return why the curve of a source does not explain its samples, in words; None if it does.

    ``closed``: as in `discrepant_sample`.
    """
    # The worst of many is farther off than that of a few, also where the curve is right.
    tail = ndtr(-MISFIT_SIGMAS) * USUAL_SAMPLES / max(USUAL_SAMPLES, len(source.samples))
    sample = discrepant_sample(source, shapes, sigmas=-float(ndtri(tail)), closed=closed)
    if sample is None:
        return None
    height, spread = _prediction(source.posterior, shapes, [sample])
    measured = height_of(sample, source.posterior)
    return (
        f"one curve does not explain the sample at {sample.angle_deg:.2f} deg: its intensity is {measured:.4g}, "
        f"{height[0]:.4g} ± {spread[0]:.2g} was predicted; there may be two sources"
    )


def _prediction(
    posterior: AnglePosterior, shapes: Shapes, samples: Sequence[Sample]
) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Intensity that a posterior predicts of samples, and its standard deviation."""
    log_height = predicted(posterior, shapes, np.array([sample.angle_deg for sample in samples]))
    mean = log_height.mean(axis=0)
    fallen = float(np.mean(posterior.log_snr)) - mean
    error = np.interp(fallen, -TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS)
    signal = np.exp(np.minimum(mean, 50.0))
    # A weak sample is as high as noise is by itself.
    noise = np.array([math.sqrt(2 * math.log(max(2, sample.reading.cells or MAX_CELLS))) for sample in samples])
    height = np.hypot(signal, noise)
    laser = np.array([LASER_ERROR if sample.sweep is None else posterior.sample_error for sample in samples])
    # As in the likelihood: the form of deep tails is known that well at best.
    deep = np.where(fallen > -math.log(DEEP), DEEP_ERROR * math.exp(float(np.mean(posterior.log_snr))), 0.0)
    own = (signal * log_height.std(axis=0)) ** 2 + (error**2 + laser**2) * height**2
    spread = np.sqrt(own + np.maximum(deep, 1.0) ** 2)
    return posterior.sigma * height, posterior.sigma * spread
