"""Registration of the da Vinci system to the probe from markers and camera points: judged, reported, read again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, Self, TypeAlias

import msgspec
import numpy as np
from scipy.special import chdtrc, softmax

from markerseek._version import __version__
from markerseek.core import ConfigError, Float64, RecordError, SpotToSource, Vector, as_vector
from markerseek.files import MIB, read_json
from markerseek.geometry import WIDER, Registration, RigidTransform, mirror_image_fre, register_points
from markerseek.registration.plan import require_target
from markerseek.registration.shared_errors import (
    SharedError,
    shared_directions,
    source_shared_m,
    sources_m,
    trus_shared_m,
)
from markerseek.registration.stereo_files import StereoSettings

MIN_PROBABILITY = 1e-3
"""Probability of residuals as large, or larger, below which points do not fit (a chi-squared test); so for the error at
a spot that checks a registration."""

POINT_WRONG = 0.02
POINT_WRONG_M3 = 1e-4
"""Probability that a point is wrong before it is compared with others, and the volume in which it then lies anywhere:
what a probe can reach."""

MIN_RIGHT = 0.99
"""Least probability that no point is wrong; below it, points with sigmas are not accepted."""

ASSUMED_SIGMA_M = 1e-3
"""Standard deviation of each coordinate of a residual, in metres, by which points without sigmas are judged: points at
which a tool is pressed on tissue are off by 1.7 mm altogether."""

MIRROR_SHARE = 0.5
"""Where points do not fit, a mirror image is reported if its FRE is below this share of the registration's."""

MEDIAN_LENGTH = 1.538
"""Median length of a vector whose coordinates have the standard deviation 1 (the root of the chi-squared median of
three degrees of freedom)."""

NOTHING_BELOW = SpotToSource(depth_m=0.0, depth_sigma_m=0.0)
"""Of camera points that are not known to be spots of light: what was seen is what was found in the TRUS frame, but for
an offset of unknown size, which keeps what the sigmas do not hold."""

SEEN_SHARE = 0.7
"""Points show something of a shared error if they reduce its standard deviation to less than this share."""

DOUBTED = 0.5
"""Probability that some shared error is larger than assumed, above which that is said."""

