"""The prior that a former marker on the same rig gives: curves of about its width, and amplitudes of about its height.

Element, lens, laser pulse and face radius are the rig's, and shape the curve of each marker alike; its depth and size
are its own. So the width is normal in its logarithm about that of the former marker, and so is the amplitude. A tenth
of the prior stays as it is, for a marker that has nothing in common with the former one.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from markerseek.core import MarkerCurve
from markerseek.search.posterior.shapes import Shapes

LOG_WIDTH_SIGMA, LOG_PEAK_SIGMA = 0.25, 0.5
"""Standard deviations of ln F and ln A between two markers on one rig."""

UNLIKE_SHARE = 0.1
"""Prior probability of a marker whose width has nothing in common with that of the former."""


def shapes_with(shapes: Shapes, prior: MarkerCurve) -> Shapes:
    """Return the family of curves with the prior that a former marker gives.

    ``shapes``: the family, with its usual prior.
    """
    usual = np.exp(shapes.log_prior)
    alike = usual * np.exp(-((np.log(shapes.fwhm_deg / prior.fwhm_deg) / LOG_WIDTH_SIGMA) ** 2) / 2)
    share = (1 - UNLIKE_SHARE) * alike / alike.sum() + UNLIKE_SHARE * usual / usual.sum()
    return replace(shapes, log_prior=np.log(share))


def log_amplitude_prior(prior: MarkerCurve, *, unit: float) -> tuple[float, float]:
    """Return mean and standard deviation of ln A over a unit of intensity."""
    return math.log(prior.peak / unit), LOG_PEAK_SIGMA
