"""Which source is the marker: the set of candidates, one for each marker, that fits one rigid transform.

A search that answers `ambiguous` names several candidates, and even one that found may have found another source. The
camera has seen where the spots are, so that a wrong candidate does not fit the others. Most sets are ruled out by the
distances between their points, which no rigid transform changes; the others are registered, and compared by the product
of the probabilities of their candidates and of their residuals. A marker none of whose candidates fits is left out; it
counts as improbable, so that as few as possible are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.special import chdtri

from markerseek.core import ConfigError, Float64, MarkerCandidate
from markerseek.geometry import MIN_POINTS
from markerseek.registration.report import (
    MIN_PROBABILITY,
    PointPair,
    RegistrationReport,
    motion_m,
    register_pairs,
    registered_pairs,
)
from markerseek.registration.shared_errors import trus_shared_m

MIN_SHARE = 0.99
"""Least probability, among all sets that fit, of the set that is taken."""

LEFT_OUT = 0.01
"""Probability that none of the candidates of a marker is the marker."""

MOST_CANDIDATES = 4
"""Most candidates of a marker that are tried, the likeliest."""

_MOST_SETS = 60
"""Most sets that are registered, the likeliest first."""

_MOST_APART = 1.5
"""Factor of the largest chi squared of a registration that is accepted, beyond which one distance rules a set out."""


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
    camera_motion_m: Float64[np.ndarray, "3 motions"] | None = None
    """Displacements of the spot by the errors of the motions by which it was carried; None: by none."""

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
            camera_motion_m=self.camera_motion_m,
        )


class Choice(msgspec.Struct, frozen=True, kw_only=True):
    """Registration from all markers."""

    report: RegistrationReport | None
    """The registration by the chosen candidates; None if no set fits, or there are too few markers."""
    decided: bool
    """Whether the registration is accepted, and its set is certain enough."""
    chosen: dict[str, int]
    """Number of the candidate of each marker that was chosen, by name."""
    left_out: tuple[str, ...] = ()
    """Markers none of whose candidates fits."""
    open: tuple[str, ...] = ()
    """Markers for which another candidate, or none, is still too probable; more markers decide."""
    reason: str | None = None
    """Why there is no registration, or not for certain; None if there is."""


def choose(markers: Sequence[SeenMarker], *, target_trus_m: tuple[float, float, float] | None = None) -> Choice:
    """Choose the candidates that fit one rigid transform.

    ``target_trus_m``: where the error is wanted, as of `register_pairs`.
    """
    useful = [marker for marker in markers if marker.candidates]
    first = {marker.name: 0 for marker in useful}
    if len(useful) < MIN_POINTS:
        return Choice(report=None, decided=False, chosen=first, reason=f"{len(useful)} of {MIN_POINTS} markers")
    fits: list[tuple[float, dict[str, int]]] = []
    """Sets that fit, and the logarithm of their probability but for a constant."""
    problem = ""
    apart = _distance_misfits(useful)
    # Three more must agree, and most of all.
    most_left_out = 0 if len(useful) == MIN_POINTS else max(1, (len(useful) - MIN_POINTS) // 2)
    # As few markers as possible are left out: one more only where no set without it fits.
    for left_out in range(most_left_out + 1):
        for chosen in _sets(useful, apart, left_out=left_out):
            try:
                found = registered_pairs(chosen_pairs(useful, chosen))
            except ConfigError as refusal:
                problem = problem or str(refusal)
                continue
            if found.probability >= MIN_PROBABILITY:
                chi_squared = found.misfit * (3 * len(found.residuals_m) - 6)
                fits.append((_log_prior(useful, chosen) - chi_squared / 2, chosen))
        if fits:
            break
    if not fits:
        return _unfit(useful, first, problem, target_trus_m)
    (best_log, best), *others = sorted(fits, key=lambda fit: -fit[0])
    share = 1 / (1 + sum(math.exp(log - best_log) for log, _ in others))
    report = register_pairs(chosen_pairs(useful, best), target_trus_m=target_trus_m)
    left = tuple(name for name in first if name not in best)
    if share >= MIN_SHARE:
        return Choice(report=report, decided=report.registered, chosen=best, left_out=left)
    rivals = [other for log, other in others if log - best_log > math.log(1 - MIN_SHARE) - math.log(len(others))]
    unsure = tuple(sorted(name for name in first if any(best.get(name) != rival.get(name) for rival in rivals)))
    reason = f"marker {' or '.join(unsure)} may be another source ({100 * (1 - share):.0f} %): one more marker decides"
    return Choice(report=report, decided=False, chosen=best, left_out=left, open=unsure, reason=reason)


def _unfit(
    useful: Sequence[SeenMarker],
    first: dict[str, int],
    problem: str,
    target_trus_m: tuple[float, float, float] | None,
) -> Choice:
    """Message if no set fits: why the most probable candidates do not."""
    try:
        report = register_pairs(chosen_pairs(useful, first), target_trus_m=target_trus_m)
    except ConfigError as refusal:
        return Choice(report=None, decided=False, chosen=first, reason=problem or str(refusal))
    return Choice(report=report, decided=report.registered, chosen=first, reason=report.reason)


def _sets(
    markers: Sequence[SeenMarker], apart: Float64[np.ndarray, "places places"], *, left_out: int
) -> list[dict[str, int]]:
    """Sets of candidates that leave a number of markers out and whose distances fit, the likeliest of them.

    ``apart``: as of `_distance_misfits`.
    """
    used = len(markers) - left_out
    most = _MOST_APART * float(chdtri(3 * used - 6, MIN_PROBABILITY))
    candidates: list[tuple[str, int]] = []
    """Name and number of each that is tried, by its place in `apart`."""
    # Grown marker by marker: a set whose distances do not fit has no other that holds it.
    grown: list[tuple[int, ...]] = [()]
    for number, marker in enumerate(markers):
        first = len(candidates)
        candidates += [(marker.name, each) for each in range(min(len(marker.candidates), MOST_CANDIDATES))]
        with_it = [
            (*places, place)
            for places in grown
            for place in range(first, len(candidates))
            if all(apart[before, place] <= most for before in places)
        ]
        without = [places for places in grown if number - len(places) < left_out]
        grown = [*with_it, *without]
    whole = [dict(candidates[place] for place in places) for places in grown if len(places) == used]
    return sorted(whole, key=lambda chosen: -_log_prior(markers, chosen))[:_MOST_SETS]


def _distance_misfits(markers: Sequence[SeenMarker]) -> Float64[np.ndarray, "places places"]:
    """Chi squared of the distance between each two candidates, against that of their spots; markers in their order."""
    pairs = [
        marker.pair(number) for marker in markers for number in range(min(len(marker.candidates), MOST_CANDIDATES))
    ]
    from_trus, trus_variance = _distances(
        np.array([pair.trus_m for pair in pairs]),
        np.array([pair.trus_covariance_m2 for pair in pairs]),
        trus_shared_m(np.array([pair.trus_m for pair in pairs])),
    )
    from_camera, camera_variance = _distances(
        np.array([pair.camera_m for pair in pairs]),
        np.array([pair.camera_covariance_m2 for pair in pairs]),
        np.concatenate([np.array([pair.camera_shared_m for pair in pairs]), motion_m(pairs)], axis=2),
    )
    return np.asarray((from_trus - from_camera) ** 2 / (trus_variance + camera_variance + _TINY_M2))


def _distances(
    points_m: Float64[np.ndarray, "points 3"],
    covariances_m2: Float64[np.ndarray, "points 3 3"],
    shared_m: Float64[np.ndarray, "points 3 errors"],
) -> tuple[Float64[np.ndarray, "points points"], Float64[np.ndarray, "points points"]]:
    """Distances between points, and their variances."""
    between_m = points_m[:, None] - points_m[None]
    distances_m = np.linalg.norm(between_m, axis=2)
    along = between_m / np.maximum(distances_m, 1e-9)[:, :, None]
    own = np.einsum("nmi,nmij,nmj->nm", along, covariances_m2[:, None] + covariances_m2[None], along)
    together = np.einsum("nmi,nmij->nmj", along, shared_m[:, None] - shared_m[None])
    return distances_m, own + np.sum(together**2, axis=2)


_TINY_M2 = 1e-12
"""A micrometre squared: two candidates of one marker have no distance, and no variance."""


def chosen_pairs(markers: Sequence[SeenMarker], chosen: Mapping[str, int]) -> list[PointPair]:
    """The points of the markers whose candidate was chosen."""
    return [marker.pair(chosen[marker.name]) for marker in markers if marker.name in chosen]


def _log_prior(markers: Sequence[SeenMarker], chosen: Mapping[str, int]) -> float:
    """Logarithm of the probability of a set before the camera is asked."""
    shares = [
        marker.candidates[chosen[marker.name]].probability if marker.name in chosen else LEFT_OUT for marker in markers
    ]
    return sum(math.log(max(share, 1e-12)) for share in shares)