TARGET_DEPTH_M = 20e-3
"""Usual target: this far under the middle of the points, towards the axis of the probe, in metres."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointPair:
    """One point measured in both frames."""

    name: str
    trus_m: Float64[np.ndarray, " 3"]
    camera_m: Float64[np.ndarray, " 3"]
    """``trus_m`` and ``camera_m``: the point in the frame of the probe and in that of the camera."""
    trus_covariance_m2: Float64[np.ndarray, "3 3"] | None = None
    camera_covariance_m2: Float64[np.ndarray, "3 3"] | None = None
    """``trus_covariance_m2`` and ``camera_covariance_m2``: covariances in these frames; None if they are not
    known."""
    camera_shared_m: Float64[np.ndarray, "3 errors"] | None = None
    """Displacement of the camera point by the errors that all share, as `camera_shared_m` gives it; None: of the focal
    length alone."""
    camera_motion_m: Float64[np.ndarray, "3 motions"] | None = None
    """Displacement of the camera point by the errors of motions of the endoscope by which it was carried; None: it was
    carried by none."""


class PointReport(msgspec.Struct, frozen=True, kw_only=True):
    """One point of a registration.

    ``transformed_m`` is the camera point in the TRUS frame, ``residual_m`` its distance from ``trus_m``, and
    ``left_out_m`` the same where the transform comes from the other points only; None if they determine none.
    """

    name: str
    trus_m: Vector
    camera_m: Vector
    transformed_m: Vector
    residual_m: float
    left_out_m: float | None


class SharedReport(msgspec.Struct, frozen=True, kw_only=True):
    """An error that all points share: by how much its value was assumed too large, in ``unit``.

    ``value`` and ``sigma`` are the estimate and its standard deviation, ``assumed_sigma`` is that of the prior. Where
    the points show nothing of it both are alike. ``larger`` is the probability that this error is larger than assumed.
    ``target_shift_m`` is how far an error of one assumed standard deviation puts the target from where it is.
    """

    name: str
    unit: str
    value: float
    sigma: float
    assumed_sigma: float
    larger: float = 0.0
    target_shift_m: float = 0.0

    @property
    def is_seen(self) -> bool:
        """Whether the points show something of it."""
        return self.sigma < SEEN_SHARE * self.assumed_sigma


class SpotCheck(msgspec.Struct, frozen=True, kw_only=True):
    """An independent check of a registration: a spot that took no part in it.

    ``trus_m`` is where the probe found the source of the spot, ``camera_m`` the spot, ``transformed_m`` where the
    registration puts its source in the TRUS frame, and ``off_m`` the distance between the two. ``expected_m`` is the
    root mean square of that distance which was to be expected, 95 % of such distances are below ``expected95_m``, and
    ``exceeded`` is the share of them that are as long, or longer.
    """

    name: str
    trus_m: Vector
    camera_m: Vector
    transformed_m: Vector
    off_m: float
    expected_m: float
    expected95_m: float
    exceeded: float

    @property
    def agrees(self) -> bool:
        """Whether the registration may hold at this spot."""
        return self.exceeded >= MIN_PROBABILITY

    @property
    def said(self) -> str:
        """The check in a sentence."""
        said = (
            f"off by {1e3 * self.off_m:.2f} mm at this spot; {1e3 * self.expected_m:.2f} mm was expected "
            f"(95 %: {1e3 * self.expected95_m:.2f})"
        )
        if not self.agrees:
            return f"{said}: the registration does not hold there; light one more marker, or register again"
        return said if self.off_m <= self.expected95_m else f"{said}: one spot in 20 is so far off, check another one"


class RegistrationReport(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a registration as one JSON object.

    ``davinci_to_trus`` maps points of the frame ``frames.davinci`` to the frame ``frames.trus``, in metres; None where
    the registration is not accepted, and ``reason`` says why. ``fre_m`` is the root mean square residual,
    ``expected_fre_m`` what the sigmas let expect (without sigmas: `ASSUMED_SIGMA_M`), ``misfit`` chi squared by its
    degrees of freedom, and ``probability`` that of residuals as large or larger. ``tre_m`` is the expected root mean
    square error at ``target_trus_m``, 95 % of the errors there are below ``tre95_m``, and their covariance is
    ``target_covariance_m2``, in the TRUS frame; errors that all points share are in all three. ``shared`` are those
    that were estimated, none without sigmas, and ``doubts`` says which of them the points show to be larger than
    assumed, with the cure. ``offset_sigma_m`` is the estimate of the distance between spot and source, as a standard
    deviation along each direction; None without sigmas. ``weights`` says whether the sigmas were used. ``worst`` is the
    point without which the others fit best, and ``without`` are those that the user left out. ``checks`` are
    independent checks of this registration.
    """

    registered: bool
    reason: str | None
    davinci_to_trus: list[list[float]] | None
    frames: dict[str, str]
    fre_m: float
    expected_fre_m: float
    tre_m: float
    tre95_m: float
    target_trus_m: Vector
    target_covariance_m2: list[list[float]]
    misfit: float
    probability: float
    mirror_image_fre_m: float
    weights: Literal["sigmas of both", "equal"]
    worst: str
    without: list[str]
    shared: list[SharedReport]
    points: list[PointReport]
    offset_sigma_m: float | None = None
    doubts: list[str] = []
    checks: list[SpotCheck] = []
    version: str = __version__

    @property
    def offset_m(self) -> float | None:
        """Median distance between spot and source; None without sigmas."""
        return None if self.offset_sigma_m is None else MEDIAN_LENGTH * self.offset_sigma_m

    @property
    def assumed(self) -> str | None:
        """In a sentence, the shared error that matters most of those that the points do not show; None: there is none.

        If it is larger than assumed, nothing else tells.
        """
        unseen = [error for error in self.shared if error.target_shift_m > 0 and not error.is_seen]
        if not unseen:
            return None
        most = max(unseen, key=lambda error: error.target_shift_m)
        larger = f"{WIDER * most.assumed_sigma:.2g} {most.unit}"
        return (
            f"{most.name} right to {most.assumed_sigma:.2g} {most.unit}, which these points do not show: "
            f"{larger} would put the target {1e3 * WIDER * most.target_shift_m:.1f} mm off"
        )

    @property
    def expected(self) -> str:
        """The error that is to be expected, in words."""
        return f"expected error at the target {1e3 * self.tre_m:.2f} mm, in 95 % below {1e3 * self.tre95_m:.2f} mm"


