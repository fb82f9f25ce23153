"""What may still hide: where in the range a source as loud as the one answered would have been detected.

A source at θ with the amplitude A and the curve S of the one answered stays undetected if no sample i,
taken at θ_i, exceeds the level L_i that noise reaches there, or that other sources did:

    h(θ) = mean over A, S of ∏_i Φ((L_i − A·S(θ_i − θ))/s_i),       s_i² = σ² + (εA·S)².                      (13)

The share of the range that has been surveyed is the mean of 1 − h over it. Amplitude and curve are those of markers
drawn from the posterior, so that both are as uncertain as the samples leave them, and differ from those by as much as
second sources do (`HIDDEN_STEPS`, `HIDDEN_DB`).

How far from a marker a sample still detects it: a curve S of (1), the most common member of the family, is level/peak
at the distance

    t = (F/2)·(((peak/level)^(q/p) − 1)/(2^(q/p) − 1))^(1/q).                                                 (12)
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from markerseek.core import Float64, Interval, Sample
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.candidates import BESIDE_DEG, Candidate, suspect_level
from markerseek.search.posterior.expected import ExpectedAngle, survey_angles_deg
from markerseek.search.posterior.inference import AnglePosterior
from markerseek.search.posterior.shapes import STEP_DEG, WIDTHS_DEG, Shapes

USUAL_OTHERS = 0.05
"""Prior probability that there is another source as loud, within 6 dB: a person lights one spot."""

STATED = 0.02
"""Probability that another source is the marker, up to which the probability is stated and is no veto."""

SURVEY_UNTIL = 12
"""Acquisitions after which the survey goes on only while more than `STATED` is left: then the noise is high, each
further acquisition lowers the probability by a twentieth to a tenth, and there may be ten to make."""

WORTH = 0.00025
"""Least amount by which an acquisition must lower that probability to be made."""

LATE_WORTH = 0.25
"""The same of a file of intensities after `SURVEY_UNTIL`, over that probability: so much is in one gap that is left."""

HIDDEN_STEPS = (1, -2, 2, -9, 0, 4, -1, 9, -4, 1, 0, -1)
"""Steps of `WIDTHS_DEG`, by a tenth each, by which the curves of the hidden sources are wider than that of the one
answered: quantiles of the widths of 120 pairs of sources on one probe with everything drawn, whose ratio was 0.86 to
1.11 in half of the pairs and 0.36 to 2.7 in 95 %."""

HIDDEN_DB = (-2.9, -0.2, -4.3, -1.6, -5.6, -0.9, -3.5, -2.2, -1.2, -4.9, -0.5, -2.5)
"""Their loudness over that of the one answered, in dB: evenly spread amplitudes down to a half of it."""

TAIL_ERROR = 0.2
"""Relative error ε of the curve in its tails, where a source is detected or not (`shapes.MODEL_ERROR`)."""

SURVEY_TRAVEL_DEG = 600.0
"""Travel that must double what a sample adds to the survey to be worth it, in degrees."""

WEAKEST_DB = 20.0
"""Peak SNR of the weakest marker that a search is asked to find, in dB (physics notes: 20 to 60)."""

NARROW_DEG = 3.0
"""Full width at half maximum of the narrowest usual curve, in degrees (physics notes: 3 to 17)."""

USUAL_TAIL, USUAL_KNEE = 1.2, 2.4
"""Exponents p and q of (1) of the most common curve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """How much of the range has been surveyed."""

    surveyed: float
    """Share of the range in which a source as loud would have been detected."""
    hidden: float
    """What is missing to 1; of a search with a prior weighted by it, over its density at the source."""
    hidden_deg: float
    """Angle at which it would most probably not have been."""
    next_deg: float
    """Angle whose sample adds most, travel weighed in."""
    gain: float
    """How much one acquisition takes from `hidden`, at best."""


def hidden_probability(survey: Survey, *, others: float) -> float:
    """Probability that there is another source as loud, after the survey has not shown it: Bayes' rule.

    ``others``: prior probability that there is one.
    """
    hidden = others * survey.hidden
    return hidden / (1 - others + hidden) if hidden else 0.0


