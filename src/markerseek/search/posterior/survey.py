"""Survey of the range: at which angles a second source as strong as the one found would have been detected.

A second source at θ with amplitude A and curve S stays undetected if no sample i, taken at θ_i, exceeds the level L_i
that noise or other sources reach there:

    h(θ) = mean over A, S of ∏_i Φ((L_i − A·S(θ_i − θ))/s_i),       s_i² = σ² + (εA·S)².                      (13)

The surveyed share of the range is the mean of 1 − h over the range. Amplitude and curve are drawn from the posterior
of the source found, and then varied as much as two sources on one probe differ (`HIDDEN_STEPS`, `HIDDEN_DB`).

A sample still detects a marker at the distance at which the curve S of (1), with the exponents of the most common
member of the family, has fallen to level/peak:

    t = (F/2)·(((peak/level)^(q/p) − 1)/(2^(q/p) − 1))^(1/q).                                                 (12)

A prior q over the marker's angle (`ExpectedAngle`) says where the search looks first. It is wrong with the probability
ε, and the marker is then anywhere in the range of width R:

    π(θ) = (1 − ε)·q(θ) + ε/R.                                                                                  (15)

π is not multiplied into the answer. It weighs what may still hide (13): that the marker hides at θ, and the source seen
at θ₁ is another one, is as probable as π(θ)/π(θ₁) says. That the prior is wrong has the probability ε/(R·π(θ₁)), where
π(θ₁) is the mean over the posterior of the samples, and also of a search that has detected nothing yet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from markerseek.core import AnglePrior, Float64, Interval, MarkerCurve, Sample
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.shapes import STEP_DEG, WIDTHS_DEG, family
from markerseek.search.posterior.sources import BESIDE_DEG, RIVAL_DB, Candidate, suspect_level

WRONG = 0.05
"""Probability ε that a prior is wrong, before anything is measured."""

MOST_WRONG = 0.5
"""Probability that it is wrong from which it is given up."""

SURVEY_ANGLES = 71
"""Angles at which a hidden source is assumed, evenly spread over the range; every second may be the next sample's."""


def survey_angles_deg(limits: Interval) -> Float64[np.ndarray, " angles"]:
    """Return the angles of the range at which a hidden source is assumed, in degrees."""
    return np.linspace(limits.low_deg, limits.high_deg, SURVEY_ANGLES)


class ExpectedAngle:
    """A prior over the angle on the range of a search.

    Raises `ConfigError` if the prior lies outside of the range.
    """

    def __init__(self, prior: AnglePrior, *, limits: Interval) -> None:
        self.window = prior.interval(limits)
        angles_deg = survey_angles_deg(limits)
        # Parts of the range about these angles: the first and the last are half as wide.
        self._ends_deg = np.array([angles_deg[0], *((angles_deg[1:] + angles_deg[:-1]) / 2), angles_deg[-1]])
        mass = np.diff([prior.below(each) for each in self._ends_deg.tolist()])
        uniform = np.diff(self._ends_deg) / limits.width_deg
        self._density = (1 - WRONG) * mass / mass.sum() / uniform + WRONG
        """R·π of each part."""

    def weights(self, posterior: AnglePosterior) -> Float64[np.ndarray, " angles"]:
        """π(θ)/π(θ₁) at each of the angles of the survey, for a source with this posterior."""
        return np.asarray(self._density / self._at(posterior))

    def wrong_probability(self, posterior: AnglePosterior) -> float:
        """Return the probability that the prior is wrong, where the posterior of the samples is that of the marker."""
        return WRONG / self._at(posterior)

    def is_contradicted(self, source: Candidate, *, former: MarkerCurve | None) -> bool:
        """Return whether the prior is more probably wrong than right, where this source is the strongest.

        ``former``: curve of a former marker, which a source that is much weaker does not resemble.
        """
        if former is not None and source.missing is None:
            peak = source.posterior.sigma * math.exp(source.log_snr)
            if peak < former.peak * 10 ** (-RIVAL_DB / 20):
                return True
        return self.wrong_probability(source.posterior) > MOST_WRONG

    def _at(self, posterior: AnglePosterior) -> float:
        share = np.diff(posterior.cumulative(self._ends_deg))
        # A marker beyond an end of the range contradicts a prior within it.
        return float(share @ self._density + (1 - share.sum()) * WRONG)


