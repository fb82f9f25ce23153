"""The next angle: a fixed plan, then the most probable detection, then the least expected variance.

The last two are acquisition functions in the sense of Bayesian optimisation: each is computed over candidate angles
from markers drawn from the posterior, and the best candidate is the next angle. Travel is weighed in.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

import numpy as np
from scipy.special import ndtr

from markerseek._compiled import compiled
from markerseek.core import PAPER_RANGE, ByHand, Float64, Int64, Interval, Reading, Sample
from markerseek.search.floor import noise_of
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.likelihood import FAR_TAIL_ERROR, STRONG_SNR
from markerseek.search.posterior.motion import measured_twice
from markerseek.search.posterior.shapes import STEP_DEG, family
from markerseek.search.posterior.symmetry import (
    CORRELATION_LENGTH,
    MAX_GROUPS,
    TEMPLATE_LOG_LEVELS,
    TEMPLATE_SIGMAS,
    log_level,
    template_sigma,
)

PLAN = (1, 4, 6, 0, 3, 7, 2, 5)
"""Planned angles, each in the middle of an equal part of the range: evenly spread after eight, as eight acquisitions
miss the fewest markers, and nearly so after three."""

PLAN_BY_HAND = (1, 4, 6, 7, 5, 3, 2, 0)
"""The same for a hand, which turns back once: alike until three are measured."""


def planned_deg(
    measured_deg: Sequence[float], *, limits: Interval, descending: bool, plan: Sequence[int] = PLAN
) -> float:
    """Return the next angle of a search that has detected nothing yet, in degrees.

    First those of `PLAN`, then the middle of the largest gap; a gap at an end of the range counts twice and is closed
    by the end itself.

    ``measured_deg``: angles reached so far. ``descending``: whether to begin at the high end. ``plan``: order of the
    planned angles.
    """
    count = len(measured_deg)
    if count < len(plan):
        share = (plan[count] + 0.5) / len(plan)
        return limits.low_deg + limits.width_deg * (1 - share if descending else share)
    inside = sorted(map(limits.nearest, measured_deg))
    gaps = [(high - low, (low + high) / 2) for low, high in pairwise(inside)]
    low_gap = inside[0] - limits.low_deg
    high_gap = limits.high_deg - inside[-1]
    # Nothing lies beyond an end, so that its gap is covered from one side only.
    gaps += [(2 * low_gap, limits.low_deg), (2 * high_gap, limits.high_deg)]
    return max(gaps, key=lambda gap: gap[0])[1]


def step_near_deg(angle_deg: float, *, limits: Interval, step_deg: float) -> float:
    """Return the multiple of a step in the range that is nearest to an angle; the angle if there is none."""
    lowest = math.ceil(limits.low_deg / step_deg)
    highest = math.floor(limits.high_deg / step_deg)
    if lowest > highest:
        return angle_deg
    # Rounding may carry a multiple past an end that is one itself.
    return limits.nearest(step_deg * min(max(round(angle_deg / step_deg), lowest), highest))


def effort_deg(
    candidates: Float64[np.ndarray, " candidates"], measured_deg: Sequence[float], by_hand: ByHand | None
) -> Float64[np.ndarray, " candidates"]:
    """Return the rotation to each candidate in degrees, and for a hand what turning back is worth besides.

    ``measured_deg``: angles reached so far, the last one last.
    """
    way_deg = candidates - measured_deg[-1]
    effort = np.abs(way_deg)
    if by_hand is not None and len(measured_deg) > 1:
        effort += by_hand.reversal_deg * (way_deg * (measured_deg[-1] - measured_deg[-2]) < 0)
    return effort


DETECTION_ANGLES = 71
"""Candidate angles, evenly spread over the range, while no marker is detected."""

MIN_APART_DEG = 0.4
"""Least distance of such an angle from those measured, in degrees."""

DETECTION_TRAVEL_DEG = 300.0
"""Travel that must double the probability of detection to be worth it, in degrees."""


def most_detectable_deg(
    posterior: AnglePosterior,
    measured_deg: Sequence[float],
    *,
    limits: Interval,
    level: float,
    by_hand: ByHand | None = None,
) -> float:
    """Return the angle at which the marker is most probably above the noise, travel weighed in, in degrees.

    All samples so far were below that level, but not all alike: the probability is large in a wide gap, and also where
    the largest peak of a frame was higher than noise usually is.

    ``posterior``: the posterior, with many markers drawn. ``measured_deg``: angles reached so far, the last one last.
    ``level``: largest intensity that noise reaches, over σ. ``by_hand``: how a person turns the probe.
    """
    candidates = np.linspace(limits.low_deg, limits.high_deg, DETECTION_ANGLES)
    apart = np.abs(candidates[:, None] - np.array(measured_deg)).min(axis=1)
    candidates = candidates[apart >= min(MIN_APART_DEG, apart.max())]
    away = np.abs(candidates[:, None] - posterior.theta_deg) / STEP_DEG
    log_curve = family().log_curve
    place = np.minimum(np.rint(away).astype(np.int64), log_curve.shape[1] - 1)
    height = np.exp(np.minimum(posterior.log_snr + log_curve[posterior.member, place], 50.0))
    # A marker's envelope is normal about its height once that is clear of the noise.
    detected = ndtr(height - level).mean(axis=1)
    # A farther candidate must be better by the factor 1 + travel/300°.
    travel = effort_deg(candidates, measured_deg, by_hand)
    return float(candidates[np.argmax(detected / (1 + travel / DETECTION_TRAVEL_DEG))])


MIN_GAIN = 0.02
"""Share by which a sample must be expected to reduce the standard deviation; else samples are spread evenly."""

TRAVEL_DEG = 75.0
"""Travel that costs as much as an acquisition, in degrees."""


def most_informative_deg(
    posterior: AnglePosterior,
    measured_deg: Sequence[float],
    *,
    limits: Interval,
    floor: float,
    by_hand: ByHand | None = None,
) -> float:
    """Return the angle whose sample is expected to leave the smallest standard deviation, travel weighed in.

    It may be one that was measured before: beside an end of the range a second sample is often worth more than a new
    angle.

    ``measured_deg``: angles reached so far, the last one last. ``by_hand``: how a person turns the probe.
    """
    candidates, sigma_deg = expected_sigmas_deg(posterior, limits=limits, floor=floor)
    # What a sample gains over the least informative one, for its cost. Their product would stay forever where a sample
    # gives no information and needs no travel.
    gain = np.log(sigma_deg.max() / sigma_deg)
    if gain.max() < MIN_GAIN and posterior.strong_deg.size:
        return _evenly_deg(posterior, limits=limits)
    travel = effort_deg(candidates, measured_deg, by_hand)
    return float(candidates[np.argmax(gain / (1 + travel / TRAVEL_DEG))])


FLANKS = 0.8
"""How far to either side of the marker that is, over the full width at half maximum."""

MIRRORED = 0.03
"""Distance from its mirror image within which a place has one, over that width."""

ONE_SIDED = 1.6
MIN_GAP = 0.12
"""Part of both flanks, of 2, below which the range holds too little of one; the least gap that is filled then, over
that width."""


def flank_again_deg(posterior: AnglePosterior, samples: Sequence[Sample]) -> float | None:
    """Return the angle measured before at which a displacement of the marker would show the most, in degrees.

    A curve can be laid through a few samples wherever the marker was at each. A flank that is measured again at another
    time shows whether it moved. It is the steepest one over the error of a sample. None if an angle was measured twice.

    ``samples``: those of the marker, at rest.
    """
    strong = [each for each in samples if each.reading.intensity >= STRONG_SNR * posterior.sigma]
    angles_deg = np.array([each.angle_deg for each in strong])
    if not strong or measured_twice(angles_deg.tolist(), fwhm_deg=posterior.fwhm_deg):
        return None
    error = np.hypot(posterior.sample_error, [posterior.sigma / each.reading.intensity for each in strong])
    # Of a Gaussian, ln S falls by 8 ln 2 t/F² a degree; far from its top a real curve is flatter.
    away_deg = np.abs(angles_deg - posterior.mean_deg)
    away_deg[away_deg > FLANKS * posterior.fwhm_deg] = 0.0
    return float(angles_deg[np.argmax(away_deg / error)])


def _evenly_deg(posterior: AnglePosterior, *, limits: Interval) -> float:
    """Return the angle in degrees where many samples about the top of the curve are the most even on both flanks.

    First the mirror image of a place that has none; beside an end of the range the middle of the widest gap; then the
    place with the fewest samples, for a place that is measured again is a group that exists, and groups are few.
    """
    centre_deg = posterior.mean_deg
    width_deg = posterior.fwhm_deg
    near = np.abs(posterior.strong_deg - centre_deg) <= FLANKS * width_deg
    if not near.any():
        return limits.nearest(centre_deg)
    places_deg = posterior.strong_deg[near]
    if posterior.strong_deg.size < MAX_GROUPS:
        ends_deg = [limits.nearest(centre_deg + side * FLANKS * width_deg) for side in (-1, 1)]
        between = np.unique([*places_deg.tolist(), *ends_deg])
        gap = int(np.argmax(np.diff(between)))
        one_sided = ends_deg[1] - ends_deg[0] < ONE_SIDED * FLANKS * width_deg
        if one_sided and between[gap + 1] - between[gap] > MIN_GAP * width_deg:
            return float(between[gap] + between[gap + 1]) / 2
        mirrored = 2 * centre_deg - places_deg
        mirrored = mirrored[(mirrored >= limits.low_deg) & (mirrored <= limits.high_deg)]
        if mirrored.size:
            alone_deg = np.abs(mirrored[:, None] - places_deg).min(axis=1)
            if alone_deg.max() > MIRRORED * width_deg:
                return float(mirrored[np.argmax(alone_deg)])
    return limits.nearest(float(places_deg[np.argmin(posterior.strong_samples[near])]))


def expected_sigmas_deg(
    posterior: AnglePosterior, *, limits: Interval, floor: float
) -> tuple[Float64[np.ndarray, " candidates"], Float64[np.ndarray, " candidates"]]:
    """Return candidates for the next angle, and the standard deviation that a sample there is expected to leave.

    The expectation is over markers θ_j drawn from the posterior. Each in turn is the truth, and the others keep the
    weight that its sample would leave them, where d_jk is the difference of their intensities there in standard
    deviations of both,

        E[var θ] = mean over j of var_k(θ_k; w_jk),        w_jk = (1 + d_jk²/8)⁻⁴ ≈ exp(−d_jk²/2).              (11)

    ``floor``: intensity that noise usually reaches by itself, over σ.
    """
    candidates = _candidates(posterior, limits=limits)
    shapes = family()
    variance = np.empty(candidates.size)
    # Noise below the error of deep tails is no more use than that: a sample there would be expected to tell much, tell
    # nothing, and be taken for ever.
    quiet = max(0.0, float(posterior.log_snr.mean()) + math.log(FAR_TAIL_ERROR))
    expected_variance(
        candidates,
        posterior.theta_deg,
        posterior.member,
        shapes.log_curve,
        posterior.log_snr - quiet,
        STEP_DEG,
        floor,
        posterior.strong_deg,
        posterior.strong_log_snr - quiet,
        CORRELATION_LENGTH * shapes.fwhm_deg,
        TEMPLATE_LOG_LEVELS,
        TEMPLATE_SIGMAS,
        posterior.sample_error,
        variance,
    )
    return candidates, np.sqrt(variance + 1e-6)


def _candidates(posterior: AnglePosterior, *, limits: Interval) -> Float64[np.ndarray, " candidates"]:
    """Return the angles about the mean of the posterior, and over all of it."""
    # 1.6 widths to either side hold both flanks, where the curve is steepest.
    near = posterior.mean_deg + posterior.fwhm_deg * np.linspace(-1.6, 1.6, 19)
    if posterior.strong_deg.size:
        # Mirror images of the strong samples: the template's error is the same there (7), and cancels.
        wide = 2 * posterior.mean_deg - posterior.strong_deg
    else:
        low_deg = float(posterior.theta_deg.min())
        high_deg = float(posterior.theta_deg.max())
        wide = np.linspace(low_deg - posterior.fwhm_deg, high_deg + posterior.fwhm_deg, 18)
    angles = np.concatenate([near, wide, [limits.low_deg, limits.high_deg]])
    return np.unique(angles[(angles >= limits.low_deg) & (angles <= limits.high_deg)])


@compiled
def _variance_left(
    theta_deg: Float64[np.ndarray, " particles"],
    height: Float64[np.ndarray, " particles"],
    variance: Float64[np.ndarray, " particles"],
    sums: Float64[np.ndarray, "3 particles"],
) -> float:
    """Return the mean of (11), each marker in turn being the true one, by whose sample the others are weighted."""
    count = theta_deg.size
    sums[0] = 1.0
    sums[1] = 0.0
    sums[2] = 0.0
    mass = sums[0]
    mean = sums[1]
    square = sums[2]
    # Weights are the same both ways: half of the pairs are enough.
    for p in range(count):
        own_mass = 0.0
        own_mean = 0.0
        own_square = 0.0
        for other in range(p + 1, count):
            away = (height[p] - height[other]) ** 2 / (variance[p] + variance[other])
            # (1 + d²/8)⁻⁴ for exp(−d²/2): without a call the loop runs in vector registers, and for far markers its
            # heavier tail leaves a little weight, as an outlier would.
            near_by = 1 / (1 + away / 8)
            near_by *= near_by
            near_by *= near_by
            offset = theta_deg[other] - theta_deg[p]
            own_mass += near_by
            own_mean += near_by * offset
            own_square += near_by * offset * offset
            mass[other] += near_by
            mean[other] -= near_by * offset
            square[other] += near_by * offset * offset
        mass[p] += own_mass
        mean[p] += own_mean
        square[p] += own_square
    total = 0.0
    for p in range(count):
        total += square[p] / mass[p] - (mean[p] / mass[p]) ** 2
    return total / count


@compiled
def expected_variance(
    candidates_deg: Float64[np.ndarray, " candidates"],
    theta_deg: Float64[np.ndarray, " particles"],
    member: Int64[np.ndarray, " particles"],
    log_curve: Float64[np.ndarray, "shapes distances"],
    log_amplitude: Float64[np.ndarray, " particles"],
    step_deg: float,
    floor: float,
    strong_deg: Float64[np.ndarray, " strong"],
    strong_log: Float64[np.ndarray, " strong"],
    length_deg: Float64[np.ndarray, " shapes"],
    log_levels: Float64[np.ndarray, " levels"],
    sigmas: Float64[np.ndarray, " levels"],
    sample_error: float,
    out: Float64[np.ndarray, " candidates"],
) -> None:
    """Return the expected variance of the angle in deg² after one more sample at each candidate.

    Amplitudes are in units of σ. ``strong_deg`` and ``strong_log`` are the strong samples of a symmetric curve: the
    template's error at the nearest of them, by its distance from a marker, is expected of the candidate too.
    """
    count = theta_deg.size
    strong = strong_deg.size
    distance = np.empty((count, strong))
    residual = np.empty((count, strong))
    for p in range(count):
        for i in range(strong):
            away_deg = abs(strong_deg[i] - theta_deg[p])
            level = log_level(log_curve[member[p]], away_deg / step_deg)
            distance[p, i] = away_deg / length_deg[member[p]]
            residual[p, i] = (strong_log[i] - log_amplitude[p] - level) / template_sigma(level, log_levels, sigmas)
    height = np.empty(count)
    variance = np.empty(count)
    sums = np.empty((3, count))
    for c in range(candidates_deg.size):
        for p in range(count):
            away_deg = abs(candidates_deg[c] - theta_deg[p])
            level = log_level(log_curve[member[p]], away_deg / step_deg)
            sigma = template_sigma(level, log_levels, sigmas)
            place = away_deg / length_deg[member[p]]
            # Of (8) only the most correlated strong sample: its residual, shrunk by the correlation, is expected here.
            correlation = 0.0
            expected = 0.0
            for i in range(strong):
                known = 1 / (1 + 0.5 * (distance[p, i] - place) ** 2)
                if known > correlation:
                    correlation = known
                    expected = known * residual[p, i] * sigma
            mu = math.exp(min(log_amplitude[p] + level + expected, 300.0))
            # Below the detection threshold the largest peak stays as high as that: such candidates give no
            # information.
            height[p] = 0.5 * math.log(mu * mu + floor * floor)
            variance[p] = (
                sigma * sigma * (1 - correlation * correlation)
                + sample_error * sample_error
                + 1 / (mu * mu + floor * floor)
            )
        out[c] = _variance_left(theta_deg, height, variance, sums)


BINS = 700
"""Equal parts of the range over which the probabilities are stated: a tenth of a degree of 70."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Belief:
    """Posterior of the strongest source's angle."""

    angles_deg: Float64[np.ndarray, " parts"]
    """Middles of equal parts of the range in degrees."""
    probability: Float64[np.ndarray, " parts"]
    """Probability of each part; what is missing to 1 lies beyond the range."""
    choice_deg: Float64[np.ndarray, " candidates"]
    """Candidates for the next angle, rising; none before anything is detected."""
    choice_sigma_deg: Float64[np.ndarray, " candidates"]
    """Standard deviation of the marker's angle that a sample at each is expected to leave, in degrees (11)."""


