"""What the samples of a search say together, and which answer they prove.

`Analysis` has the noise, the sources, what may still hide, and whether the curve fits; `answer_of` makes of it `Found`,
`NotFound`, `Ambiguous`, `AtBound` or `Unsure`.

The posterior predicts the intensity of a sample: that of the markers drawn from it, ln A + ln S(t). The spread of the
prediction is theirs, the error of the curve (`symmetry.TEMPLATE_SIGMAS`), the laser's, and noise, added as squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, Literal

import numpy as np
from scipy.special import ndtr, ndtri

from markerseek.core import (
    MAX_ARRIVALS,
    MAX_INTENSITY,
    MIN_INTENSITY,
    Ambiguous,
    AtBound,
    Displacement,
    Estimate,
    Float64,
    Found,
    Interval,
    MarkerCurve,
    MarkerMotion,
    NotFound,
    Sample,
    Tolerance,
    displacement_sigmas,
    undisplaced,
)
from markerseek.search.curve import log_curve
from markerseek.search.evidence import (
    KNOWN_SIGMA_DEG,
    UNKNOWN_RATIO,
    beyond_tolerance,
    inconsistency,
    marker_radius_m,
    why_not_detected,
    with_half_width,
)
from markerseek.search.floor import MAX_CELLS, SearchNoise, above_background, noise_above_background
from markerseek.search.posterior.angle_posterior import AnglePosterior, modes_deg
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.likelihood import FAR_TAIL, FAR_TAIL_ERROR, displaced_sigma_deg, radius_m
from markerseek.search.posterior.sources import (
    BESIDE_DEG,
    RIVAL_DB,
    Candidate,
    SourceSamples,
    as_upper_limit,
    asymmetric_sample,
    dip_deg,
    gap_angle_deg,
    is_background,
    is_burst,
    outliers_of,
    samples_at,
    sources_of,
    suspect_level,
    times_seen,
)
from markerseek.search.posterior.survey import (
    NARROW_DEG,
    STATED,
    USUAL_KNEE,
    USUAL_TAIL,
    ExpectedAngle,
    Survey,
    hidden_probability,
    missed_marker,
    survey_of,
)
from markerseek.search.posterior.symmetry import TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS

MAX_OTHERS = MAX_ARRIVALS - 1
"""Most sources beside the strongest that get a posterior, the strongest first: as many as a frame lists."""

MEASURED_SHARE = 0.5
"""Distance of a sample from a source, over the full width of its curve, up to which the source has been measured: there
the curve has half of its height."""

STRONGER_SIGMAS = 2.0
"""Standard deviations of the ratio of two strengths by which one must exceed the other to be the stronger."""

PARTICLES = 48
UNDETECTED_PARTICLES = 4000
"""Markers that are drawn from the posterior to choose the next angle: once one is detected, and before."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How well the centre of the strongest source's curve is known."""

    mean_deg: float
    sigma_deg: float
    """``mean_deg`` and ``sigma_deg``: mean and standard deviation of the centre's angle."""
    fwhm_deg: float
    """Full width of the curve at half maximum."""
    target_deg: float
    """Standard deviation with which it is known well enough."""


