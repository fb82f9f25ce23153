"""The sources of a search with their posteriors: which one is the loudest, and which others there are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from markerseek.core import Interval, MarkerCurve, OtherSource, Sample
from markerseek.search.evidence import FLAT_SHARE, missing_evidence
from markerseek.search.floor import SearchNoise
from markerseek.search.posterior.angle_posterior import AnglePosterior
from markerseek.search.posterior.humps import dip_deg
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.shapes import Shapes
from markerseek.search.posterior.sources import Source, at_most, samples_at, sources_of

MOST_OTHERS = 3
"""Most sources beside the loudest that get a posterior of their own, the strongest first."""

RIVAL_DB = 6.0
"""A source that is weaker by no more than this may be the marker as well, in dB."""

BESIDE_DEG = 1.0
"""Distance at which the narrowest curve still has half of its height, in degrees."""

LOUDER_SIGMAS = 2.0
"""Standard deviations of the ratio of two loudnesses by which one must exceed the other to be the louder."""


Side: TypeAlias = Literal["both", "low", "high"]
"""Samples of one source: all at a place, or those on one side of a dip."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Group:
    """Samples of one source, as they are at its place; see `Candidate`."""

    source: Source | None
    side: Side
    samples: Sequence[Sample]
    bounds: Sequence[Sample] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidate:
    """A source with its posterior.

    Attributes
    ----------
    source
        Its place; None where the samples have no positions: then all of them are of one source.
    side
        Which of two humps at that place it is, "both" where there is one.
    samples
        The samples with the laser on, as they are at its place.
    missing
        Why they are no evidence of a source; None if they are.
    posterior
        Posterior of its angle.
    seen
        Number of samples in which it exceeds the noise.
    """

    source: Source | None
    side: Side
    samples: Sequence[Sample]
    missing: str | None
    posterior: AnglePosterior
    seen: int

    @property
    def loudness(self) -> float:
        """Ln of the intensity with the probe on it, over σ."""
        return float(np.mean(self.posterior.log_snr))

    @property
    def placed(self) -> bool:
        """Whether its samples tell places apart."""
        return all(sample.reading.local_maxima is not None for sample in self.samples)

    @property
    def interval95_deg(self) -> Interval:
        """Interval that holds its angle with 95 % probability."""
        return Interval(low_deg=self.posterior.quantile_deg(0.025), high_deg=self.posterior.quantile_deg(0.975))

    def apart_from(self, other: Candidate) -> bool:
        """Whether the 95 % intervals of two sources are separate."""
        mine, theirs = self.interval95_deg, other.interval95_deg
        return mine.high_deg < theirs.low_deg or theirs.high_deg < mine.low_deg

    def relative_db(self, other: Candidate) -> float:
        """Loudness over that of another source, in dB."""
        return 20 / math.log(10) * (self.loudness - other.loudness)

    def may_exceed(self, other: Candidate, *, by_db: float, sigmas: float = LOUDER_SIGMAS) -> bool:
        """Whether its loudness over the other's may exceed a ratio, in dB, within so many standard deviations of it."""
        spread = math.hypot(float(np.std(self.posterior.log_snr)), float(np.std(other.posterior.log_snr)))
        return self.relative_db(other) + sigmas * spread * 20 / math.log(10) > by_db

    def beside(self, other: Candidate) -> OtherSource:
        """The source as an answer names it beside another."""
        place = self.source
        return OtherSource(
            angle_deg=self.posterior.mean_deg,
            sigma_deg=self.posterior.sigma_deg,
            relative_db=self.relative_db(other),
            lateral_m=None if place is None else place.lateral_m,
            depth_m=None if place is None else place.depth_m,
        )


def _seen(at: Sequence[Sample], noise: SearchNoise) -> int:
    return sum(sample.reading.intensity > (noise.floor.level or 0.0) for sample in at)


def _is_burst(own: Sequence[Sample], bounds: Sequence[Sample], place: Source, noise: SearchNoise) -> bool:
    """Whether a place was loud once, and not beside that angle, where the narrowest curve is."""
    # An upper bound says the same as a sample where it is below the noise floor.
    measured = [*own, *(bound for bound in bounds if bound.reading.intensity <= (noise.floor.level or 0.0))]
    beside = sum(abs(sample.angle_deg - place.angle_deg) <= BESIDE_DEG for sample in measured)
    return beside > 1 and _seen(own, noise) == 1


def _is_background(at: Sequence[Sample]) -> bool:
    """Whether a place is as loud at all angles, as an artefact of the rig is."""
    intensities = [sample.reading.intensity for sample in at]
    return len(at) > 1 and max(intensities) - min(intensities) <= FLAT_SHARE * max(intensities)


