"""Which source is the marker: the set of candidates, one for each marker, that fits one rigid transform.

A search that answers `ambiguous` names several candidates, and even one that found may have found another source. The
camera has seen where the spots are, so that a wrong candidate does not fit the others. Sets are compared by the product
of the probabilities of their candidates and of their residuals. A marker none of whose candidates fits is left out; it
counts as improbable, so that as few as possible are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from markerseek.core import ConfigError, Float64, MarkerCandidate
from markerseek.geometry import MIN_POINTS
from markerseek.registration.report import PointPair, RegistrationReport, register_pairs

MIN_SHARE = 0.99
"""Least probability, among all sets that fit, of the set that is taken."""

LEFT_OUT = 0.01
"""Probability that none of the candidates of a marker is the marker."""

MOST_CANDIDATES = 4
"""Most candidates of a marker that are tried, the likeliest."""

_MOST_SETS = 600
"""Most sets that are compared, the likeliest first."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenMarker:
    """A marker that was searched, and the spot as the cameras saw it."""

    name: str
    candidates: tuple[MarkerCandidate, ...]
    """Sources that may be it, the likeliest first."""
    camera_m: Float64[np.ndarray, " 3"]
    camera_covariance_m2: Float64[np.ndarray, "3 3"]
    camera_shared_m: Float64[np.ndarray, "3 errors"]
    """``camera_m``, ``camera_covariance_m2`` and ``camera_shared_m``: the spot, as `seen_point` gives it."""

    def pair(self, candidate: int) -> PointPair:
        """The point with one of the candidates."""
        position = self.candidates[candidate].position
        return PointPair(
            name=self.name,
            trus_m=np.array(position.position_m),
            camera_m=self.camera_m,
            trus_covariance_m2=position.covariance_m2,
            camera_covariance_m2=self.camera_covariance_m2,
            camera_shared_m=self.camera_shared_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Choice:
    """What the markers say together."""

    report: RegistrationReport | None
    """The registration by the chosen candidates; None where no set fits, or there are too few markers."""
    chosen: Mapping[str, int]
    """Number of the candidate of each marker that was chosen."""
    left_out: tuple[str, ...] = ()
    """Markers none of whose candidates fits."""
    share: float = 1.0
    """Probability of that set among all that fit."""
    open: tuple[str, ...] = ()
    """Markers of which another candidate, or their leaving out, is too probable still: more markers decide."""
    reason: str | None = None
    """Why there is no registration, or not for certain; None where there is."""

    @property
    def decided(self) -> bool:
        """Whether there is a registration whose set is certain enough."""
        return self.report is not None and self.report.registered and self.share >= MIN_SHARE


def choose(markers: Sequence[SeenMarker], *, target_trus_m: tuple[float, float, float] | None = None) -> Choice:
    """Choose the candidates that fit one rigid transform.

    ``target_trus_m``: where the error is wanted, as of `register_pairs`.
    """
    useful = [marker for marker in markers if marker.candidates]
    first = {marker.name: 0 for marker in useful}
    if len(useful) < MIN_POINTS:
        return Choice(report=None, chosen=first, reason=f"{len(useful)} of {MIN_POINTS} markers")
    fits: list[_Fit] = []
    problem = ""
    # As few markers as possible are left out: one more only where no set without it fits.
    for left_out in range(_most_left_out(len(useful)) + 1):
        for numbers in _sets(useful, left_out=left_out):
            pairs = [marker.pair(number) for marker, number in zip(useful, numbers, strict=True) if number is not None]
            try:
                report = register_pairs(pairs, target_trus_m=target_trus_m)
            except ConfigError as refusal:
                problem = problem or str(refusal)
                continue
            fits.append(_Fit(numbers=numbers, report=report, log=_log_probability(useful, numbers, report)))
        if any(fit.report.registered for fit in fits):
            break
    if not fits:
        return Choice(report=None, chosen=first, reason=problem)
    fitting = sorted((fit for fit in fits if fit.report.registered), key=lambda fit: -fit.log)
    if not fitting:
        best = max(fits, key=lambda fit: fit.log)
        return Choice(report=best.report, chosen=_chosen(useful, best.numbers), reason=best.report.reason)
    best, *others = fitting
    share = 1 / (1 + sum(math.exp(other.log - best.log) for other in others))
    chosen = _chosen(useful, best.numbers)
    rivals = [other for other in others if other.log - best.log > math.log(1 - MIN_SHARE) - math.log(len(others))]
    unsure = {
        marker.name
        for rival in rivals
        for marker, mine, theirs in zip(useful, best.numbers, rival.numbers, strict=True)
        if mine != theirs
    }
    left = tuple(marker.name for marker, number in zip(useful, best.numbers, strict=True) if number is None)
    undecided = tuple(sorted(unsure)) if share < MIN_SHARE else ()
    reason = None
    if share < MIN_SHARE:
        named = f"marker {' or '.join(undecided)}"
        reason = f"{named} may be another source ({100 * (1 - share):.0f} %): one more marker decides"
    return Choice(report=best.report, chosen=chosen, left_out=left, share=share, open=undecided, reason=reason)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    numbers: tuple[int | None, ...]
    report: RegistrationReport
    log: float


def _most_left_out(count: int) -> int:
    """Most markers that may be left out: three more must agree, and most of all."""
    return 0 if count <= MIN_POINTS else max(1, (count - MIN_POINTS) // 2)


def _sets(markers: Sequence[SeenMarker], *, left_out: int) -> list[tuple[int | None, ...]]:
    """Sets of candidates that leave a number of markers out, the likeliest of them."""
    sets: list[tuple[int | None, ...]] = []
    for missing in combinations(range(len(markers)), left_out):
        choices: list[list[int | None]] = [
            [None] if index in missing else list(range(min(len(marker.candidates), MOST_CANDIDATES)))
            for index, marker in enumerate(markers)
        ]
        sets += product(*choices)
    return sorted(sets, key=lambda numbers: -_log_prior(markers, numbers))[:_MOST_SETS]


def _log_prior(markers: Sequence[SeenMarker], numbers: Sequence[int | None]) -> float:
    """Logarithm of the probability of a set before the camera is asked."""
    shares = [
        LEFT_OUT if number is None else marker.candidates[number].probability
        for marker, number in zip(markers, numbers, strict=True)
    ]
    return sum(math.log(max(share, 1e-12)) for share in shares)


def _log_probability(markers: Sequence[SeenMarker], numbers: Sequence[int | None], report: RegistrationReport) -> float:
    """Logarithm of the probability of a set with its residuals, but for a constant."""
    used = sum(number is not None for number in numbers)
    chi_squared = report.misfit * (3 * used - 6)
    return _log_prior(markers, numbers) - chi_squared / 2


def _chosen(markers: Sequence[SeenMarker], numbers: Sequence[int | None]) -> dict[str, int]:
    return {marker.name: number for marker, number in zip(markers, numbers, strict=True) if number is not None}