class Analysis:
    """Samples with the laser on and off, and what follows from them, each part computed when it is first asked for.

    ``lit``: samples with the laser on, at least one. ``inference``: that of the strongest source before the newest
    samples, which is left as it is; `grown` is the one after them. ``single``: whether there is one source at most:
    then a dip does not divide its samples. ``expected``: prior over the angle; None: no prior.
    """

    def __init__(
        self,
        lit: Sequence[Sample],
        dark: Sequence[Sample],
        *,
        inference: Inference,
        limits: Interval,
        single: bool,
        expected: ExpectedAngle | None = None,
    ) -> None:
        self._displacements = [sample.displacement for sample in lit if sample.displacement is not None]
        self._measured = undisplaced(lit)
        self.limits = limits
        self._dark = dark
        self._inference = inference
        self._single = single
        self._expected = expected

    @cached_property
    def noise(self) -> SearchNoise:
        """Noise, its floor, and the background."""
        return noise_above_background(self._measured, dark=self._dark)

    @cached_property
    def _above(self) -> Sequence[Sample]:
        """Samples with the laser on, above the background."""
        return above_background(self._measured, self.noise.background)

    @cached_property
    def outliers(self) -> Sequence[Sample]:
        """Samples that are left out."""
        level = self.noise.floor.level
        return [] if level is None else outliers_of(self._above, level=level)

    @cached_property
    def lit(self) -> Sequence[Sample]:
        """Samples with the laser on, above the background, without outliers."""
        return [sample for sample in self._above if sample not in self.outliers] if self.outliers else self._above

    @property
    def measured_deg(self) -> list[float]:
        """Angles of the samples."""
        return [sample.angle_deg for sample in self._measured]

    @property
    def detected(self) -> bool:
        """Whether a sample exceeds the detection threshold; where that is unknown, whether one stands out."""
        intensities = [sample.reading.intensity for sample in self.lit]
        level = self.noise.floor.level
        if level is None:
            return len(intensities) > 1 and max(intensities) > UNKNOWN_RATIO / 3 * min(intensities)
        return max(intensities) > level

    @cached_property
    def _groups(self) -> list[SourceSamples]:
        """The samples of each source, that of the strongest sample first."""
        groups: list[SourceSamples] = []
        # Without "lateral" all samples are of one source.
        if "lateral" in self._inference.cues and self.noise.floor.level is not None:
            places = sources_of(self.lit, level=suspect_level(self.lit, self.noise))
            for place in places:
                own, bounds = samples_at(self.lit, places, place)
                if not is_burst(own, bounds, place, self.noise):
                    groups += self._divided(SourceSamples(source=place, samples=own, bounds=bounds))
        if not groups:
            groups = self._divided(SourceSamples(source=None, samples=self.lit))
        return sorted(groups, key=lambda group: -max(sample.reading.intensity for sample in group.samples))

    def _divided(self, group: SourceSamples) -> list[SourceSamples]:
        """Return the group, or its peaks if dips lie between them."""
        sigma = self.noise.sigma or min(sample.reading.intensity for sample in group.samples) / 4
        dip = dip_deg(group.samples, sigma=sigma, level=self.noise.level_or_zero, single=self._single)
        if dip is None:
            return [group]
        low = [sample for sample in group.samples if sample.angle_deg < dip]
        high = [sample for sample in group.samples if sample.angle_deg > dip]
        middle = [as_upper_limit(sample) for sample in group.samples if sample.angle_deg == dip]
        parts: list[SourceSamples] = []
        for side, own, other in (("low", low, high), ("high", high, low)):
            # Beyond the dip a curve is no higher than what was measured of both.
            bounds = [*middle, *group.bounds, *map(as_upper_limit, other)]
            parts += self._divided(replace(group, side=(*group.side, side), samples=own, bounds=bounds))
        return parts

    @property
    def first(self) -> Candidate:
        """The source of the strongest arrival that is evidence of one."""
        return self._strongest[0]

    @property
    def grown(self) -> Inference:
        """The inference with the samples of that source."""
        return self._strongest[1]

    @cached_property
    def _strongest(self) -> tuple[Candidate, Inference]:
        """The first source, and the inference with its samples."""
        inference = self._inference.copy()
        particles = PARTICLES if self.detected else UNDETECTED_PARTICLES
        for group in self._groups:
            # A background that is the same at all angles may be stronger than the marker.
            if self._why_missing(group) is None:
                return self._candidate(group, None, inference, particles), inference
        # Before a source exceeds the noise, and where there are no positions, all samples count together.
        everything = SourceSamples(source=None, samples=self.lit)
        return self._candidate(everything, self._why_missing(everything), inference, particles), inference

    @cached_property
    def sources(self) -> list[Candidate]:
        """All sources, the strongest first, `MAX_OTHERS` beside the first at most.

        Candidates that may be no source, such as a burst in one frame, say what is missing.
        """
        first = self.first
        if not self.detected:
            return [first]
        others: list[Candidate] = []
        for group in self._groups:
            # Where no place is evidence, all samples count together already.
            counted = (group.source, group.side) == (first.source, first.side) or (
                first.source is None and group.source is not None
            )
            if counted or is_background(group.samples):
                continue
            missing = self._why_missing(group)
            if missing is None and times_seen(group.samples, self.noise) < 2:
                missing = "it was seen in one acquisition only"
            # Of a new inference each: what an answer computes of the others must not change what comes later.
            others.append(self._candidate(group, missing, self._inference.anew(), PARTICLES))
            if len(others) == MAX_OTHERS:
                break
        return ranked([first, *others])

    def _why_missing(self, group: SourceSamples) -> str | None:
        return why_not_detected([*group.samples, *group.bounds], dark=self._dark, noise=self.noise)

    def _candidate(self, group: SourceSamples, missing: str | None, inference: Inference, particles: int) -> Candidate:
        posterior = inference.posterior(group.samples, self.noise, particles=particles, bounds=group.bounds)
        here_deg = self.limits.nearest(posterior.mean_deg)
        near_deg = MEASURED_SHARE * posterior.fwhm_deg
        at = (*group.samples, *group.bounds)
        there = [each.reading.intensity for each in at if abs(each.angle_deg - here_deg) <= near_deg]
        beyond = here_deg != posterior.mean_deg
        height = max(there, default=0.0) / posterior.sigma
        return Candidate(
            source=group.source,
            side=group.side,
            samples=group.samples,
            bounds=group.bounds,
            missing=missing,
            posterior=posterior,
            seen=times_seen(group.samples, self.noise),
            beyond=beyond,
            measured=bool(there),
            # There the curve has half of its height at least.
            log_most=math.log(2 * height) if height > 0 and not beyond else math.inf,
        )

    @property
    def motion(self) -> MarkerMotion:
        """What was seen of the motion of the strongest source."""
        first = self.sources[0]
        motion = first.posterior.motion
        sigma_deg = first.posterior.moved_sigma_deg
        from_axis_m = radius_m(max(first.samples, key=lambda sample: sample.reading.intensity).reading.depth_m)
        return MarkerMotion(
            lateral_mm=None if motion is None or motion.lateral_m is None else 1e3 * motion.lateral_m,
            depth_mm=None if motion is None or motion.depth_m is None else 1e3 * motion.depth_m,
            turn_sigma_mm=1e3 * from_axis_m * math.radians(sigma_deg),
            cameras_mm=_amplitude_mm(self._displacements) if self._displacements else None,
            left_mm=_left_mm(first.samples),
            period_s=None if motion is None else motion.period_s,
            turn_looked_at=first.posterior.measured_again,
        )

    @property
    def lasts_s(self) -> float | None:
        """Time from the first sample to the last; None if their frames do not tell it."""
        times_s = [each.frame.header.started_s for each in self._measured if each.frame is not None]
        return max(times_s) - min(times_s) if len(times_s) > 1 else None

    @cached_property
    def survey(self) -> Survey | None:
        """What may still hide beside the strongest source; None if not known."""
        if self.sources[0].missing is not None or self._single:
            return None
        return survey_of(self.sources[0], self.lit, self.noise, limits=self.limits, expected=self._expected)

    @cached_property
    def misfit(self) -> str | None:
        """Result of `predictive_check` for the strongest source."""
        return predictive_check(self.sources[0], self.measured_deg, limits=self.limits)

    @cached_property
    def inconsistency(self) -> str | None:
        """Why the strongest source is not where the samples are largest; None of sources that have places."""
        first = self.sources[0]
        if first.has_positions:
            return None
        return inconsistency(
            self.lit,
            mean_deg=self.limits.nearest(first.posterior.mean_deg),
            noise=self.noise,
            relative_error=first.posterior.sample_error,
        )

    @cached_property
    def unresolved_rival(self) -> tuple[Candidate, float | None] | None:
        """A source that may still be the marker, as of the function of this name; None without one."""
        # Of a single source the strongest is the marker.
        by_db = 0.0 if self._single else -RIVAL_DB
        return unresolved_rival(self.sources, self.measured_deg, limits=self.limits, by_db=by_db)

    def asymmetric_deg(self, source: Candidate) -> float | None:
        """Return the next angle to test the curve of a source that has no places, in degrees; None if none is left."""
        if source.has_positions:
            return None
        found = asymmetric_sample(
            source.samples,
            centre_deg=source.posterior.mean_deg,
            sigma=self.noise.sigma_or_zero,
            level=self.noise.level_or_zero,
        )
        return None if found is None else gap_angle_deg(found.angle_deg, self.measured_deg)