_FRAMES = {
    "davinci": "the left camera of the stereo endoscope: x to the right in the image, y down, z along the view",
    "trus": "the probe at 0 deg: y along its axis of rotation, z out of the array, x completes the right hand",
}
"""The two frames, in words."""


def register_pairs(
    pairs: Sequence[PointPair],
    *,
    target_trus_m: Vector | None = None,
    without: Sequence[str] = (),
    spot: SpotToSource | None = None,
) -> RegistrationReport:
    """Register point pairs, and judge the result.

    Sigmas are used where all points have them in both frames: with those of one frame only, the other would count as
    exact.

    ``pairs``: at least three that are not on a line. ``target_trus_m``: where the error is wanted, in the TRUS frame;
    None: `TARGET_DEPTH_M` under the middle of the points. ``without``: names of points that are left out. ``spot``:
    where the light of a spot is absorbed, if the camera points are spots of light; None: as `NOTHING_BELOW`. It counts
    where sigmas are used.
    """
    spot = spot or NOTHING_BELOW
    require_target(target_trus_m)
    names = [pair.name for pair in pairs]
    unknown = next((name for name in without if name not in names), None)
    if unknown is not None:
        raise ConfigError(f"`without` is {unknown!r}, which is no point; there are {', '.join(names)}")
    pairs = _alike([pair for pair in pairs if pair.name not in without])
    found = registered_pairs(pairs, spot=spot)
    weighed = pairs[0].trus_covariance_m2 is not None
    fit = _Fit.of(found, len(pairs), weighed=weighed)
    rests = _without_each(pairs, spot)
    rest_fits = {name: _Fit.of(rest, len(pairs) - 1, weighed=weighed) for name, rest in rests.items()}
    # The point without which the others fit best; that of the largest residual if none can be left out.
    farthest = pairs[int(np.argmax(found.distances_m))].name
    worst = min(rest_fits, key=lambda name: _rank(rest_fits[name]), default=farthest)
    trus_m = np.array([pair.trus_m for pair in pairs])
    mirror_fre_m = mirror_image_fre(np.array([pair.camera_m for pair in pairs]), trus_m)
    right = _all_right(found, rests)
    reason = None
    if not fit.accepted:
        reason = _why_not_fitting(found, fit, rest_fits, worst, mirror_fre_m, weighed=weighed)
    elif right < MIN_RIGHT:
        reason = _why_doubtful(right, rest_fits, worst)
    target = default_target(trus_m) if target_trus_m is None else target_trus_m
    shared, doubts = _shared(found, pairs, spot, target_m=np.array(target)) if weighed else ([], [])
    return RegistrationReport(
        registered=reason is None,
        reason=reason,
        davinci_to_trus=found.transform.matrix.tolist() if reason is None else None,
        frames=_FRAMES,
        fre_m=found.fre_m,
        expected_fre_m=fit.expected_fre_m,
        tre_m=found.tre_m(np.array(target)),
        tre95_m=found.tre95_m(np.array(target)),
        target_trus_m=target,
        target_covariance_m2=found.tre_covariance_m2(np.array(target)).tolist(),
        misfit=fit.chi_squared / fit.freedom,
        probability=fit.probability,
        mirror_image_fre_m=mirror_fre_m,
        weights="sigmas of both" if weighed else "equal",
        worst=worst,
        without=list(without),
        shared=shared,
        offset_sigma_m=found.offset_sigma_m,
        doubts=doubts,
        points=[
            PointReport(
                name=pair.name,
                trus_m=as_vector(pair.trus_m),
                camera_m=as_vector(pair.camera_m),
                transformed_m=as_vector(pair.trus_m + residual_m),
                residual_m=float(np.linalg.norm(residual_m)),
                left_out_m=_distance_m(pair, rests[pair.name], spot) if pair.name in rests else None,
            )
            for pair, residual_m in zip(pairs, found.residuals_m, strict=True)
        ],
    )