USUAL_OTHERS = 0.05
"""Prior probability of a second source as strong (within 6 dB); low, because a person lights one spot."""

STATED = 0.02
"""Largest probability of another source being the marker at which the answer may still be `Found`, and states it."""

SURVEY_UNTIL = 12
"""Acquisitions after which the survey goes on only while that probability is above `STATED`: the noise is then high,
each further acquisition lowers the probability by 5 to 10 %, and ten may be needed."""

WORTH = 0.00025
"""Least decrease of that probability that is worth an acquisition."""

LATE_WORTH = 0.25
"""The same after `SURVEY_UNTIL` for intensities alone, as a share of that probability: one gap holds as much."""

HIDDEN_STEPS = (1, -2, 2, -9, 0, 4, -1, 9, -4, 1, 0, -1)
"""Steps in `WIDTHS_DEG`, of 10 % each, by which the curves of hidden sources are wider than that of the source found.

They are quantiles over 120 pairs of sources on one probe, with all parameters drawn at random: the ratio of the widths
was 0.86 to 1.11 in half of the pairs and 0.36 to 2.7 in 95 %.
"""

HIDDEN_DB = (-2.9, -0.2, -4.3, -1.6, -5.6, -0.9, -3.5, -2.2, -1.2, -4.9, -0.5, -2.5)
"""Strength of hidden sources over that of the source found, in dB: evenly spread amplitudes, from 1 down to 0.5."""

TAIL_ERROR = 0.2
"""Relative error ε of the curve in its tails, where a source is detected or not (`shapes.MODEL_ERROR`)."""

SURVEY_TRAVEL_DEG = 600.0
"""Travel in degrees for which a sample must add twice as much to the survey as a sample without travel."""

WEAKEST_DB = 20.0
"""Peak SNR of the weakest marker that a search is asked to find, in dB (physics notes: 20 to 60)."""

NARROW_DEG = 3.0
"""Full width at half maximum of the narrowest usual curve, in degrees (physics notes: 3 to 17)."""

USUAL_TAIL = 1.2
USUAL_KNEE = 2.4
"""Exponents p and q of (1) of the most common curve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """How much of the range has been surveyed."""

    surveyed: float
    """Share of the range in which a second source as strong would have been detected."""
    hidden: float
    """1 − ``surveyed``; in a search with a prior, weighted by the prior's density relative to that at the source."""
    hidden_deg: float
    """Angle at which such a source would most probably have been missed."""
    next_deg: float
    """Angle whose sample adds most to the survey, with travel as a cost."""
    gain: float
    """Largest decrease of `hidden` by one acquisition."""


def hidden_probability(survey: Survey, *, others: float) -> float:
    """Return the probability of a second source as strong that the survey has not shown, by Bayes' rule.

    ``others``: prior probability of such a source.
    """
    hidden = others * survey.hidden
    return hidden / (1 - others + hidden) if hidden else 0.0


