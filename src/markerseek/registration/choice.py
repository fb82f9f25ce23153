"""Chooses which source is the marker: the set of candidates, one for each marker, that fits one rigid transform.

A search that answers `ambiguous` names several candidates, and even one that found may have found another source. The
camera has seen where the spots are, so that a wrong candidate does not fit the others. Most sets are ruled out by the
distances between their points, which no rigid transform changes; the others are registered, and compared by the product
of the probabilities of their candidates and of the evidence of their points.

A marker is left out only against evidence. Any three markers fit, so that four must remain for each that is left out.
The newest is never left out: if the endoscope has moved before it, it is the only one that is right, and the next
marker tells whether it has. Sets that may not be taken compete all the same. So does the explanation that all markers
are displaced among themselves, as in moving tissue. A registration is decided only if all of these are improbable
beside it, but for sets with the newest marker that put target and markers at the same places as it does: which of them
is right does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import msgspec
import numpy as np
from msgspec import structs
from scipy.special import chdtri, softmax

from markerseek.core import ConfigError, Float64, MarkerCandidate, SpotToSource
from markerseek.geometry import MIN_POINTS, OFFSET_FACTORS, RigidTransform
from markerseek.registration.report import (
    MEDIAN_LENGTH,
    MIN_PROBABILITY,
    POINT_WRONG,
    POINT_WRONG_M3,
    PointPair,
    RegistrationReport,
    motion_m,
    register_pairs,
    registered_pairs,
)
from markerseek.registration.shared_errors import source_shared_m, sources_m, trus_shared_m

_MIN_SHARE = 0.99
"""Least probability, among all sets, of the set that is taken."""

_SAME_SHARE = 0.5
"""Share of the expected error at the target: two sets that put target and markers by no more apart say the same."""

MOVED = 0.05
"""Probability that the newest marker does not belong to the others because the endoscope has moved before it."""

DISPLACED = 0.05
"""Probability that all markers are displaced among themselves, because tissue or endoscope move."""

DISPLACED_M = 2e-3
"""Usual standard deviation of these displacements along each direction, in metres."""

AGREEING = 4
"""Fewest markers that must agree if another one is left out, and for each that is: any three agree."""

OVER_AFTER = 6
"""Markers after which a session is over if they do not fit."""

MOST_CANDIDATES = 4
"""Most candidates of a marker that are tried, the likeliest."""

_MOST_SETS = 40
"""Most sets of all markers that are registered, the likeliest first."""

_MOST_WITHOUT = 15
"""Most sets that are registered for each number of markers that are left out."""

_MOST_GROWN = 150
"""Most sets that grow by another marker."""

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
        """Return the point with one of the candidates."""
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
    over: bool = False
    """Whether more markers do not help: too many do not fit."""


def choose(
    markers: Sequence[SeenMarker],
    *,
    target_trus_m: tuple[float, float, float] | None = None,
    spot: SpotToSource | None = None,
) -> Choice:
    """Choose the candidates that fit one rigid transform.

    ``markers``: in the order in which they were measured. ``target_trus_m``: where the error is wanted, and ``spot``:
    where the light is absorbed, both as of `register_pairs`.
    """
    spot = spot or SpotToSource()
    useful = [marker for marker in markers if marker.candidates]
    first = {marker.name: 0 for marker in useful}
    if len(useful) < MIN_POINTS:
        return Choice(report=None, decided=False, chosen=first, reason=f"{len(useful)} of {MIN_POINTS} markers")
    may_be_left_out = (len(useful) - 1) // AGREEING
    fits, problem = _fits(useful, spot, most_left_out=max(may_be_left_out, int(len(useful) > MIN_POINTS)))
    newest = useful[-1].name
    accepted = [
        fit
        for fit in fits
        if fit.probability >= MIN_PROBABILITY
        and len(useful) - len(fit.chosen) <= may_be_left_out
        and newest in fit.chosen
    ]
    if not accepted:
        return _unfit(useful, fits, problem, target_trus_m, spot)
    best = max(accepted, key=lambda fit: fit.log_probability)
    left = _left_out(useful, best)
    displaced = _displaced(useful, best.chosen, spot)
    rivals = [fit for fit in fits if fit is not best]
    # Where all fit, the offset counts what they are displaced.
    logs = [best.log_probability, displaced.log_probability if left else -math.inf]
    shares = softmax(logs + [fit.log_probability for fit in rivals])

    def registered(fit: _Fit) -> RegistrationReport:
        return register_pairs(chosen_pairs(useful, fit.chosen), target_trus_m=target_trus_m, spot=spot)

    report = registered(best)
    agreeing: list[tuple[_Fit, float]] = []
    doubted: list[tuple[_Fit, float]] = []
    for rival, share in zip(rivals, shares[2:].tolist(), strict=True):
        (agreeing if _say_the_same(best, rival, useful, report) else doubted).append((rival, share))
    certain = 1.0 - float(shares[1]) - sum(share for _, share in doubted)
    if certain >= _MIN_SHARE:
        # Where a marker is probably wrong, the report with it is not accepted, and the one without it is.
        likely = [(fit, share) for fit, share in agreeing if share > 1 - _MIN_SHARE and fit in accepted]
        likely.sort(key=lambda each: -each[1])
        tried = chain([(best, report)], ((fit, registered(fit)) for fit, _ in likely))
        taken, its_report = next((each for each in tried if each[1].registered), (best, report))
        return Choice(
            report=its_report,
            decided=its_report.registered,
            chosen=taken.chosen,
            left_out=_left_out(useful, taken),
        )
    doubtful = [rival for rival, share in doubted if share > (1 - _MIN_SHARE) / len(fits)]
    unsure = tuple(name for name in first if any(best.chosen.get(name) != rival.chosen.get(name) for rival in doubtful))
    over = len(useful) >= OVER_AFTER and bool(shares[0] < shares[1])
    if shares[1] > sum(share for _, share in doubted):
        reason = f"{_in_words(displaced)}: {_HELD_STILL if over else 'one more marker decides'}"
    else:
        missing = {name for rival in doubtful for name in best.chosen if name not in rival.chosen}
        what = "may be wrong, or the endoscope has moved before it" if missing else "may be another source"
        reason = f"marker {' or '.join(unsure)} {what} ({100 * (1 - certain):.0f} %): one more marker decides"
    return Choice(
        report=report, decided=False, chosen=best.chosen, left_out=left, open=unsure, reason=reason, over=over
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """A set of candidates, and how well it fits."""

    chosen: dict[str, int]
    log_probability: float
    """Logarithm of its probability, but for a constant of all sets."""
    probability: float
    """Probability of residuals as large or larger."""
    offset_sigma_m: float
    transform: RigidTransform
    """From the camera to the probe."""


def _left_out(markers: Sequence[SeenMarker], fit: _Fit) -> tuple[str, ...]:
    """Return the names of the markers that are not in a set."""
    return tuple(marker.name for marker in markers if marker.name not in fit.chosen)


def _say_the_same(best: _Fit, rival: _Fit, markers: Sequence[SeenMarker], report: RegistrationReport) -> bool:
    """Return whether two sets put target and markers at the same places, as far as these are known.

    Not if the rival is without the newest marker: the endoscope may then have moved, and neither transform may hold.
    """
    if markers[-1].name not in rival.chosen:
        return False
    target_m = best.transform.inverse().apply(np.array(report.target_trus_m))
    places_m = np.array([target_m, *(marker.camera_m for marker in markers)])
    apart_m = np.linalg.norm(rival.transform.apply(places_m) - best.transform.apply(places_m), axis=1)
    return bool(apart_m.max() <= _SAME_SHARE * report.tre_m)


def _fits(markers: Sequence[SeenMarker], spot: SpotToSource, *, most_left_out: int) -> tuple[list[_Fit], str]:
    """Return all sets whose distances fit, and why others determine no transform."""
    found = list[_Fit]()
    problem = ""
    apart = _distance_misfits(markers, spot)
    for left_out in range(most_left_out + 1):
        for chosen in _sets(markers, apart, left_out=left_out):
            try:
                found.append(_fit(markers, chosen, spot))
            except ConfigError as refusal:
                problem = problem or str(refusal)
    return found, problem


def _fit(markers: Sequence[SeenMarker], chosen: dict[str, int], spot: SpotToSource) -> _Fit:
    """Return how well a set fits; `ConfigError` if it determines no transform."""
    found = registered_pairs(chosen_pairs(markers, chosen), spot=spot)
    assert found.log_evidence is not None and found.offset_sigma_m is not None  # noqa: S101, PT018  all have sigmas
    return _Fit(
        chosen=chosen,
        log_probability=_log_prior(markers, chosen) + found.log_evidence,
        probability=found.probability,
        offset_sigma_m=found.offset_sigma_m,
        transform=found.transform,
    )


def _displaced(markers: Sequence[SeenMarker], chosen: Mapping[str, int], spot: SpotToSource) -> _Fit:
    """Return how well all markers fit if each is displaced; those that were not chosen by their first candidate."""
    all_of_them = {marker.name: chosen.get(marker.name, 0) for marker in markers}
    fit = _fit(markers, all_of_them, structs.replace(spot, offset_sigma_m=DISPLACED_M))
    return replace(fit, log_probability=fit.log_probability + math.log(DISPLACED))


def _in_words(displaced: _Fit) -> str:
    """Return how much markers disagree: the median length of their displacements."""
    return f"the markers disagree among themselves by {1e3 * MEDIAN_LENGTH * displaced.offset_sigma_m:.1f} mm"


_HELD_STILL = "register again, with endoscope and tissue held still"


def _unfit(
    useful: Sequence[SeenMarker],
    fits: Sequence[_Fit],
    problem: str,
    target_trus_m: tuple[float, float, float] | None,
    spot: SpotToSource,
) -> Choice:
    """Say why no set may be taken, and what to do."""
    first = {marker.name: 0 for marker in useful}
    try:
        report = register_pairs(chosen_pairs(useful, first), target_trus_m=target_trus_m, spot=spot)
        displaced = _displaced(useful, first, spot)
    except ConfigError as refusal:
        return Choice(report=None, decided=False, chosen=first, reason=problem or str(refusal))
    likeliest = max(fits, key=lambda fit: fit.log_probability, default=displaced)
    odd = [name for name in first if name not in likeliest.chosen]
    # The next marker tells whether the newest is wrong, or the endoscope has moved before it.
    over = len(useful) >= OVER_AFTER and odd != [useful[-1].name]
    fits_worst = f"marker {' and '.join(odd) or report.worst} fits worst"
    cure = "it is wrong, or endoscope or tissue have moved: one more marker may decide"
    reason = f"{_in_words(displaced)}; {fits_worst}: {_HELD_STILL if over else cure}"
    refused = structs.replace(report, registered=False, davinci_to_trus=None, reason=reason)
    return Choice(report=refused, decided=False, chosen=first, reason=reason, over=over)


def _sets(
    markers: Sequence[SeenMarker], apart: Float64[np.ndarray, "places places"], *, left_out: int
) -> list[dict[str, int]]:
    """Return the sets of candidates that leave a number of markers out and whose distances fit, the likeliest of them.

    ``apart``: as of `_distance_misfits`.
    """
    used = len(markers) - left_out
    most = _MOST_APART * float(chdtri(3 * used - 6, MIN_PROBABILITY))
    misfits = apart.tolist()
    # Name and number of each that is tried, by its place in `apart`.
    candidates: list[tuple[str, int]] = []
    # Sets grow marker by marker: if the distances of a set do not fit, those of no larger one do. Of each there is the
    # logarithm of its probability by its candidates and distances, and the places of its candidates.
    grown: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    for number, marker in enumerate(markers):
        first = len(candidates)
        tried = marker.candidates[:MOST_CANDIDATES]
        candidates += [(marker.name, each) for each in range(len(tried))]
        further = [(log, places) for log, places in grown if number - len(places) < left_out]
        for log, places in grown:
            for place, candidate in enumerate(tried, start=first):
                squares = [misfits[before][place] for before in places]
                if all(square <= most for square in squares):
                    likely = math.log(max(candidate.probability, 1e-12)) - sum(squares) / 2 / max(len(squares), 1)
                    further.append((log + likely, (*places, place)))
        grown = sorted(further, key=lambda each: -each[0])[:_MOST_GROWN]
    whole = [dict(candidates[place] for place in places) for _, places in grown if len(places) == used]
    return whole[: _MOST_WITHOUT if left_out else _MOST_SETS]


def _distance_misfits(markers: Sequence[SeenMarker], spot: SpotToSource) -> Float64[np.ndarray, "places places"]:
    """Return the chi squared of the distance between each two candidates, against that of their spots."""
    pairs = [
        marker.pair(number) for marker in markers for number in range(min(len(marker.candidates), MOST_CANDIDATES))
    ]
    from_trus, trus_variance = _distances(
        np.array([pair.trus_m for pair in pairs]),
        np.array([pair.trus_covariance_m2 for pair in pairs]),
        trus_shared_m(np.array([pair.trus_m for pair in pairs])),
    )
    camera_m = np.array([pair.camera_m for pair in pairs])
    from_camera, camera_variance = _distances(
        sources_m(camera_m, spot),
        np.array([pair.camera_covariance_m2 for pair in pairs]),
        np.concatenate(
            [
                source_shared_m(camera_m, np.array([pair.camera_shared_m for pair in pairs]), spot),
                motion_m(pairs),
            ],
            axis=2,
        ),
    )
    # Each of two points may be off by an offset that is as large as it is in one of 20 rigs.
    offsets_m2 = 2 * (OFFSET_FACTORS[1] ** 2 * spot.offset_sigma_m) ** 2
    return np.asarray((from_trus - from_camera) ** 2 / (trus_variance + camera_variance + offsets_m2 + _TINY_M2))


def _distances(
    points_m: Float64[np.ndarray, "points 3"],
    covariances_m2: Float64[np.ndarray, "points 3 3"],
    shared_m: Float64[np.ndarray, "points 3 errors"],
) -> tuple[Float64[np.ndarray, "points points"], Float64[np.ndarray, "points points"]]:
    """Return the distances between points, and their variances."""
    between_m = points_m[:, None] - points_m[None]
    distances_m = np.linalg.norm(between_m, axis=2)
    along = between_m / np.maximum(distances_m, 1e-9)[:, :, None]
    own = np.einsum("nmi,nmij,nmj->nm", along, covariances_m2[:, None] + covariances_m2[None], along)
    together = np.einsum("nmi,nmij->nmj", along, shared_m[:, None] - shared_m[None])
    return distances_m, own + np.sum(together**2, axis=2)


_TINY_M2 = 1e-12
"""A micrometre squared: two candidates of one marker have no distance, and no variance."""


def chosen_pairs(markers: Sequence[SeenMarker], chosen: Mapping[str, int]) -> list[PointPair]:
    """Return the points of the markers whose candidate was chosen."""
    return [marker.pair(chosen[marker.name]) for marker in markers if marker.name in chosen]


def _log_prior(markers: Sequence[SeenMarker], chosen: Mapping[str, int]) -> float:
    """Return the logarithm of the prior probability of a set.

    A marker that is left out has a density.
    """
    total = 0.0
    for marker in markers:
        wrong = MOVED if marker is markers[-1] else POINT_WRONG
        if marker.name in chosen:
            total += math.log((1 - wrong) * max(marker.candidates[chosen[marker.name]].probability, 1e-12))
        else:
            total += math.log(wrong / POINT_WRONG_M3)
    return total