def registered_pairs(pairs: Sequence[PointPair], *, spot: SpotToSource) -> Registration:
    """Return the transform of point pairs with its covariance, not judged.

    ``spot``: where the light of a spot is absorbed.
    """
    pairs = _alike(pairs)
    camera_m = np.array([pair.camera_m for pair in pairs], dtype=float).reshape(-1, 3)
    trus_m = np.array([pair.trus_m for pair in pairs], dtype=float).reshape(-1, 3)
    camera_shared = _camera_shared(pairs)
    if not pairs or pairs[0].trus_covariance_m2 is None:
        # Points at which a tool was pressed have no depth.
        return register_points(
            camera_m,
            trus_m,
            source_shared_m=source_shared_m(camera_m, camera_shared, NOTHING_BELOW),
            target_shared_m=trus_shared_m(trus_m),
        )
    moved_m = motion_m(pairs)
    directions = shared_directions(camera_m, camera_shared, spot, motions=moved_m.shape[2])
    return register_points(
        sources_m(camera_m, spot),
        trus_m,
        source_covariances_m2=np.array([pair.camera_covariance_m2 for pair in pairs]),
        target_covariances_m2=np.array([pair.trus_covariance_m2 for pair in pairs]),
        source_shared_m=np.concatenate([source_shared_m(camera_m, camera_shared, spot), moved_m], axis=2),
        target_shared_m=trus_shared_m(trus_m),
        offset_sigma_m=spot.offset_sigma_m,
        doubtful=np.array([each for error, each in directions if error.cure]),
    )


def motion_m(pairs: Sequence[PointPair]) -> Float64[np.ndarray, "points 3 motions"]:
    """Return the displacements of camera points by the errors of motions of the endoscope."""
    count = max((pair.camera_motion_m.shape[1] for pair in pairs if pair.camera_motion_m is not None), default=0)
    still = np.zeros((3, count))
    return np.array(
        [still if pair.camera_motion_m is None else pair.camera_motion_m for pair in pairs], dtype=float
    ).reshape(len(pairs), 3, count)


def _camera_shared(pairs: Sequence[PointPair]) -> Float64[np.ndarray, "points 3 errors"] | None:
    """Return the displacements by errors of the camera, of points that are alike; None: their pixels are not known."""
    known = [pair.camera_shared_m for pair in pairs if pair.camera_shared_m is not None]
    # A record of points on which no error acts has no column.
    return np.array(known) if known and known[0].shape[1] > 0 else None


def _alike(pairs: Sequence[PointPair]) -> list[PointPair]:
    """Return the points, without covariances unless all have both, and without shared errors unless all have them."""
    if any(pair.trus_covariance_m2 is None or pair.camera_covariance_m2 is None for pair in pairs):
        pairs = [replace(pair, trus_covariance_m2=None, camera_covariance_m2=None) for pair in pairs]
    if any(pair.camera_shared_m is None for pair in pairs):
        pairs = [replace(pair, camera_shared_m=None) for pair in pairs]
    return list(pairs)