def survey_of(
    source: Candidate,
    shapes: Shapes,
    lit: Sequence[Sample],
    noise: SearchNoise,
    *,
    limits: Interval,
    expected: ExpectedAngle | None = None,
) -> Survey:
    """Return the survey of a range for sources as loud as one (13).

    ``expected``: prior over the marker's angle; None: it may be anywhere.
    """
    posterior, largest = source.posterior, [sample.reading.intensity for sample in lit]
    level = noise.floor.level or min(largest)
    angles_deg = survey_angles_deg(limits)
    measured_deg = np.array([sample.angle_deg for sample in lit])
    # Where a frame lists no arrivals, another source shows only if it is louder than what was measured.
    listed = np.array([sample.reading.local_maxima is not None for sample in lit])
    has_positions = bool(listed.all())
    # Where nothing else is above the noise, a frame's largest peak is looked at again before it proves a source.
    share = noise_shares(lit, noise)
    suspect = np.where(np.array(largest) < level * share, suspect_level(lit, noise), level) * share
    needed = np.where(listed, suspect, np.maximum(level * share, largest)) / posterior.sigma
    hidden = undetected(posterior, shapes, measured_deg, needed, angles_deg, noise=share).prod(axis=1)
    if not has_positions:
        # Beside the source itself it shows in the form of the curve only, which is tested for two humps.
        hidden[:, np.abs(angles_deg - posterior.mean_deg) <= posterior.fwhm_deg / 2] = 0.0
    surveyed = 1 - float(hidden.mean())
    if expected is not None:
        hidden = hidden * expected.weights(posterior)
    left = hidden.mean(axis=0)
    hidden_deg = float(angles_deg[np.argmax(left)])
    # What samples at candidates leave hidden, of all that is.
    candidates_deg = angles_deg[::2]
    apart_deg = np.abs(candidates_deg[:, None] - measured_deg).min(axis=1)
    # A source that a sample does not show is not shown by a second one beside it, for the curve's error is the same.
    new = candidates_deg[apart_deg > BESIDE_DEG]
    candidates_deg = new if new.size else candidates_deg[[int(np.argmax(apart_deg))]]
    # It is measured at rest, as the last one was if any was.
    next_share = np.full(candidates_deg.size, share.min())
    needed = next_share * (suspect_level(lit, noise) if has_positions else level) / posterior.sigma
    if not has_positions:
        needed = np.maximum(needed, np.exp(posterior.log_heights(shapes, candidates_deg).mean(axis=0)))
    there = undetected(posterior, shapes, candidates_deg, needed, angles_deg, noise=next_share)
    next_deg, gain = _next(hidden, there, candidates_deg, last_deg=float(measured_deg[-1]))
    return Survey(surveyed=surveyed, hidden=float(left.mean()), hidden_deg=hidden_deg, next_deg=next_deg, gain=gain)


def noise_shares(lit: Sequence[Sample], noise: SearchNoise) -> Float64[np.ndarray, " samples"]:
    """Return the noise of each sample over that of the search, which is that of single pulses where it has sweeps."""
    shares = np.ones(len(lit))
    if noise.sigma and any(sample.sweep is not None for sample in lit):
        for index, sample in enumerate(lit):
            if sample.sweep is None and sample.reading.noise_sigma:
                shares[index] = sample.reading.noise_sigma / noise.sigma
    return shares


def _next(
    hidden: Float64[np.ndarray, "particles angles"],
    there: Float64[np.ndarray, "particles candidates angles"],
    candidates_deg: Float64[np.ndarray, " candidates"],
    *,
    last_deg: float,
) -> tuple[float, float]:
    """Candidate whose sample adds most, alone or as one of a pair, travel weighed in; and how much it adds."""
    far = 1 + np.abs(candidates_deg - last_deg) / SURVEY_TRAVEL_DEG
    rest = hidden[:, None] * there
    left = rest.mean(axis=(0, 2))
    alone = (hidden.mean() - left) / far
    gain = float(hidden.mean() - left.min())
    # The best one, and then the best one after it, would leave gaps that two chosen together do not.
    particles, count, angles = there.shape
    rows = rest.transpose(1, 0, 2).reshape(count, -1)
    left = rows @ there.transpose(1, 0, 2).reshape(count, -1).T / (particles * angles)
    gain_of_two = float(hidden.mean() - left.min()) / 2
    if gain_of_two < gain / 1.5:
        return float(candidates_deg[np.argmax(alone)]), gain
    pair = np.unravel_index(int(np.argmax((hidden.mean() - left) / (far[:, None] + far))), left.shape)
    return float(candidates_deg[max(pair, key=lambda each: alone[each])]), max(gain, gain_of_two)


