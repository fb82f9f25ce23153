"""Where the camera may stand, from the markers so far: what it predicts of the next spot, and where that helps most.

From three markers on, the poses are drawn from the registration and its covariance. One or two leave rotations open:
they are drawn evenly among those in which the camera looks at the tissue from the side that the probe looks to, and
brings the spots to their markers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import AnglePrior, ConfigError, Float64, Interval, SpotToSource, as_vector
from markerseek.geometry import (
    MIN_POINTS,
    Registration,
    StereoCameras,
    registration_errors,
)
from markerseek.registration.choice import Choice, SeenMarker, chosen_pairs
from markerseek.registration.report import PointPair, default_target, motion_m, registered_pairs
from markerseek.registration.shared_errors import seen_point, source_shared_m, trus_shared_m
from markerseek.registration.stereo_files import StereoSettings
from markerseek.rigs import Rig

DRAWS = 4000
"""Poses that are drawn where rotations are open; a known registration needs a tenth."""

MOST_SLANT_DEG = 75.0
"""Largest angle between the camera's line of sight and the straight way from the tissue to the probe."""

USUAL_ROLL_DEG = 60.0
UNUSUAL = 0.1
"""Largest angle between the rows of the image and the way across the probe, to either side, that is usual: people hold
an endoscope upright, and look at what the probe can reach. How likely it is otherwise, in comparison."""

DEPTHS_M = (10e-3, 90e-3)
"""Least and largest distance of a marker from the axis of the probe."""

_LEAST_SIGMA_DEG = 0.3
"""Least standard deviation of an angle that is predicted."""

BIN_DEG = 1.0
"""Width of the bins of a predicted density."""

KNOWN_SHARE = 0.7
"""Share of the range beyond which a prediction leaves nothing out."""

EDGE_DEG = 5.0
EDGE_PX = 60
"""Distance from the ends of the range, in degrees, and from the edges of both images, in pixels, of a place that is
proposed."""

APART_M = 10e-3
CORNER_APART_M = 15e-3
"""Least distance of a place that is proposed from the spots before, once a spot lies near each corner that can be
reached, and until then."""

LEAST_CORNERS = 2
"""Markers from which corners are asked for: two show the roll of the camera to some degrees."""

SURE = 0.95
FAIRLY_SURE = 0.7
"""Least probability that a corner is in reach: by a registration, and by two markers, which leave one rotation open."""

MISSED = 0.1
"""Probability that a marker in reach is not found."""

NEARLY = 0.03
"""Share of the expected TRE by which a place may be worse than the best, if the probe is nearer to it."""

FAR_M = 35e-3
"""Distance from the spots before, and from the line through them, that is wanted while there is no registration."""

_GRID = (24, 20)
"""Columns and rows of the places in the left image that are compared."""

_USUAL_LATERAL_M = 15e-3
"""Reach along the array of a probe whose array is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Reach of the probe."""

    angles: Interval
    """Angles that may be searched."""
    lateral_m: float
    """Largest distance of a marker from the middle of the array, along it."""

    def holds(
        self,
        angle_deg: Float64[np.ndarray, " points"],
        lateral_m: Float64[np.ndarray, " points"],
        radius_m: Float64[np.ndarray, " points"],
    ) -> Float64[np.ndarray, " points"]:
        """1 where a marker can be found, 0 elsewhere."""
        inside = (angle_deg > self.angles.low_deg + EDGE_DEG) & (angle_deg < self.angles.high_deg - EDGE_DEG)
        inside &= (radius_m > DEPTHS_M[0]) & (radius_m < DEPTHS_M[1]) & (np.abs(lateral_m) < self.lateral_m)
        return np.asarray(inside.astype(float))


def reach_of(rig: Rig) -> Reach:
    """Return the reach of a rig's probe: its search range, and four fifths of its array."""
    lateral_m = _USUAL_LATERAL_M
    if rig.imaging is not None:
        lateral_m = 0.8 * float(rig.imaging.preset.array.lateral_m[-1])
    return Reach(angles=rig.limits.search, lateral_m=lateral_m)


