"""What the samples of a search say together: noise, sources, what may still hide, and whether the curve fits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from markerseek.core import MAX_ARRIVALS, Displacement, Interval, MarkerMotion, Sample, displacement_sigmas, undisplaced
from markerseek.search.evidence import UNKNOWN_RATIO, inconsistency, why_not_detected
from markerseek.search.floor import SearchNoise, above_background, noise_above_background
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.likelihood import radius_m
from markerseek.search.posterior.prediction import predictive_check
from markerseek.search.posterior.rivals import ranked, unresolved_rival
from markerseek.search.posterior.sources import (
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
from markerseek.search.posterior.survey import ExpectedAngle, Survey, survey_of

MAX_OTHERS = MAX_ARRIVALS - 1
"""Most sources beside the strongest that get a posterior, the strongest first: as many as a frame lists."""

MEASURED_SHARE = 0.5
"""Distance of a sample from a source, over the full width of its curve, up to which the source has been measured: there
the curve has half of its height."""

PARTICLES = 48
UNDETECTED_PARTICLES = 4000
"""Markers that are drawn from the posterior to choose the next angle: once one is detected, and before."""


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