def undetected(
    posterior: AnglePosterior,
    shapes: Shapes,
    measured_deg: Float64[np.ndarray, " samples"],
    needed: Float64[np.ndarray, " samples"],
    angles_deg: Float64[np.ndarray, " angles"],
    *,
    noise: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, "particles samples angles"]:
    """Return the probability that a source at each angle does not exceed the level of each sample, a factor of (13).

    ``posterior``: markers drawn from it give amplitude and curve. ``measured_deg``, ``needed``: angles of the samples
    in degrees, and the intensity over σ that a source must exceed to be detected there. ``noise``: noise of each sample
    over σ.
    """
    # Spread over all particles, which are sorted by angle.
    drawn = np.linspace(0, posterior.theta_deg.size - 1, len(HIDDEN_STEPS)).astype(np.int64)
    steps = np.rint(np.abs(measured_deg[:, None] - angles_deg) / STEP_DEG).astype(np.int64)
    away = np.minimum(steps, shapes.log_curve.shape[1] - 1)
    kind, width = np.divmod(posterior.member[drawn], WIDTHS_DEG.size)
    width = np.clip(width + HIDDEN_STEPS, 0, WIDTHS_DEG.size - 1)
    member = kind * WIDTHS_DEG.size + width
    log_curve = shapes.log_curve[member[:, None, None], away]
    log_peak = posterior.log_snr[drawn] + math.log(10) / 20 * np.array(HIDDEN_DB)
    log_height = log_peak[:, None, None] + log_curve
    height = np.exp(np.minimum(log_height, 50.0))
    return np.asarray(ndtr((needed[:, None] - height) / np.hypot(noise[:, None], TAIL_ERROR * height)))


def detection_distance_deg(*, level: float, peak: float, fwhm_deg: float) -> float:
    """Return the distance (12) at which the curve has fallen to the noise level, in degrees.

    ``level``, ``peak``: largest intensity that noise reaches, and intensity with the probe on the marker; 0 < level <
    peak. ``fwhm_deg``: full width at half maximum of the curve.
    """
    ratio = USUAL_KNEE / USUAL_TAIL
    scaled = ((peak / level) ** ratio - 1) / (2**ratio - 1)
    return fwhm_deg / 2 * math.pow(scaled, 1 / USUAL_KNEE)


def acquisitions_needed(limits: Interval, *, level: float, peak: float, fwhm_deg: float = NARROW_DEG) -> int:
    """Return the number of equal steps, one acquisition in the middle of each, that miss no marker.

    Halfway between two of them the curve is still level/peak (12).

    ``level``: largest intensity that noise reaches, positive. ``peak``: intensity with the probe on the marker, in the
    same unit. ``fwhm_deg``: full width at half maximum of its curve. Raises `ValueError` if the peak is not above the
    level: then no number would do.
    """
    if not 0 < level < peak:
        raise ValueError(f"level {level} must be positive and below the peak {peak}; average more pulses")
    far_deg = detection_distance_deg(level=level, peak=peak, fwhm_deg=fwhm_deg)
    return max(1, math.ceil(limits.width_deg / (2 * far_deg)))


def missed_marker(lit: Sequence[Sample], noise: SearchNoise, limits: Interval) -> str:
    """Return which marker a search without a detection may have missed, and what would detect it; empty if none.

    ``lit``: samples with the laser on, at least one.
    """
    level = noise.floor.level
    if level is None or noise.sigma is None or max(sample.reading.intensity for sample in lit) > level:
        return ""
    peak = noise.sigma * 10 ** (WEAKEST_DB / 20)
    if not 0 < level < peak:
        return f"; a marker {WEAKEST_DB:g} dB above the noise would not be detected at all with so few pulses"
    needed = acquisitions_needed(limits, level=level, peak=peak)
    if needed <= len(lit):
        return ""
    return (
        f"; {len(lit)} acquisitions may have missed a marker {WEAKEST_DB:g} dB above the noise and {NARROW_DEG:g} deg "
        f"wide, {needed} would not"
    )