class Candidates:
    """The sources of one search; the inference of the strongest grows with the samples.

    Parameters
    ----------
    limits, shapes, prior
        As for `Inference`.
    cues
        Likewise; without "lateral" all samples are of one source.
    single
        Whether there is one source only, so that a dip does not divide the samples.
    """

    def __init__(
        self, *, limits: Interval, shapes: Shapes, cues: frozenset[str], single: bool, prior: MarkerCurve | None
    ) -> None:
        self._limits = limits
        self._shapes = shapes
        self._cues = cues
        self._single = single
        self._prior = prior
        # Only that of the first is kept: what an answer computes of the others must not change what comes later.
        self._first = self._new()

    def groups(self, lit: Sequence[Sample], noise: SearchNoise) -> list[Group]:
        """Return the samples of each source, that of the strongest sample first.

        Parameters
        ----------
        lit
            Samples with the laser on, at least one.
        noise
            Noise of the search.
        """
        groups: list[Group] = []
        if "lateral" in self._cues and noise.floor.level is not None:
            sources = sources_of(lit, level=noise.floor.level)
            for source in sources:
                own, bounds = samples_at(lit, sources, source)
                if not _is_burst(own, bounds, source, noise):
                    groups += self._divided(Group(source=source, side="both", samples=own, bounds=bounds), noise)
        if not groups:
            groups = self._divided(Group(source=None, side="both", samples=lit), noise)
        return sorted(groups, key=lambda group: -_strongest(group.samples))

    def first(
        self,
        groups: Sequence[Group],
        lit: Sequence[Sample],
        dark: Sequence[Sample],
        noise: SearchNoise,
        *,
        particles: int,
    ) -> Candidate:
        """Return the source of the strongest arrival that is evidence of one.

        Parameters
        ----------
        groups
            From `groups`.
        lit, dark
            Samples with the laser on, at least one, and off.
        noise
            Noise of the search.
        particles
            Markers to draw from its posterior.
        """
        for group in groups:
            # A background that is the same at all angles may be louder than the marker, and is none.
            if missing_evidence([*group.samples, *group.bounds], dark=dark, noise=noise) is None:
                return _candidate(group, None, self._first, noise, particles)
        # Before a source exceeds the noise, and where there are no positions, all samples count together.
        everything = Group(source=None, side="both", samples=lit)
        missing = missing_evidence(lit, dark=dark, noise=noise)
        return _candidate(everything, missing, self._first, noise, particles)

    def others(
        self,
        first: Candidate,
        groups: Sequence[Group],
        dark: Sequence[Sample],
        noise: SearchNoise,
        *,
        particles: int,
        most: int,
    ) -> list[Candidate]:
        """Return the sources beside the first, that of the strongest arrival first.

        Some may be none, as a burst that is seen in one frame: what is missing for them to be one is stated.

        Parameters
        ----------
        first
            From `first`.
        groups, dark, noise, particles
            As for `first`.
        most
            Most sources.
        """
        found = []
        for group in groups:
            # Where no place is evidence, all samples count together already.
            counted = (group.source, group.side) == (first.source, first.side) or (
                first.source is None and group.source is not None
            )
            if counted or _is_background(group.samples):
                continue
            missing = missing_evidence([*group.samples, *group.bounds], dark=dark, noise=noise)
            if missing is None and _seen(group.samples, noise) < 2:
                missing = "it was seen in one acquisition only"
            # Of a new inference each: what an answer computes of the others must not change what comes later.
            found.append(_candidate(group, missing, self._new(), noise, particles))
            if len(found) == most:
                break
        return found

    def _divided(self, group: Group, noise: SearchNoise) -> list[Group]:
        """The group, or its two halves where a dip lies between two humps."""
        if self._single:
            return [group]
        sigma = noise.sigma or min(sample.reading.intensity for sample in group.samples) / 4
        dip = dip_deg(group.samples, sigma=sigma, level=noise.floor.level or 0.0)
        if dip is None:
            return [group]
        low = [sample for sample in group.samples if sample.angle_deg < dip]
        high = [sample for sample in group.samples if sample.angle_deg > dip]
        middle = [at_most(sample) for sample in group.samples if sample.angle_deg == dip]
        # Beyond the dip a curve is no higher than what was measured of both.
        middle += group.bounds
        return [
            Group(source=group.source, side="low", samples=low, bounds=[*middle, *map(at_most, high)]),
            Group(source=group.source, side="high", samples=high, bounds=[*middle, *map(at_most, low)]),
        ]

    def _new(self) -> Inference:
        return Inference(limits=self._limits, shapes=self._shapes, cues=self._cues, prior=self._prior)


def _candidate(
    group: Group, missing: str | None, inference: Inference, noise: SearchNoise, particles: int
) -> Candidate:
    return Candidate(
        source=group.source,
        side=group.side,
        samples=group.samples,
        missing=missing,
        posterior=inference.posterior([*group.samples, *group.bounds], noise, particles=particles),
        seen=_seen(group.samples, noise),
    )


def _strongest(at: Sequence[Sample]) -> float:
    return max(sample.reading.intensity for sample in at)