class Place(msgspec.Struct, frozen=True, kw_only=True):
    """A place for the next spot."""

    left_px: tuple[float, float]
    right_px: tuple[float, float]
    """``left_px`` and ``right_px``: where both cameras see it."""
    camera_m: tuple[float, float, float]
    """The place in the frame of the left camera."""
    tre_m: float | None
    """Expected TRE at the target with a marker there; None before there is a registration."""


class Prediction(msgspec.Struct, frozen=True, kw_only=True):
    """Prediction for a spot from the markers so far."""

    prior: AnglePrior
    lateral_m: float
    radius_m: float
    """``lateral_m`` and ``radius_m``: where it probably is along the array, and its distance from the axis."""
    sigma_m: float
    """Standard deviation of the position, root mean square."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _InView:
    """A place of the tissue that both cameras see."""

    left_px: Float64[np.ndarray, " 2"]
    right_px: Float64[np.ndarray, " 2"]
    camera_m: Float64[np.ndarray, " 3"]
    share: float
    """Probability that the probe reaches it."""
    angle_deg: float
    lateral_m: float
    """``angle_deg`` and ``lateral_m``: where it is for the probe, in the middle of all poses."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poses:
    """Possible transforms from the camera to the probe."""

    rotations: Float64[np.ndarray, "poses 3 3"]
    translations_m: Float64[np.ndarray, "poses 3"]
    pairs: tuple[PointPair, ...]
    """The points by which they were drawn."""
    registration: Registration | None
    """Registration of these points; None where rotations are open."""
    spot: SpotToSource
    """Where the light of a spot is absorbed."""

    @classmethod
    def of(
        cls,
        markers: Sequence[SeenMarker],
        choice: Choice,
        reach: Reach,
        *,
        missed_m: Sequence[Float64[np.ndarray, " 3"]] = (),
        spot: SpotToSource | None = None,
        rng: np.random.Generator,
    ) -> Poses | None:
        """Return the poses that the markers allow; None before the first.

        ``missed_m``: spots in the camera's frame whose markers were not found: they were probably out of reach.
        ``spot``: as of `register_pairs`.
        """
        spot = spot or SpotToSource()
        pairs = chosen_pairs(markers, choice.chosen)
        if len(pairs) >= MIN_POINTS and choice.report is not None:
            return cls._registered(tuple(pairs), spot, rng=rng)
        # Of more that lie on a line, or do not fit, the first two.
        pairs = pairs[: MIN_POINTS - 1]
        if not pairs:
            return None
        camera_m = np.array([pair.camera_m for pair in pairs])
        trus_m = np.array([pair.trus_m for pair in pairs])
        rotations = Rotation.random(DRAWS, random_state=rng)
        if len(pairs) == MIN_POINTS - 1:
            # Turned so that the line between the spots is that between the markers; about it, any rotation is left.
            between_m = rotations.apply(camera_m[1] - camera_m[0])
            rotations = _turning(between_m, trus_m[1] - trus_m[0]) * rotations
        matrices = rotations.as_matrix()
        outwards = trus_m.mean(axis=0) * (1, 0, 1)
        slant = -(matrices[:, :, 2] @ outwards) / np.linalg.norm(outwards)
        matrices = matrices[slant > math.cos(math.radians(MOST_SLANT_DEG))]
        translations_m = trus_m.mean(axis=0) - matrices @ camera_m.mean(axis=0)
        upright = np.abs(matrices[:, 0, 0]) > math.cos(math.radians(USUAL_ROLL_DEG))
        # Where the middle of the image is: on tissue as deep as the spots, seen from the probe.
        ahead_m = matrices[:, :, 2] * _depth_ahead(matrices, camera_m.mean(axis=0), outwards)[:, None] + translations_m
        likely = np.where(upright, 1.0, UNUSUAL) * np.where(reach.holds(*_polar(ahead_m)) > 0, 1.0, UNUSUAL)
        for spot_m in missed_m:
            likely *= 1 - (1 - MISSED) * reach.holds(*_polar(matrices @ spot_m + translations_m))
        kept = rng.random(len(matrices)) < likely
        if not kept.any():
            return None
        return cls(
            rotations=matrices[kept],
            translations_m=translations_m[kept],
            pairs=tuple(pairs),
            registration=None,
            spot=spot,
        )

    @classmethod
    def _registered(cls, pairs: tuple[PointPair, ...], spot: SpotToSource, *, rng: np.random.Generator) -> Poses:
        found = registered_pairs(pairs, spot=spot)
        covariance = found.errors.covariance[:6, :6] * found.scale**2
        steps = rng.multivariate_normal(np.zeros(6), covariance, size=DRAWS // 10)
        turns = Rotation.from_rotvec(steps[:, :3]).as_matrix()
        middle_m = found.errors.middle_m
        moved_m = turns @ (found.transform.translation_m - middle_m) + middle_m + steps[:, 3:]
        rotations = turns @ found.transform.rotation
        return cls(rotations=rotations, translations_m=moved_m, pairs=pairs, registration=found, spot=spot)

    def positions(self, camera_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "poses 3"]:
        """Return where a point of the camera's frame is in that of the probe, for each pose."""
        return np.asarray(self.rotations @ camera_m + self.translations_m)

    def predict(
        self, camera_m: Float64[np.ndarray, " 3"], covariance_m2: Float64[np.ndarray, "3 3"], *, limits: Interval
    ) -> Prediction | None:
        """Return the prediction for a spot from the poses; None if they leave most of the range open.

        ``camera_m``, ``covariance_m2``: the spot, as both cameras see it. ``limits``: angles that may be searched.
        """
        trus_m = self.positions(camera_m)
        angle_deg, lateral_m, radius_m = _polar(trus_m)
        possible = (radius_m > DEPTHS_M[0]) & (radius_m < DEPTHS_M[1])
        if not possible.any():
            return None
        angle_deg = angle_deg[possible]
        lateral_m = lateral_m[possible]
        radius_m = radius_m[possible]
        spot_m = math.sqrt(float(np.trace(covariance_m2)) / 3)
        spot_deg = math.degrees(spot_m / float(np.median(radius_m)))
        sigma_m = math.hypot(float(trus_m[possible].std(axis=0).max()), spot_m)
        place = {"lateral_m": float(np.median(lateral_m)), "radius_m": float(np.median(radius_m)), "sigma_m": sigma_m}
        if self.registration is not None:
            sigma_deg = max(math.hypot(float(angle_deg.std()), spot_deg), _LEAST_SIGMA_DEG)
            mean_deg = float(angle_deg.mean())
            # A prior wholly outside of the range says that the spot cannot be reached, and not where it is.
            near_deg = limits.nearest(mean_deg)
            if abs(mean_deg - near_deg) > 3 * sigma_deg:
                return None
            prior = _prior(lambda: AnglePrior(mean_deg=near_deg, sigma_deg=sigma_deg), limits)
            return None if prior is None else Prediction(prior=prior, **place)
        edges_deg = np.arange(limits.low_deg, limits.high_deg + BIN_DEG, BIN_DEG)
        counts, _ = np.histogram(angle_deg, bins=edges_deg)
        # The errors of marker and spot blur it.
        kernel = np.exp(-0.5 * (np.arange(-3, 4) * BIN_DEG / (1.0 + spot_deg)) ** 2)
        weights = np.convolve(counts, kernel / kernel.sum(), mode="same")
        if not weights.any() or np.mean(weights > 0.01 * weights.max()) > KNOWN_SHARE:
            return None
        middles_deg = (edges_deg[:-1] + edges_deg[1:]) / 2
        prior = _prior(lambda: AnglePrior.of_table(middles_deg.tolist(), weights.tolist()), limits)
        return None if prior is None else Prediction(prior=prior, **place)

    def best_place(
        self,
        stereo: StereoSettings,
        reach: Reach,
        *,
        target_trus_m: tuple[float, float, float] | None,
        probe_deg: float,
        avoid_m: Sequence[Float64[np.ndarray, " 3"]] = (),
    ) -> Place | None:
        """Return the place for the next spot; None if nothing is in reach.

        From the second marker on, a corner of what probe and cameras reach; once all are taken, the place that lowers
        the expected TRE at the target most. Before: a place that is far from the spot and probably in reach.
        ``probe_deg``: where the probe is, in degrees. ``avoid_m``: points in the camera's frame near which no marker
        was found.
        """
        spots_m = np.array([pair.camera_m for pair in self.pairs])
        taken_m = np.concatenate([spots_m, np.array([*avoid_m]).reshape(-1, 3)])
        seen = self._in_view(stereo, reach, spots_m)
        wanted = self._corners(seen, reach, taken_m)
        if not wanted:
            apart_m = CORNER_APART_M if len(self.pairs) < MIN_POINTS else APART_M
            wanted = [each for each in seen if np.linalg.norm(taken_m - each.camera_m, axis=1).min() >= apart_m]
        found: list[tuple[float, float, Place]] = []
        for each in wanted:
            tre_m = None
            if self.registration is None:
                worth = each.share * _new_span(spots_m, each.camera_m)
            elif each.share < SURE:
                continue
            else:
                calibration_px = stereo.calibration_sigma_px
                tre_m = self._tre_with(
                    each.camera_m, each.left_px, each.right_px, stereo.cameras, calibration_px, target_trus_m
                )
                worth = -tre_m
            place = Place(
                left_px=_pair(each.left_px),
                right_px=_pair(each.right_px),
                camera_m=as_vector(each.camera_m),
                tre_m=tre_m,
            )
            found.append((worth, abs(each.angle_deg - probe_deg), place))
        if not found:
            return None
        most = max(worth for worth, _, _ in found)
        # Of places that are nearly as good, the one to which the probe turns least.
        good = [each for each in found if each[0] >= most - NEARLY * abs(most)]
        return min(good, key=lambda each: each[1])[2]

    def check_place(self, stereo: StereoSettings, reach: Reach) -> Place | None:
        """Return the place nearest to the middle of the spots that is in reach and beside each; None if there is none.

        The target is usually under the middle, and an error there is what a check is to show.
        """
        spots_m = np.array([pair.camera_m for pair in self.pairs])
        middle_m = spots_m.mean(axis=0)
        beside = [
            each
            for each in self._in_view(stereo, reach, spots_m)
            if each.share >= SURE and np.linalg.norm(spots_m - each.camera_m, axis=1).min() >= APART_M
        ]
        if not beside:
            return None
        nearest = min(beside, key=lambda each: float(np.linalg.norm(each.camera_m - middle_m)))
        return Place(
            left_px=_pair(nearest.left_px),
            right_px=_pair(nearest.right_px),
            camera_m=as_vector(nearest.camera_m),
            tre_m=None,
        )

    def _in_view(self, stereo: StereoSettings, reach: Reach, spots_m: Float64[np.ndarray, "spots 3"]) -> list[_InView]:
        """Return the places of the tissue that both cameras see, on a grid."""
        found = []
        for left_px, ray in _lines_of_sight(stereo):
            points_m = self._on_tissue(ray, spots_m)
            camera_m = np.median(points_m, axis=0)
            right_px = _seen_right(stereo.cameras, camera_m)
            if right_px is None:
                continue
            trus_m = np.einsum("nij,nj->ni", self.rotations, points_m) + self.translations_m
            angle_deg, lateral_m, radius_m = _polar(trus_m)
            found.append(
                _InView(
                    left_px=left_px,
                    right_px=right_px,
                    camera_m=camera_m,
                    share=float(np.mean(reach.holds(angle_deg, lateral_m, radius_m))),
                    angle_deg=float(np.median(angle_deg)),
                    lateral_m=float(np.median(lateral_m)),
                )
            )
        return found

    def _corners(self, seen: Sequence[_InView], reach: Reach, taken_m: Float64[np.ndarray, "taken 3"]) -> list[_InView]:
        """Return the places nearest to the corners of what probe and cameras reach, near which no spot was lit."""
        if len(self.pairs) < LEAST_CORNERS:
            return []
        sure = SURE if self.registration is not None else FAIRLY_SURE
        inside = [each for each in seen if each.share >= sure]
        if not inside:
            return []
        half_deg = reach.angles.width_deg / 2
        across = np.array([(each.angle_deg - reach.angles.centre_deg) / half_deg for each in inside])
        along = np.array([each.lateral_m / reach.lateral_m for each in inside])
        corners = []
        for left, low in ((-1, -1), (-1, 1), (1, 1), (1, -1)):
            corner = inside[int(np.argmin(np.hypot(across - left, along - low)))]
            if np.linalg.norm(taken_m - corner.camera_m, axis=1).min() >= CORNER_APART_M:
                corners.append(corner)
        return corners

    def _on_tissue(
        self, ray: Float64[np.ndarray, " 3"], spots_m: Float64[np.ndarray, "spots 3"]
    ) -> Float64[np.ndarray, "poses 3"]:
        """Return where a line of sight meets the tissue, by each pose.

        The tissue is taken for the plane through the spots; before there are three, for that which faces the probe.
        """
        middle_m = spots_m.mean(axis=0)
        if len(spots_m) >= MIN_POINTS:
            normals = np.linalg.svd(spots_m - middle_m)[2][2][None]
        else:
            outwards = (self.positions(middle_m) * (1, 0, 1))[:, None, :]
            normals = (outwards @ self.rotations)[:, 0]
        across = normals @ ray
        depth_m = (normals @ middle_m) / np.where(np.abs(across) > 1e-9, across, 1e-9)
        return np.broadcast_to(depth_m[:, None] * ray, (len(self.rotations), 3))

    def _tre_with(
        self,
        camera_m: Float64[np.ndarray, " 3"],
        left_px: Float64[np.ndarray, " 2"],
        right_px: Float64[np.ndarray, " 2"],
        cameras: StereoCameras,
        calibration_px: float,
        target_trus_m: tuple[float, float, float] | None,
    ) -> float:
        """Return the expected TRE at the target with one more marker, as well known as those before."""
        found = self.registration
        assert found is not None  # noqa: S101  the caller asks for places of a registration only
        rotation = found.transform.rotation
        _, covariance_m2, shared_m = seen_point(
            left_px, right_px, cameras, spot_px=_SPOT_PX, calibration_px=calibration_px
        )
        trus_m = np.array([pair.trus_m for pair in self.pairs])
        from_trus = np.array([pair.trus_covariance_m2 for pair in self.pairs])
        from_camera = np.array([*(pair.camera_covariance_m2 for pair in self.pairs), covariance_m2])
        cameras_m = np.array([*(pair.camera_m for pair in self.pairs), camera_m])
        camera_shared = source_shared_m(
            cameras_m, np.array([*(pair.camera_shared_m for pair in self.pairs), shared_m]), self.spot
        )
        points_m = np.concatenate([trus_m, found.transform.apply(camera_m)[None]])
        offset_m2 = (found.offset_sigma_m or 0.0) ** 2 * np.eye(3)
        from_trus = np.concatenate([from_trus, from_trus.mean(axis=0)[None]]) + offset_m2
        noise = rotation @ from_camera @ rotation.T + from_trus
        motion = motion_m(self.pairs)
        # The camera stands where it sees the new place: no motion displaces it.
        motion = np.concatenate([motion, np.zeros((1, *motion.shape[1:]))])
        shared = np.concatenate([-rotation @ camera_shared, -rotation @ motion, trus_shared_m(points_m)], axis=2)
        errors = registration_errors(points_m, noise, np.linalg.inv(noise), shared_m=shared)
        target_m = default_target(points_m) if target_trus_m is None else target_trus_m
        return errors.tre_m(np.array(target_m)) * found.scale


def _prior(made: Callable[[], AnglePrior], limits: Interval) -> AnglePrior | None:
    """Return a prior; None if a search of these angles would refuse it, because it says nothing about them.

    Markers that do not fit give a registration whose covariance is scaled up by their misfit.
    """
    try:
        prior = made()
        prior.interval(limits)
    except ConfigError:
        return None
    return prior


_SPOT_PX = 0.1
"""Standard deviation that is expected of a spot in the images."""


def _turning(from_m: Float64[np.ndarray, "poses 3"], to_m: Float64[np.ndarray, " 3"]) -> Rotation:
    """Return the shortest rotations that turn vectors into the direction of another one."""
    start = from_m / np.linalg.norm(from_m, axis=1)[:, None]
    end = to_m / np.linalg.norm(to_m)
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=1)
    angle = np.arctan2(sine, start @ end)
    return Rotation.from_rotvec(axis * (angle / np.maximum(sine, 1e-12))[:, None])


