"""What may still hide: where in the range a source as loud as the one answered would have been detected.

A source at θ with the amplitude A and the curve S of the one answered stays undetected if no sample i,
taken at θ_i, exceeds the level L_i that noise reaches there, or that other sources did:

    h(θ) = mean over A, S of ∏_i Φ((L_i − A·S(θ_i − θ))/s_i),       s_i² = σ² + (εA·S)².                      (13)

The share of the range that has been surveyed is the mean of 1 − h over it. Amplitude and curve are those of markers
drawn from the posterior, so that both are as uncertain as the samples leave them; every second curve is narrower,
because that of a smaller source or of one at another depth may be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from markerseek.core import Float64, Interval, Sample
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.candidates import BESIDE_DEG, Candidate
from markerseek.search.posterior.predictive import predicted
from markerseek.search.posterior.shapes import STEP_DEG, WIDTHS_DEG, Shapes

SURVEYED = 0.99
"""Share of the range that must have been surveyed before a source is the marker."""

SURVEY_TARGET = 0.993
"""Share at which a search ends; more than `SURVEYED`, because one more sample changes the amplitude by a little."""

NARROWER_STEPS, NARROW_WIDTH = 5, 7
"""Steps of `WIDTHS_DEG` by which the curve of every second hidden source is narrower, to 0.6 of its width; and the
number of the width, 4 degrees, that it does not exceed: a small source beside a large one is that narrow. Intensities
alone do not show it beside the large one's flank, and the search would hardly end; there it may exceed that width."""

SURVEY_ANGLES = 71
"""Angles at which a hidden source is assumed, evenly spread over the range; every second may be the next sample's."""

SURVEY_PARTICLES = 12
"""Markers of the posterior whose amplitude and curve it is given."""

MODEL_ERROR = 0.2
"""Relative error ε of the curve in its tails, where a source is detected or not (`shapes.MODEL_ERROR`)."""

