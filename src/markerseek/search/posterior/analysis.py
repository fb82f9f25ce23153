"""What the samples of a search say together: its noise, its sources, and what may still hide beside them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, partial

from markerseek.core import Interval, Sample
from markerseek.search.evidence import UNKNOWN_RATIO
from markerseek.search.floor import SearchNoise, noise_of
from markerseek.search.posterior.answer import SearchState, ranked, top_beside_deg, unresolved_rival
from markerseek.search.posterior.candidates import BESIDE_DEG, RIVAL_DB, Candidate, Candidates, SourceSamples
from markerseek.search.posterior.humps import asymmetric_sample, gap_angle_deg
from markerseek.search.posterior.predictive import DOUBT_SIGMAS, discrepant_sample, predictive_check
from markerseek.search.posterior.shapes import Shapes
from markerseek.search.posterior.survey import Survey, survey_of

PARTICLES, UNDETECTED_PARTICLES = 48, 4000
"""Markers that are drawn from the posterior to choose the next angle: once one is detected, and before."""


class Analysis:
    """Samples with the laser on and off, and what follows from them, each part computed when it is first asked for."""

    def __init__(
        self,
        lit: Sequence[Sample],
        dark: Sequence[Sample],
        *,
        candidates: Candidates,
        shapes: Shapes,
        limits: Interval,
        single: bool,
    ) -> None:
        self._lit, self._dark = lit, dark
        self._candidates, self._shapes, self._limits, self._single = candidates, shapes, limits, single

    @property
    def measured_deg(self) -> list[float]:
        """Angles of the samples."""
        return [sample.angle_deg for sample in self._lit]

    @cached_property
    def noise(self) -> SearchNoise:
        """Noise and its floor."""
        return noise_of(self._lit, dark=self._dark)

    @property
    def detected(self) -> bool:
        """Whether a sample exceeds the noise floor; where that is unknown, whether one stands out."""
        intensities = [sample.reading.intensity for sample in self._lit]
        level = self.noise.floor.level
        if level is None:
            return len(intensities) > 1 and max(intensities) > UNKNOWN_RATIO / 3 * min(intensities)
        return max(intensities) > level

    @cached_property
    def _groups(self) -> list[SourceSamples]:
        return self._candidates.groups(self._lit, self.noise)

    @cached_property
    def first(self) -> Candidate:
        """The source of the strongest arrival."""
        return self._candidates.first(
            self._groups,
            self._lit,
            self._dark,
            self.noise,
            particles=PARTICLES if self.detected else UNDETECTED_PARTICLES,
        )

    @cached_property
    def state(self) -> SearchState:
        """All sources in their order, and what is known of others."""
        sources = [self.first]
        if self.detected:
            others = self._candidates.others(self.first, self._groups, self._dark, self.noise, particles=PARTICLES)
            sources = ranked([self.first, *others])
        # Of a single source the loudest is the marker.
        by_db = 0.0 if self._single else -RIVAL_DB
        rival = unresolved_rival(sources, self.measured_deg, limits=self._limits, by_db=by_db)
        return SearchState(
            noise=self.noise,
            sources=sources,
            survey=self._survey(sources[0]),
            misfit=predictive_check(sources[0], self._shapes, closed=partial(self._closed, sources[0])),
            unresolved_rival=rival,
        )

    def _survey(self, source: Candidate) -> Survey | None:
        """What may still hide beside a source."""
        if source.missing is not None or self._single:
            return None
        return survey_of(source, self._shapes, self._lit, self.noise, limits=self._limits)

    def _closed(self, source: Candidate, sample: Sample) -> bool:
        """Whether the top of a second source as loud has no room beside a sample."""
        return self._top_beside_deg(source, sample) is None

    def _top_beside_deg(self, source: Candidate, sample: Sample) -> float | None:
        return top_beside_deg(source, source, [sample], self.measured_deg, limits=self._limits)

    def doubtful_deg(self, source: Candidate) -> float | None:
        """Next angle to test the curve of a source, in degrees; None if none is left."""
        centre_deg = source.posterior.mean_deg
        doubtful = discrepant_sample(source, self._shapes, sigmas=DOUBT_SIGMAS, closed=partial(self._closed, source))
        if doubtful is not None:
            # Between a second hump and the first lies a dip.
            between_deg = (doubtful.angle_deg + centre_deg) / 2
            if between_deg in self._limits and min(abs(each - between_deg) for each in self.measured_deg) > BESIDE_DEG:
                return between_deg
            # Beside it, where the top of a source as loud has room.
            top_deg = self._top_beside_deg(source, doubtful)
            if top_deg is not None:
                return top_deg
        if source.has_positions:
            return None
        hump = asymmetric_sample(
            source.samples, centre_deg=centre_deg, sigma=self.noise.sigma_or_zero, level=self.noise.level_or_zero
        )
        return None if hump is None else gap_angle_deg(hump.angle_deg, self.measured_deg)