def _polar(
    trus_m: Float64[np.ndarray, "points 3"],
) -> tuple[Float64[np.ndarray, " points"], Float64[np.ndarray, " points"], Float64[np.ndarray, " points"]]:
    """Return the angle in degrees, position along the array and distance from the axis in metres."""
    x, y, z = trus_m.T
    return np.degrees(np.arctan2(x, z)), y, np.hypot(x, z)


def _depth_ahead(
    rotations: Float64[np.ndarray, "poses 3 3"], spot_m: Float64[np.ndarray, " 3"], outwards: Float64[np.ndarray, " 3"]
) -> Float64[np.ndarray, " poses"]:
    """Return the distance straight before the camera at which the tissue is, which faces the probe."""
    normals = outwards @ rotations
    return np.asarray((normals @ spot_m) / normals[:, 2])


def _lines_of_sight(
    stereo: StereoSettings,
) -> list[tuple[Float64[np.ndarray, " 2"], Float64[np.ndarray, " 3"]]]:
    """Return the pixels of a grid over the left image, and their lines of sight."""
    width, height = stereo.left.size_px
    columns = np.linspace(EDGE_PX, width - 1 - EDGE_PX, _GRID[0])
    rows = np.linspace(EDGE_PX, height - 1 - EDGE_PX, _GRID[1])
    pixels = np.array([(x, y) for y in rows for x in columns])
    try:
        direct = stereo.left.undistort(pixels)
    except ConfigError:
        # A distortion that cannot be inverted near the edges of the image: its inner half.
        size = np.array((width, height))
        pixels = pixels[(np.abs(pixels - size / 2) < size / 4).all(axis=1)]
        direct = stereo.left.undistort(pixels)
    return [(pixel, np.array([x, y, 1.0])) for pixel, (x, y) in zip(pixels, direct, strict=True)]