def survey_of(
    source: Candidate,
    lit: Sequence[Sample],
    noise: SearchNoise,
    *,
    limits: Interval,
    expected: ExpectedAngle | None = None,
) -> Survey:
    """Return the survey of a range for second sources as strong as ``source`` (13).

    ``expected``: prior over the marker's angle; None: no prior.
    """
    posterior = source.posterior
    largest = [sample.reading.intensity for sample in lit]
    level = noise.floor.level or min(largest)
    angles_deg = survey_angles_deg(limits)
    measured_deg = np.array([sample.angle_deg for sample in lit])
    # If a frame lists no local maxima, another source shows only if it is stronger than the intensity measured.
    listed = np.array([sample.reading.local_maxima is not None for sample in lit])
    has_positions = bool(listed.all())
    # If nothing else exceeds the noise, a frame's largest peak is measured again before it counts as a source.
    share = noise_shares(lit, noise)
    suspect = np.where(np.array(largest) < level * share, suspect_level(lit, noise), level) * share
    needed = np.where(listed, suspect, np.maximum(level * share, largest)) / posterior.sigma
    hidden = undetected(posterior, measured_deg, needed, angles_deg, noise=share).prod(axis=1)
    if not has_positions:
        # Near the source found, a second one shows only in the form of the curve, which is tested for two peaks.
        hidden[:, np.abs(angles_deg - posterior.mean_deg) <= posterior.fwhm_deg / 2] = 0.0
    surveyed = 1 - float(hidden.mean())
    if expected is not None:
        hidden = hidden * expected.weights(posterior)
    left = hidden.mean(axis=0)
    hidden_deg = float(angles_deg[np.argmax(left)])
    # Angles at which the next sample may be taken.
    candidates_deg = angles_deg[::2]
    apart_deg = np.abs(candidates_deg[:, None] - measured_deg).min(axis=1)
    # A second sample beside the first does not show a source that the first misses: the curve's error is the same.
    new = candidates_deg[apart_deg > BESIDE_DEG]
    candidates_deg = new if new.size else candidates_deg[[int(np.argmax(apart_deg))]]
    # The next sample is taken at rest, so that it has the noise of the samples at rest, if there are any.
    next_share = np.full(candidates_deg.size, share.min())
    needed = next_share * (suspect_level(lit, noise) if has_positions else level) / posterior.sigma
    if not has_positions:
        needed = np.maximum(needed, np.exp(posterior.log_heights(candidates_deg).mean(axis=0)))
    there = undetected(posterior, candidates_deg, needed, angles_deg, noise=next_share)
    next_deg, gain = _next(hidden, there, candidates_deg, last_deg=float(measured_deg[-1]))
    return Survey(surveyed=surveyed, hidden=float(left.mean()), hidden_deg=hidden_deg, next_deg=next_deg, gain=gain)


def noise_shares(lit: Sequence[Sample], noise: SearchNoise) -> Float64[np.ndarray, " samples"]:
    """Return the noise of each sample over that of the search; with sweeps, the latter is that of single pulses."""
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
    """Return the candidate whose sample adds most, alone or in a pair, with travel as a cost; and how much it adds."""
    far = 1 + np.abs(candidates_deg - last_deg) / SURVEY_TRAVEL_DEG
    rest = hidden[:, None] * there
    left = rest.mean(axis=(0, 2))
    alone = (hidden.mean() - left) / far
    gain = float(hidden.mean() - left.min())
    # Two candidates chosen together leave fewer gaps than the best one followed by the next best.
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
    measured_deg: Float64[np.ndarray, " samples"],
    needed: Float64[np.ndarray, " samples"],
    angles_deg: Float64[np.ndarray, " angles"],
    *,
    noise: Float64[np.ndarray, " samples"],
) -> Float64[np.ndarray, "particles samples angles"]:
    """Return the probability that a source at each angle does not exceed the level of each sample, the factors of (13).

    ``posterior``: markers drawn from it give amplitude and curve. ``measured_deg``, ``needed``: angles of the samples
    in degrees, and the intensity over σ that a source must exceed to be detected there. ``noise``: noise of each sample
    over σ.
    """
    # Spread over all particles, which are sorted by angle.
    drawn = np.linspace(0, posterior.theta_deg.size - 1, len(HIDDEN_STEPS)).astype(np.int64)
    steps = np.rint(np.abs(measured_deg[:, None] - angles_deg) / STEP_DEG).astype(np.int64)
    curves = family().log_curve
    away = np.minimum(steps, curves.shape[1] - 1)
    kind, width = np.divmod(posterior.member[drawn], WIDTHS_DEG.size)
    width = np.clip(width + HIDDEN_STEPS, 0, WIDTHS_DEG.size - 1)
    member = kind * WIDTHS_DEG.size + width
    log_curve = curves[member[:, None, None], away]
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

    Halfway between two acquisitions the curve is still at level/peak (12).

    ``level``: largest intensity that noise reaches, positive. ``peak``: intensity with the probe on the marker, in the
    same unit. ``fwhm_deg``: full width at half maximum of the curve. Raises `ValueError` if the peak is not above the
    level, because then no number is enough.
    """
    if not 0 < level < peak:
        raise ValueError(f"level {level} must be positive and below the peak {peak}; average more pulses")
    far_deg = detection_distance_deg(level=level, peak=peak, fwhm_deg=fwhm_deg)
    return max(1, math.ceil(limits.width_deg / (2 * far_deg)))


def missed_marker(lit: Sequence[Sample], noise: SearchNoise, limits: Interval) -> str:
    """Return which marker a search without a detection may have missed, and how to detect it; empty if none.

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
        f"wide; with {needed} acquisitions such a marker would have been seen"
    )
