"""What the samples of a search say together: its noise, its sources, what may still hide, and whether the curve fits.

The posterior predicts the intensity of a sample: that of the markers drawn from it, ln A + ln S(t). The spread of the
prediction is theirs, the error of the curve (`symmetry.TEMPLATE_SIGMAS`), the laser's, and noise, added as squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr, ndtri

from markerseek.core import Float64, Interval, Sample
from markerseek.search.evidence import UNKNOWN_RATIO
from markerseek.search.floor import MAX_CELLS, SearchNoise, noise_of
from markerseek.search.posterior.answer import SearchState, ranked, top_beside_deg, unresolved_rival
from markerseek.search.posterior.candidates import (
    RIVAL_DB,
    Candidate,
    Candidates,
    SourceSamples,
    asymmetric_sample,
    gap_angle_deg,
)
from markerseek.search.posterior.expected import ExpectedAngle
from markerseek.search.posterior.inference import AnglePosterior
from markerseek.search.posterior.likelihood import DEEP, DEEP_ERROR
from markerseek.search.posterior.shapes import Shapes
from markerseek.search.posterior.sources import samples_at
from markerseek.search.posterior.survey import Survey, survey_of
from markerseek.search.posterior.symmetry import TEMPLATE_LOG_LEVELS, TEMPLATE_SIGMAS

PARTICLES, UNDETECTED_PARTICLES = 48, 4000
"""Markers that are drawn from the posterior to choose the next angle: once one is detected, and before."""

PREDICTION_SIGMAS = 3.0
"""Standard deviations of the prediction by which a confirmation may be weaker."""

MISFIT_SIGMAS, USUAL_SAMPLES = 2.5, 12
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
        expected: ExpectedAngle | None = None,
    ) -> None:
        self.lit, self._dark, self._expected = lit, dark, expected
        self._candidates, self._shapes, self._limits, self._single = candidates, shapes, limits, single

    @property
    def measured_deg(self) -> list[float]:
        """Angles of the samples."""
        return [sample.angle_deg for sample in self.lit]

    @cached_property
    def noise(self) -> SearchNoise:
        """Noise and its floor."""
        return noise_of(self.lit, dark=self._dark)

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
        return self._candidates.groups(self.lit, self.noise)

    @cached_property
    def first(self) -> Candidate:
        """The source of the strongest arrival."""
        return self._candidates.first(
            self._groups,
            self.lit,
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
            misfit=predictive_check(sources[0], self._shapes, self.measured_deg, limits=self._limits),
            unresolved_rival=rival,
        )

    def _survey(self, source: Candidate) -> Survey | None:
        """What may still hide beside a source."""
        if source.missing is not None or self._single:
            return None
        return survey_of(source, self._shapes, self.lit, self.noise, limits=self._limits, expected=self._expected)

    def asymmetric_deg(self, source: Candidate) -> float | None:
        """Next angle to test the curve of a source that has no places, in degrees; None if none is left."""
        if source.has_positions:
            return None
        hump = asymmetric_sample(
            source.samples,
            centre_deg=source.posterior.mean_deg,
            sigma=self.noise.sigma_or_zero,
            level=self.noise.level_or_zero,
        )
        return None if hump is None else gap_angle_deg(hump.angle_deg, self.measured_deg)


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


def predictive_check(
    source: Candidate, shapes: Shapes, measured_deg: Sequence[float], *, limits: Interval
) -> str | None:
    """Return why the curve of a source does not explain its samples, in words; None if the curve does.

    ``measured_deg``: angles measured so far, in degrees.
    """
    height, spread = _prediction(source.posterior, shapes, source.samples)
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
    posterior: AnglePosterior, shapes: Shapes, samples: Sequence[Sample]
) -> tuple[Float64[np.ndarray, " samples"], Float64[np.ndarray, " samples"]]:
    """Intensity that a posterior predicts of samples, and its standard deviation."""
    log_height = posterior.log_heights(shapes, np.array([sample.angle_deg for sample in samples]))
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