def _amplitude_mm(displacements: Sequence[Displacement]) -> float:
    """Return half of the way of displacements: along the line on which most of it lies."""
    place_mm = np.array([each.mm for each in displacements])
    if not place_mm.any():
        # Their direction is not known: that the tissue was at rest in one of them is assumed.
        return 0.5 * math.sqrt(max(float(np.trace(each.covariance_mm2)) for each in displacements))
    away_mm = place_mm - place_mm.mean(axis=0)
    # The eigenvector of the largest eigenvalue.
    line = np.linalg.eigh(away_mm.T @ away_mm)[1][:, -1]
    return 0.5 * float(np.ptp(away_mm @ line))


def _left_mm(samples: Sequence[Sample]) -> float:
    """Return what cameras leave open along the turn, a standard deviation: the mean, the strongest samples most."""
    intensity = np.array([sample.reading.intensity for sample in samples])
    if not intensity.any():
        return 0.0
    # Over the largest one, whose square may be no number.
    weight = (intensity / intensity.max()) ** 2
    left_mm = np.array([1e3 * displacement_sigmas(sample).turn_m for sample in samples])
    return float(weight @ left_mm / weight.sum())


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


UNRESOLVED_BEYOND = 0.1
"""Probability of lying beyond an end of the range from which an uncertain angle is answered as `AtBound`."""