def belief_of(posterior: AnglePosterior, *, limits: Interval, floor: float, detected: bool) -> Belief:
    """Return a posterior as a belief.

    ``floor``: intensity that noise usually reaches by itself, over σ. ``detected``: whether anything is detected yet.
    """
    choice_deg = np.empty(0)
    choice_sigma_deg = choice_deg
    if detected:
        choice_deg, choice_sigma_deg = expected_sigmas_deg(posterior, limits=limits, floor=floor)
    ends_deg = np.linspace(limits.low_deg, limits.high_deg, BINS + 1)
    return Belief(
        angles_deg=(ends_deg[1:] + ends_deg[:-1]) / 2,
        probability=np.diff(posterior.cumulative(ends_deg)),
        choice_deg=choice_deg,
        choice_sigma_deg=choice_sigma_deg,
    )


@cache
def load_kernels() -> None:
    """Make one decision on three synthetic samples: from disk the kernels take a quarter of a second."""
    lit = [
        Sample(
            angle_deg=angle_deg,
            reading=Reading(
                intensity=intensity,
                lateral_m=0.0,
                centroid_s=33e-6,
                spread_s=0.2e-6,
                noise_sigma=1.0,
                cells=10_000,
                coherence=0.9,
            ),
        )
        for angle_deg, intensity in ((-5.0, 20.0), (0.0, 60.0), (5.0, 20.0))
    ]
    inference = Inference(limits=PAPER_RANGE, cues=frozenset({"intensity", "arrival", "lateral"}))
    posterior = inference.posterior(lit, noise_of(lit), particles=8)
    most_informative_deg(posterior, [0.0], limits=PAPER_RANGE, floor=4.0)
