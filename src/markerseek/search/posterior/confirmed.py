"""Whether the acquisition at the angle found is as strong as the posterior predicts."""

from __future__ import annotations

import math

import numpy as np

from markerseek.core import Sample
from markerseek.search.posterior.candidates import Candidate
from markerseek.search.posterior.shapes import STEP_DEG, Shapes
from markerseek.search.posterior.sources import samples_at

PREDICTION_SIGMAS = 3.0
"""Standard deviations of the prediction by which a confirmation may be weaker."""

PREDICTION_ERROR = 0.06
"""Relative error of the prediction besides what the posterior and the noise say: the curve's top, and the laser."""


def unconfirmed(source: Candidate, confirmation: Sample, shapes: Shapes) -> str | None:
    """Return why an acquisition at the angle of a source does not confirm it, with both numbers; None if it does.

    Parameters
    ----------
    source
        The source, with its posterior before that acquisition.
    confirmation
        The acquisition.
    shapes
        Family of curves.
    """
    posterior = source.posterior
    here = confirmation
    if source.source is not None:
        here = next(iter(samples_at([confirmation], [source.source], source.source)), confirmation)
    steps = np.rint(np.abs(here.angle_deg - posterior.theta_deg) / STEP_DEG).astype(np.int64)
    height = posterior.log_snr + shapes.log_curve[posterior.member, np.minimum(steps, shapes.log_curve.shape[1] - 1)]
    predicted = posterior.sigma * math.exp(min(float(height.mean()), 50.0))
    spread = predicted * math.hypot(float(height.std()), PREDICTION_ERROR, posterior.sigma / predicted)
    if here.reading.intensity >= predicted - PREDICTION_SIGMAS * spread:
        return None
    return (
        f"the acquisition at the angle found has an intensity of {here.reading.intensity:.4g}, {predicted:.4g} ± "
        f"{spread:.2g} was predicted; search again, and check laser, receiver and probe"
    )