RIVAL_SIGMAS = 1.0
"""Standard deviations of the ratio of two strengths within which a source is a rival: at two, one 10 dB weaker was."""

GAP_ANGLES = 41
"""Places of a hidden top that are tried in a gap."""

SHOULDER_SHARE = 0.5
"""Share of its strongest sample from which others may lie on a shoulder beside the top of a source."""


def ranked(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources, the strongest first.

    Those whose angle or existence is not known come last, but for one that was measured and is far stronger than any
    whose angle is known.
    """
    # While a source is only seen from far away, its strength may come out as anything.
    first, *others = sorted(sources, key=lambda each: (each.missing is not None, not each.known, -each.log_snr))
    stronger = [
        each
        for each in others
        if each.missing is None and each.strength_known and not each.beyond and _is_far_stronger(each, first)
    ]
    strongest = max(stronger, key=lambda each: each.log_snr, default=first)
    return [strongest, *(each for each in (first, *others) if each is not strongest)]


def _is_far_stronger(source: Candidate, other: Candidate) -> bool:
    """Return whether a source is so much stronger that the other cannot be the marker."""
    return source.relative_db(other) - RIVAL_SIGMAS * _spread_db(source, other) > RIVAL_DB


def _spread_db(source: Candidate, other: Candidate) -> float:
    """Return the standard deviation of the ratio of two strengths, in dB."""
    return math.hypot(source.log_snr_sigma, other.log_snr_sigma) * 20 / math.log(10)


def rivals_of(sources: Sequence[Candidate]) -> list[Candidate]:
    """Return the sources that may be the marker instead of the strongest: about as strong, and at another angle.

    A source whose strength is not known is not among them; it is unresolved.
    """
    first, *others = sources
    present = [each for each in others if each.missing is None and each.strength_known and each.apart_from(first)]
    return [each for each in present if _may_be_as_strong(each, first, by_db=-RIVAL_DB, sigmas=RIVAL_SIGMAS)]


def _may_be_as_strong(source: Candidate, first: Candidate, *, by_db: float, sigmas: float = STRONGER_SIGMAS) -> bool:
    """Return whether a source may be the marker instead of the strongest.

    A source beyond an end of the range counts with the strength seen in the range, because the marker is in the range.
    """
    if source.beyond:
        seen = max(sample.reading.intensity for sample in source.samples) / source.posterior.sigma
        return seen > math.exp(first.log_snr) * 10 ** (by_db / 20)
    return source.relative_db(first) + sigmas * _spread_db(source, first) > by_db


def unresolved_rival(
    sources: Sequence[Candidate], measured_deg: Sequence[float], *, limits: Interval, by_db: float = -RIVAL_DB
) -> tuple[Candidate, float | None] | None:
    """Return a source that may still be the marker, because too little is known of it; None without one.

    With it comes the angle at which its top may have been missed, in degrees; None if not known.

    ``sources``: the sources, the strongest first. ``measured_deg``: angles measured so far. ``by_db``: strength over
    the strongest from which one is a rival, in dB.
    """
    first, *others = sources
    for each in others:
        # At the angle of the strongest it does not matter which of the two is the marker.
        if each.measured and not each.apart_from(first):
            continue
        top_deg = missed_peak_deg(first, each, measured_deg, limits=limits, by_db=by_db)
        if top_deg is not None or (not each.known and _may_be_as_strong(each, first, by_db=by_db)):
            return each, top_deg
    return None


def missed_peak_deg(
    first: Candidate, other: Candidate, measured_deg: Sequence[float], *, limits: Interval, by_db: float = -RIVAL_DB
) -> float | None:
    """Return an angle at which a narrow top of another source may have been missed, in degrees; None without one.

    Its strong samples may lie on the flank of a narrow curve, or on the shoulders of it, and its top in a gap beside
    them.

    ``first``, ``other``: the strongest source, and another. ``measured_deg``: angles measured so far. ``by_db``: least
    strength of that top over the strongest, in dB.
    """
    strongest = max(sample.reading.intensity for sample in other.samples)
    strong = [sample for sample in other.samples if sample.reading.intensity >= SHOULDER_SHARE * strongest]
    strong.sort(key=lambda sample: -sample.reading.intensity)
    return top_beside_deg(first, other, strong, measured_deg, limits=limits, by_db=by_db)


def top_beside_deg(
    first: Candidate,
    other: Candidate,
    beside: Sequence[Sample],
    measured_deg: Sequence[float],
    *,
    limits: Interval,
    by_db: float = -RIVAL_DB,
) -> float | None:
    """Return an angle in a gap beside some samples at which a top may have been missed, in degrees; None without one.

    The curve posited there is as narrow as any, no weaker than ``by_db`` over the strongest, and no stronger at either
    end of the gap than what was measured of the source there.

    ``beside``: samples of ``other``.
    """
    log_least = first.log_snr + by_db * math.log(10) / 20
    ends_deg = {1: limits.high_deg, -1: limits.low_deg}
    # A reading of nothing, as in a table with zeros, has no flank of a curve beside it.
    for edge, side in product([each for each in beside if each.reading.intensity > 0], ends_deg):
        beyond = [each for each in measured_deg if side * (each - edge.angle_deg) > 0]
        neighbour_deg = min(beyond, key=lambda each: abs(each - edge.angle_deg), default=ends_deg[side])
        gap_deg = abs(neighbour_deg - edge.angle_deg)
        away_deg = np.linspace(0.0, gap_deg, GAP_ANGLES)
        highest = np.log(edge.reading.intensity) - _narrow(away_deg)
        for there in other.samples:
            if there.angle_deg == neighbour_deg and there.reading.intensity > 0:
                highest = np.minimum(highest, np.log(there.reading.intensity) - _narrow(gap_deg - away_deg))
        hidden = away_deg[highest - math.log(other.posterior.sigma) > log_least]
        if hidden.size:
            angle_deg = edge.angle_deg + side * float(hidden.mean())
            # Beside a sample nothing is hidden, however strong.
            if min(abs(angle_deg - each) for each in measured_deg) > BESIDE_DEG / 2:
                return angle_deg
    return None


def _narrow(away_deg: Float64[np.ndarray, " angles"]) -> Float64[np.ndarray, " angles"]:
    """Return ln of the narrowest usual curve at distances from its top, in degrees."""
    return log_curve(away_deg, fwhm_deg=NARROW_DEG, tail=USUAL_TAIL, knee=USUAL_KNEE)


def answer_of(
    known: Analysis,
    *,
    others: float,
    spent: bool,
    tolerance: Tolerance,
    weaker_than_predicted: str | None,
    more: str = "take more acquisitions",
) -> Estimate:
    """Return the answer.

    ``others``: prior probability that there is another source as strong; 0: nothing else can be the marker. ``spent``:
    whether so many acquisitions are made that what may still hide is stated, and no veto. ``tolerance``: how well the
    angle must be known. ``weaker_than_predicted``: why the acquisition at the angle found does not confirm it; None if
    it does, or was not made. ``more``: how to have more samples than these, for a person.
    """
    first, *seen = known.sources
    posterior = first.posterior
    floor = known.noise.measured_floor
    outliers_deg = tuple(sorted(sample.angle_deg for sample in known.outliers))
    limits = known.limits
    mean_deg = limits.nearest(posterior.mean_deg)
    if first.missing is not None:
        reason = first.missing + missed_marker(known.lit, known.noise, limits)
        return NotFound(mean_deg=mean_deg, reason=reason, floor=floor, outliers_deg=outliers_deg)
    beside = [each.as_other_source(first) for each in seen if each.missing is None and each.strength_known]
    seen_so_far: dict[str, Any] = {
        "sigma_deg": posterior.sigma_deg,
        "interval95_deg": first.interval95_deg,
        "interval_kind": "posterior",
        "floor": floor,
        "others": tuple(sorted(beside, key=lambda each: -each.relative_db)),
        "surveyed": None if known.survey is None else known.survey.surveyed,
        "outliers_deg": outliers_deg,
        "motion": known.motion,
    }
    probability = other_probability(known, others=others)
    # With a prior of a single source, the strongest is the marker. A source that is not known enough may be stronger.
    settled = first.strength_known and (spent or known.unresolved_rival is None)
    rivals = rivals_of(known.sources) if others and settled else []
    side = _side(posterior, limits)
    falls = None if side is None else _falls_before(known, mean_deg=mean_deg)
    # How strong a source beyond an end is cannot be measured: one inside may as well be the marker.
    if side is not None and falls is None and not rivals:
        return AtBound(mean_deg=mean_deg, side=side, **seen_so_far)
    at_rivals = (mean_deg, *(limits.nearest(each.posterior.mean_deg) for each in rivals))
    modes = at_rivals if rivals else modes_deg(posterior, limits=limits)
    # A rival has been measured.
    places = (mean_deg,) if rivals or len(modes) < 2 else modes
    unmeasured = _unmeasured(first, places, known.measured_deg, more=more)
    if unmeasured is None and (rivals or (len(modes) > 1 and others)):
        return Ambiguous(mean_deg=modes[0], modes_deg=modes, **seen_so_far)
    from_axis_m = marker_radius_m(first.samples)
    found = Found(mean_deg=mean_deg, other_probability=probability, curve=_curve(first), **seen_so_far)
    found = with_half_width(found, radius_m=from_axis_m)
    # An answer that is unsure for its width alone is of the marker: registration takes it.
    other = weaker_than_predicted or falls or unmeasured or known.misfit or known.inconsistency
    if other is None and probability > STATED:
        other = _other(known, probability, more=f"{more}{', or state that there is a single source' if others else ''}")
    moves = _moves(known)
    if other is not None:
        return found.as_unsure("source", other if moves is None else f"{moves}; {other}")
    too_wide = beyond_tolerance(found, tolerance, radius_m=from_axis_m)
    if too_wide is None:
        return found
    return found.as_unsure("width", f"{too_wide}; {moves or _cure(posterior, more=more)}")


def _falls_before(known: Analysis, *, mean_deg: float) -> str | None:
    """Return why the strongest source is not at the end of the range, where its curve puts it; None if it may be."""
    first = known.sources[0]
    weaker = inconsistency(
        first.samples, mean_deg=mean_deg, noise=known.noise, relative_error=first.posterior.sample_error
    )
    if weaker is None:
        return None
    return f"{weaker}, and the curve of a marker is wider than that: check unit and scale of the angles"


def _moves(known: Analysis) -> str | None:
    """Return how the marker moves, and what to do about it; None where no motion was seen."""
    motion = known.motion
    if not motion.is_seen:
        return None
    ways = ((motion.depth_mm, "in depth"), (motion.lateral_mm, "along the array"))
    seen = [f"by ± {amplitude_mm:.1f} mm {way}" for amplitude_mm, way in ways if amplitude_mm]
    how = " and ".join(seen) or "along the turn, as the scatter of the samples shows"
    if motion.period_s is not None:
        how += f", about every {motion.period_s:.2g} s"
    lasts_s = known.lasts_s
    hold = "while it is searched for" if lasts_s is None else f"for the {max(lasts_s, 1.0):.0f} s of a search"
    return f"the marker moves {how}: hold the ventilation {hold}, or let cameras follow the tissue"


def _curve(source: Candidate) -> MarkerCurve | None:
    """Return the width and height of a source's curve; None of intensities that no reader returns."""
    peak = source.posterior.sigma * math.exp(source.log_snr)
    if not MIN_INTENSITY <= peak <= MAX_INTENSITY:
        return None
    return MarkerCurve(fwhm_deg=source.posterior.fwhm_deg, peak=peak)


def _cure(posterior: AnglePosterior, *, more: str) -> str:
    """Return what makes the angle better known."""
    if posterior.centre_sigma_deg > posterior.sigma_deg / 2:
        return f"{more} or average more pulses"
    return (
        "more acquisitions will not narrow it: the source is not known to be a point, and a spot may lie beside the "
        "centre of its curve; light or stain a smaller spot, or tolerate more"
    )


def other_probability(known: Analysis, *, others: float) -> float:
    """Return the probability that another source is the marker: one that hides, or a seen one that may be stronger.

    ``others``: prior probability of a second source as strong.
    """
    first, *seen = known.sources
    none = 1.0 - (others if known.survey is None else hidden_probability(known.survey, others=others))
    for each in seen:
        none *= 1.0 - _stronger_probability(each, first)
    if known.unresolved_rival is not None:
        # A source that is not known enough may be as strong as one that was not seen.
        none *= 1.0 - max(others, known.unresolved_rival[0].stronger_probability(first))
    return 1.0 - none


def _unmeasured(source: Candidate, modes: Sequence[float], measured_deg: Sequence[float], *, more: str) -> str | None:
    """Return where the marker may be and was not measured, and what to do about it.

    None if it was measured everywhere.
    """
    near_deg = MEASURED_SHARE * source.posterior.fwhm_deg
    left_deg = [each for each in modes if min(abs(each - at) for at in measured_deg) > near_deg]
    if not left_deg:
        return None
    return f"the marker may be near {' or '.join(f'{each:.1f}' for each in left_deg)} deg, not measured so far; {more}"


def _stronger_probability(source: Candidate, first: Candidate) -> float:
    """Return the probability that a source that was seen is the stronger one of two, and another one at all."""
    if source.missing is not None or not source.apart_from(first):
        return 0.0
    return source.stronger_probability(first) if _may_be_as_strong(source, first, by_db=-RIVAL_DB) else 0.0


def _other(known: Analysis, probability: float, *, more: str) -> str:
    """Return why another source may be the marker, and what to do about it."""
    said = f"the probability that another source is the marker is {100 * probability:.2g} %"
    if known.unresolved_rival is not None:
        return f"{said}: a source near {known.unresolved_rival[0].posterior.mean_deg:.0f} deg may be as strong; {more}"
    first, *seen = known.sources
    stronger = max(seen, key=lambda each: _stronger_probability(each, first), default=first)
    if _stronger_probability(stronger, first) > probability / 2:
        return f"{said}: the source at {stronger.posterior.mean_deg:.1f} deg may be stronger; {more}"
    if known.survey is None:
        return f"{said}: the range has not been surveyed; {more}"
    return (
        f"{said}: only {100 * known.survey.surveyed:.0f} % of the range is checked for a second source as strong, "
        f"which may be missed near {known.survey.hidden_deg:.0f} deg; {more}"
    )


def _side(posterior: AnglePosterior, limits: Interval) -> Literal["low", "high"] | None:
    """Return the end of the range beyond which the marker probably lies, or may lie where its angle is uncertain."""
    least = 0.5 if posterior.sigma_deg <= KNOWN_SIGMA_DEG else UNRESOLVED_BEYOND
    below = float(posterior.probability[posterior.angle_deg < limits.low_deg].sum())
    above = float(posterior.probability[posterior.angle_deg > limits.high_deg].sum())
    if max(below, above) <= least:
        return None
    return "low" if below > above else "high"