def _seen_right(cameras: StereoCameras, camera_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 2"] | None:
    """Return the pixel of a point in the right image; None if it does not see it."""
    there_m = cameras.left_to_right.apply(camera_m)
    if not (camera_m[2] > 0 and there_m[2] > 0):
        return None
    pixel = cameras.right.project(there_m[None])[0]
    inside = (pixel > EDGE_PX) & (pixel < np.array(cameras.right.size_px) - 1 - EDGE_PX)
    return pixel if inside.all() else None


def _new_span(spots_m: Float64[np.ndarray, "spots 3"], camera_m: Float64[np.ndarray, " 3"]) -> float:
    """Return how far a place is from the spot before, or the least height of its triangle with two; at most `FAR_M`."""
    apart_m = np.linalg.norm(spots_m - camera_m, axis=1)
    if len(spots_m) == 1:
        return min(float(apart_m[0]), FAR_M)
    along = spots_m[1] - spots_m[0]
    longest_m = max(float(apart_m.max()), float(np.linalg.norm(along)))
    return min(float(np.linalg.norm(np.cross(along, camera_m - spots_m[0]))) / longest_m, FAR_M)


def _pair(pixel: Float64[np.ndarray, " 2"]) -> tuple[float, float]:
    x, y = pixel.tolist()
    return x, y