def _without_each(pairs: Sequence[PointPair], spot: SpotToSource) -> dict[str, Registration]:
    """Return the registration of the others, by the name of each point without which they determine one."""
    rests = {}
    for pair in pairs:
        # The others may be too few, or lie on a line.
        with suppress(ConfigError):
            rests[pair.name] = registered_pairs([other for other in pairs if other is not pair], spot=spot)
    return rests


def _rank(fit: _Fit) -> float:
    """Return a rank of a fit, smaller for a better one: minus its evidence or, without sigmas, chi squared."""
    return fit.chi_squared if fit.log_evidence is None else -fit.log_evidence


def _all_right(found: Registration, rests: Mapping[str, Registration]) -> float:
    """Return the probability that no point is wrong, against one of them being so; 1 without sigmas."""
    if found.log_evidence is None:
        return 1.0
    prior = math.log(POINT_WRONG / (1 - POINT_WRONG) / POINT_WRONG_M3)
    odds = [rest.log_evidence - found.log_evidence + prior for rest in rests.values() if rest.log_evidence is not None]
    return float(softmax([0.0, *odds])[0])


def _distance_m(pair: PointPair, rest: Registration, spot: SpotToSource) -> float:
    """Return the distance of a point from where a registration puts it."""
    weighed = rest.offset_sigma_m is not None
    camera_m = sources_m(pair.camera_m[None], spot)[0] if weighed else pair.camera_m
    return float(np.linalg.norm(rest.transform.apply(camera_m) - pair.trus_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Fit:
    """How well points fit, beside what their sigmas let expect; without sigmas, `ASSUMED_SIGMA_M`."""

    chi_squared: float
    freedom: int
    expected_fre_m: float
    probability: float
    """Probability of residuals as large or larger."""
    log_evidence: float | None = None
    """As of `Registration`."""

    @classmethod
    def of(cls, found: Registration, count: int, *, weighed: bool) -> _Fit:
        freedom = 3 * count - 6
        if weighed:
            return cls(
                chi_squared=found.misfit * freedom,
                freedom=freedom,
                expected_fre_m=found.errors.fre_m,
                probability=found.probability,
                log_evidence=found.log_evidence,
            )
        chi_squared = count * (found.fre_m / ASSUMED_SIGMA_M) ** 2
        return cls(
            chi_squared=chi_squared,
            freedom=freedom,
            expected_fre_m=ASSUMED_SIGMA_M * math.sqrt(freedom / count),
            probability=float(chdtrc(freedom, chi_squared)),
        )

    @property
    def accepted(self) -> bool:
        """Whether the points fit."""
        return self.probability >= MIN_PROBABILITY


def _why_doubtful(right: float, rests: Mapping[str, _Fit], worst: str) -> str:
    """Return why points that fit may hold a wrong one, and what to do."""
    others = " or ".join(_suspects(rests)) or worst
    return (
        "the residuals are as small as expected, but one point is wrong with a probability of "
        f"{100 * (1 - right):.3g} %: the others agree better without {others}; {_SAME_SPOT}, "
        "or leave it out of the registration"
    )


def _why_not_fitting(
    found: Registration, fit: _Fit, rests: Mapping[str, _Fit], worst: str, mirror_fre_m: float, *, weighed: bool
) -> str:
    """Return why the points do not fit, and what to do."""
    fre_mm = 1e3 * found.fre_m
    expected_mm = 1e3 * fit.expected_fre_m
    if mirror_fre_m < MIRROR_SHARE * found.fre_m:
        return (
            f"a mirror image fits better: FRE {1e3 * mirror_fre_m:.2f} mm and {fre_mm:.2f} mm without; one of the "
            f"frames is left-handed, or points are swapped (the worst is point {worst}); check the sign of each axis"
        )
    expected_by = "their sigmas let expect"
    if not weighed:
        expected_by = f"{1e3 * ASSUMED_SIGMA_M:g} mm along each direction, which is assumed, lets expect"
    larger = (
        f"the residuals are {math.sqrt(fit.chi_squared / fit.freedom):.1f} times as large as {expected_by} "
        f"(FRE {fre_mm:.2f} mm, {expected_mm:.2f} mm expected); point {worst} fits worst"
    )
    fitting = _suspects(rests)
    if len(fitting) > 1:
        return (
            f"{larger}, but the others also fit without {' or '.join(fitting[1:])}: check these, then leave the wrong "
            f"one out, such as {worst}"
        )
    if fitting:
        return f"{larger}: {_SAME_SPOT}, or leave it out of the registration"
    alone = ", and without it the others do not fit either" if rests else ""
    small = ", and that no sigma is too small" if weighed else ""
    return f"{larger}{alone}: {_SAME_SPOT}{small}"


_SAME_SPOT = "check that its marker and its camera point are the same spot"


def _suspects(rests: Mapping[str, _Fit]) -> list[str]:
    """Return the points without which the others fit, the likeliest to be wrong first, without far less likely ones."""
    fitting = [name for name in sorted(rests, key=lambda name: _rank(rests[name])) if rests[name].accepted]
    known = {name: log for name in fitting if (log := rests[name].log_evidence) is not None}
    most = max(known.values(), default=0.0)
    return [name for name in fitting if known.get(name, most) >= most - _FAR_LESS_LIKELY]


_FAR_LESS_LIKELY = 3.0
"""Logarithm of how much less likely a point is to be the wrong one that is not named."""


def _shared(
    found: Registration, pairs: Sequence[PointPair], spot: SpotToSource, *, target_m: Float64[np.ndarray, " 3"]
) -> tuple[list[SharedReport], list[str]]:
    """The errors that all points share, and those that are larger than assumed in words."""
    camera_m = np.array([pair.camera_m for pair in pairs])
    directions = shared_directions(camera_m, _camera_shared(pairs), spot, motions=motion_m(pairs).shape[2])
    covariance = found.errors.covariance[6:, 6:]
    # The mean displacement of the target, given the error: the regression of the one on the other.
    with_target = found.errors.shared_with_target_m(target_m)
    doubts = iter(found.doubts)
    reports = []
    doubted = []
    for error, direction in directions:
        doubt = next(doubts) if error.cure else None
        larger = 0.0 if doubt is None else doubt.probability
        variance = float(direction @ covariance @ direction)
        reports.append(
            SharedReport(
                name=error.name,
                unit=error.unit,
                value=error.sigma * float(direction @ found.shared),
                sigma=error.sigma * math.sqrt(variance),
                assumed_sigma=error.sigma,
                larger=larger,
                target_shift_m=float(np.linalg.norm(with_target @ direction)) / variance,
            )
        )
        if doubt is not None:
            doubted.append((larger, error, _in_words(error, error.sigma * doubt.value, error.sigma * doubt.sigma)))
    if sum(larger for larger, _, _ in doubted) < DOUBTED:
        return reports, []
    most = max(larger for larger, _, _ in doubted)
    said = sorted((each for each in doubted if each[0] >= most / 2), key=lambda each: -each[0])
    return reports, [f"{words}: {error.cure}" for _, error, words in said]


def _in_words(error: SharedError, value: float, sigma: float) -> str:
    """An error that is larger than assumed: "base 1.9 ± 0.6 % too long"."""
    side = error.large if value > 0 else error.small
    return f"{error.name} {abs(value):.2g} ± {sigma:.1g} {error.unit} {side}"


def default_target(trus_m: Float64[np.ndarray, "points 3"]) -> Vector:
    """The usual target: `TARGET_DEPTH_M` under the middle of the points, towards the axis."""
    x, y, z = trus_m.mean(axis=0).tolist()
    radius_m = float(np.hypot(x, z))
    share = max(radius_m - TARGET_DEPTH_M, 0.0) / radius_m if radius_m > 0 else 0.0
    return share * x, y, share * z


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownRegistration:
    """A registration to be shown to other programs."""

    davinci_to_trus: RigidTransform
    """From the camera of the da Vinci system to the probe at 0 degrees, in metres."""
    simulated: bool
    """Whether markers and camera were simulated."""
    report: RegistrationReport

    @classmethod
    def of(cls, report: RegistrationReport, *, source: Path | None, simulated: bool) -> Self:
        """Return the registration of a report that was accepted; `RecordError` if its transform is not rigid.

        ``source``: where the report was read; None: it was made here.
        """
        read = "the registration" if source is None else source
        rows = report.davinci_to_trus
        if rows is None or [len(row) for row in rows] != [4] * 4 or rows[3] != [0, 0, 0, 1]:
            raise RecordError(f"{read}: davinci_to_trus must have 4 rows of 4 numbers, the last row 0, 0, 0, 1")
        try:
            return cls(davinci_to_trus=davinci_to_probe_home(rows), simulated=simulated, report=report)
        except ConfigError as problem:
            raise RecordError(f"{read}: {problem}") from problem

    @property
    def errors(self) -> dict[str, float | int]:
        """Its errors and the number of its markers, as they are shown beside the transform."""
        report = self.report
        return {"fre_m": report.fre_m, "tre_m": report.tre_m, "tre95_m": report.tre95_m, "markers": len(report.points)}


class _File(RegistrationReport, frozen=True, kw_only=True):
    """A report, and what a simulation adds to it."""

    simulation: Any = None


def davinci_to_probe_home(rows: Sequence[Sequence[float]]) -> RigidTransform:
    """The transform whose matrix has these rows, as in `RegistrationReport`."""
    matrix = np.array(rows, dtype=float)
    return RigidTransform(source="DaVinci", target="ProbeHome", rotation=matrix[:3, :3], translation_m=matrix[:3, 3])


Pixel: TypeAlias = tuple[Float64[np.ndarray, " 2"], Float64[np.ndarray, "2 2"]]
"""Column and row in an image, and their covariance in square pixels; they may be outside of the image."""


def target_pixels(report: RegistrationReport, *, stereo: StereoSettings) -> tuple[Pixel, Pixel]:
    """Return where the left and the right camera see the target of a registration.

    Raises `ConfigError` if the registration is not accepted, or the target is behind a camera.
    """
    if report.davinci_to_trus is None:
        raise ConfigError("the points do not fit, so that nobody knows where the target is in the images")
    place_m = np.array(report.target_trus_m)
    covariance_m2 = np.array(report.target_covariance_m2)
    seen = []
    way = davinci_to_probe_home(report.davinci_to_trus).inverse(), stereo.cameras.left_to_right
    for name, camera, step in zip(("left", "right"), (stereo.left, stereo.right), way, strict=True):
        place_m = step.apply(place_m)
        covariance_m2 = step.rotation @ covariance_m2 @ step.rotation.T
        if not place_m[2] > 0:
            raise ConfigError(f"the target is behind the {name} camera; name another by `target_trus_m`")
        seen.append((camera.project(place_m[None])[0], camera.project_covariance(place_m, covariance_m2)))
    return seen[0], seen[1]


def read_registration(path: Path) -> KnownRegistration:
    """The registration in a file.

    ``path``: ``registration.json`` of ``markerseek register``.
    """
    stored = read_json(
        path,
        _File,
        most_bytes=8 * MIB,
        what="a registration as JSON",
        cure="register points, or name the folder of a session",
    )
    if not stored.registered or stored.davinci_to_trus is None:
        raise RecordError(f"{path}: its registration was not accepted ({stored.reason}); register again")
    return KnownRegistration.of(stored, source=path, simulated=stored.simulation is not None)