SURVEY_TRAVEL_DEG = 150.0
"""Travel that must double what a sample adds to the survey to be worth it, in degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """How much of the range has been surveyed.

    Attributes
    ----------
    share
        Share of the range in which a source as loud would have been detected.
    hidden_deg
        Angle at which it would most probably not have been, in degrees.
    next_deg
        Angle whose sample adds most, travel weighed in, in degrees.
    """

    share: float
    hidden_deg: float
    next_deg: float


def survey_of(
    source: Candidate, shapes: Shapes, lit: Sequence[Sample], noise: SearchNoise, *, limits: Interval
) -> Survey:
    """Return the survey of a range for sources as loud as one (13).

    Parameters
    ----------
    source
        The source that is answered.
    shapes
        Family of curves.
    lit
        All samples with the laser on.
    noise
        Noise of the search.
    limits
        Range of the search.
    """
    posterior, largest = source.posterior, [sample.reading.intensity for sample in lit]
    level = noise.floor.level or min(largest)
    angles_deg = np.linspace(limits.low_deg, limits.high_deg, SURVEY_ANGLES)
    measured_deg = np.array([sample.angle_deg for sample in lit])
    # Where a frame lists no arrivals, another source shows only if it is louder than what was measured.
    listed = np.array([sample.reading.local_maxima is not None for sample in lit])
    placed = bool(listed.all())
    needed = np.where(listed, level, np.maximum(level, largest)) / posterior.sigma
    hidden = undetected(posterior, shapes, measured_deg, needed, angles_deg, placed=placed).prod(axis=1)
    if not placed:
        # Beside the source itself it shows in the form of the curve only, which is tested for two humps.
        hidden[:, np.abs(angles_deg - posterior.mean_deg) <= posterior.fwhm_deg / 2] = 0.0
    left = hidden.mean(axis=0)
    share, hidden_deg = 1 - float(left.mean()), float(angles_deg[np.argmax(left)])
    if share >= SURVEY_TARGET:
        return Survey(share=share, hidden_deg=hidden_deg, next_deg=hidden_deg)
    # What samples at candidates leave hidden, of all that is.
    candidates_deg = angles_deg[::2]
    apart_deg = np.abs(candidates_deg[:, None] - measured_deg).min(axis=1)
    # A source that a sample does not show is not shown by a second one beside it, for the curve's error is the same.
    new = candidates_deg[apart_deg > BESIDE_DEG]
    candidates_deg = new if new.size else candidates_deg[[int(np.argmax(apart_deg))]]
    expected = np.full(candidates_deg.size, level / posterior.sigma)
    if not placed:
        expected = np.maximum(expected, np.exp(predicted(posterior, shapes, candidates_deg).mean(axis=0)))
    there = undetected(posterior, shapes, candidates_deg, expected, angles_deg, placed=placed)
    return Survey(
        share=share,
        hidden_deg=hidden_deg,
        next_deg=_next_deg(hidden, there, candidates_deg, last_deg=float(measured_deg[-1])),
    )


def _next_deg(
    hidden: Float64[np.ndarray, "particles angles"],
    there: Float64[np.ndarray, "particles candidates angles"],
    candidates_deg: Float64[np.ndarray, " candidates"],
    *,
    last_deg: float,
) -> float:
    """Candidate whose sample adds most: alone if that is enough, else of the two that add most; travel weighed in."""
    far = 1 + np.abs(candidates_deg - last_deg) / SURVEY_TRAVEL_DEG
    rest = hidden[:, None] * there
    left = rest.mean(axis=(0, 2))
    alone = (hidden.mean() - left) / far
    if left.min() <= 1 - SURVEY_TARGET:
        return float(candidates_deg[np.argmax(alone)])
    # The best one, and then the best one after it, would leave gaps that two chosen together do not.
    particles, count, angles = there.shape
    rows = rest.transpose(1, 0, 2).reshape(count, -1)
    left = rows @ there.transpose(1, 0, 2).reshape(count, -1).T / (particles * angles)
    pair = np.unravel_index(int(np.argmax((hidden.mean() - left) / (far[:, None] + far))), left.shape)
    return float(candidates_deg[max(pair, key=lambda each: alone[each])])


def undetected(
    posterior: AnglePosterior,
    shapes: Shapes,
    measured_deg: Float64[np.ndarray, " samples"],
    needed: Float64[np.ndarray, " samples"],
    angles_deg: Float64[np.ndarray, " angles"],
    *,
    placed: bool,
) -> Float64[np.ndarray, "particles samples angles"]:
    """Return the probability that a source at each angle does not exceed the level of each sample, a factor of (13).

    Parameters
    ----------
    posterior
        Markers drawn from it give amplitude and curve.
    shapes
        Family of curves.
    measured_deg, needed
        Angles of the samples in degrees, and the intensity over σ that a source must exceed to be detected there.
    angles_deg
        Angles of the source, in degrees.
    placed
        Whether the samples tell places apart.
    """
    # Spread over all particles, which are sorted by angle.
    drawn = np.linspace(0, posterior.theta_deg.size - 1, SURVEY_PARTICLES).astype(np.int64)
    steps = np.rint(np.abs(measured_deg[:, None] - angles_deg) / STEP_DEG).astype(np.int64)
    away = np.minimum(steps, shapes.log_curve.shape[1] - 1)
    # Every second one as narrow as that of another source may be.
    kind, width = np.divmod(posterior.member[drawn], WIDTHS_DEG.size)
    width[1::2] = np.clip(width[1::2] - NARROWER_STEPS, 0, NARROW_WIDTH if placed else None)
    member = kind * WIDTHS_DEG.size + width
    log_curve = shapes.log_curve[member[:, None, None], away]
    log_height = posterior.log_snr[drawn, None, None] + log_curve
    height = np.exp(np.minimum(log_height, 50.0))
    return np.asarray(ndtr((needed[:, None] - height) / np.hypot(1.0, MODEL_ERROR * height)))
