"""Markers of a registration with drawn geometry and errors, without images and searches, which take a minute."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from msgspec import structs

from markerseek.core import Float64, Interval, MarkerCandidate, MarkerPosition, SpotToSource
from markerseek.geometry import OFFSET_FACTORS
from markerseek.geometry.registration import DOUBT, WIDER
from markerseek.registration import RegistrationReport, StereoSettings
from markerseek.registration.choice import SeenMarker
from markerseek.registration.poses import Place, Reach
from markerseek.registration.report import davinci_to_probe_home
from markerseek.registration.shared_errors import BASE_LENGTH, FOCAL_LENGTH, seen_point, trus_shared_m
from markerseek.sim import camera_above, endoscope

CAMERAS = endoscope()
STEREO = StereoSettings.of(CAMERAS, calibration_sigma_px=0.2)
LIMITS = Interval(low_deg=-35.0, high_deg=35.0)
REACH = Reach(angles=LIMITS, lateral_m=21.8e-3)
"""That of the usual simulated rig."""

MISSED_M = 2e-3
"""By how much a place that is asked for is missed along each axis: standard deviation."""

SPOT_PX = 0.1
SIGMA_M = (0.05e-3, 0.05e-3, 0.05e-3)
"""Errors of a search on a point, along the turn, the array and in depth."""

TISSUE_M = 60e-3


class ForgedScene:
    """A camera above tissue and a probe below it, with shared errors: all drawn by the seed."""

    search_factor = 1.0
    pixel_factor = 1.0
    """``search_factor``, ``pixel_factor``: factors of the errors of searches and of pixels that are drawn."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.true = camera_above(
            np.array([0.0, 0.0, TISSUE_M]),
            distance_m=0.1,
            roll_deg=self.rng.uniform(-60, 60),
            tilt_deg=self.rng.uniform(25, 35),
        )
        *self.shared, focal = self.rng.standard_normal(4).tolist()
        pixels = [f / (1 + FOCAL_LENGTH * focal) for f in CAMERAS.left.focal_px]
        lens = structs.replace(CAMERAS.left, focal_px=(pixels[0], pixels[1]))
        self.cameras = replace(CAMERAS, left=lens, right=lens)

    def place(self, across_m: float = 25e-3, along_m: float = 15e-3) -> Float64[np.ndarray, " 3"]:
        """Anywhere on the tissue, within these distances."""
        return self.at(self.rng.uniform(-across_m, across_m), self.rng.uniform(-along_m, along_m))

    def wide(self, count: int) -> list[Float64[np.ndarray, " 3"]]:
        """Points that are 10 mm or more apart, and not on a line."""
        while True:
            spots = [self.place() for _ in range(count)]
            apart = min(float(np.linalg.norm(a - b)) for i, a in enumerate(spots) for b in spots[:i])
            length, width = np.linalg.svd(np.array(spots) - np.mean(spots, axis=0), compute_uv=False)[:2]
            if apart > 10e-3 and width > 0.3 * length:
                return spots

    def lit(self, place: Place | None) -> Float64[np.ndarray, " 3"]:
        """Where a person lights the tissue who is asked for a place; None: for any."""
        if place is None:
            return self.place(TISSUE_M * math.sin(math.radians(LIMITS.width_deg / 4)), REACH.lateral_m / 2)
        origin_m = self.true.translation_m
        towards = self.true.rotation @ np.array(place.camera_m)
        there_m = origin_m + towards * (TISSUE_M - origin_m[2]) / towards[2]
        return self.at(*(there_m[:2] + MISSED_M * self.rng.standard_normal(2)).tolist())

    def at(self, x_m: float, y_m: float) -> Float64[np.ndarray, " 3"]:
        """A point of the uneven tissue."""
        return np.array([x_m, y_m, TISSUE_M + self.rng.uniform(-2.5e-3, 2.5e-3)])

    def error_m(self, report: RegistrationReport) -> float | None:
        """How far a registration puts its target from where it is; None where it is not accepted."""
        if report.davinci_to_trus is None:
            return None
        target_m = np.array(report.target_trus_m)
        found = davinci_to_probe_home(report.davinci_to_trus)
        return float(np.linalg.norm(found.apply(self.true.inverse().apply(target_m)) - target_m))

    def heard(self, spot_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 3"]:
        """Where a probe with its shared errors finds a spot."""
        return np.asarray(spot_m + trus_shared_m(spot_m[None])[0] @ self.shared)

    def candidate(self, spot_m: Float64[np.ndarray, " 3"], probability: float = 1.0) -> MarkerCandidate:
        """A source there, as a search finds it."""
        x, y, z = self.heard(spot_m).tolist()
        axes = MarkerPosition(position_m=(x, y, z), sigma_m=SIGMA_M).axes
        drawn_m = self.search_factor * np.array(SIGMA_M) * self.rng.standard_normal(3)
        x, y, z = (np.array([x, y, z]) + axes.T @ drawn_m).tolist()
        position = MarkerPosition(position_m=(x, y, z), sigma_m=SIGMA_M)
        return MarkerCandidate(angle_deg=math.degrees(math.atan2(x, z)), probability=probability, position=position)

    def other(self, spot_m: Float64[np.ndarray, " 3"], probability: float) -> MarkerCandidate:
        """Another source, anywhere in reach and 5 mm or more from the spot."""
        while True:
            angle = math.radians(self.rng.uniform(-35, 35))
            radius_m = self.rng.uniform(35e-3, 70e-3)
            x = radius_m * math.sin(angle)
            z = radius_m * math.cos(angle)
            there_m = np.array([x, self.rng.uniform(-15e-3, 15e-3), z])
            if np.linalg.norm(there_m - spot_m) > 5e-3:
                return self.candidate(there_m, probability)

    def seen(
        self, name: str, spot_m: Float64[np.ndarray, " 3"], candidates: Sequence[MarkerCandidate] | None = None
    ) -> SeenMarker:
        """The marker of a spot, with its own source alone where no candidates are given."""
        exact = self.cameras.project(self.true.inverse().apply(spot_m)[None])
        sigma_px = self.pixel_factor * math.hypot(SPOT_PX, STEREO.calibration_sigma_px)
        left_px, right_px = (pixels[0] + sigma_px * self.rng.standard_normal(2) for pixels in exact)
        camera_m, covariance_m2, shared_m = seen_point(
            left_px, right_px, STEREO.cameras, spot_px=SPOT_PX, calibration_px=STEREO.calibration_sigma_px
        )
        return SeenMarker(
            name=name,
            candidates=(self.candidate(spot_m),) if candidates is None else tuple(candidates),
            camera_m=camera_m,
            camera_covariance_m2=covariance_m2,
            camera_shared_m=shared_m,
        )

    def markers(self, spots: Sequence[Float64[np.ndarray, " 3"]]) -> list[SeenMarker]:
        """A marker with its own source for each spot."""
        return [self.seen(str(number), spot) for number, spot in enumerate(spots, start=1)]


SHARED = ("focal length", "base", "vergence", "sound speed", "face radius", "zero")
"""Errors that all markers share, one of which may be `WIDER` times as large as assumed."""

SOURCES = (*SHARED, "other shifts", "depth", "offset", "pixels", "search")
"""All sources of error."""


class PriorScene(ForgedScene):
    """A scene whose errors are all drawn from the priors of a registration.

    ``sources``: those that act; the others are zero. ``doubt``: whether one of the shared errors may be larger than it
    is assumed, as the registration believes. ``spot``: the prior of the way from the spot to its source.
    ``wrong``: relative errors that are not drawn, by the name of their source.
    """

    def __init__(
        self,
        seed: int,
        *,
        sources: Sequence[str] = SOURCES,
        doubt: bool = True,
        spot: SpotToSource | None = None,
        wrong: Mapping[str, float] | None = None,
    ) -> None:
        super().__init__(seed)
        spot = spot or SpotToSource()
        self._more = np.random.default_rng((seed, 2))
        drawn = dict(zip(SHARED, self._more.standard_normal(len(SHARED)).tolist(), strict=True))
        doubted = SHARED[int(self._more.integers(len(SHARED)))]
        if self._more.random() < DOUBT and doubt:
            drawn[doubted] *= WIDER
        drawn = {name: value if name in sources else 0.0 for name, value in drawn.items()}
        for name, sigma in (("focal length", FOCAL_LENGTH), ("base", BASE_LENGTH)):
            drawn[name] = (wrong or {}).get(name, drawn[name] * sigma) / sigma
        both_px, left_px, right_px, depth, size = self._more.standard_normal(5).tolist()
        shifts_px = np.array([[both_px, left_px], [both_px, right_px]]) * ("other shifts" in sources)
        # One of the four shifts of the images, their difference across, is the vergence.
        across = np.array([[-1.0, 0.0], [1.0, 0.0]]) * drawn["vergence"]
        shifts_px = STEREO.calibration_sigma_px * (shifts_px / [math.sqrt(2), 1.0] + across / math.sqrt(2))
        self.shared = [drawn["sound speed"], drawn["face radius"], drawn["zero"]]
        self._depth_m = spot.depth_m + spot.depth_sigma_m * depth * ("depth" in sources)
        factor = OFFSET_FACTORS[1] if size > 0 else 1 / OFFSET_FACTORS[0]
        self._offset_m = spot.offset_sigma_m * factor ** abs(size) * ("offset" in sources)
        self._sources_m: dict[tuple[float, ...], Float64[np.ndarray, " 3"]] = {}
        self.search_factor = float("search" in sources)
        self.pixel_factor = float("pixels" in sources)
        focal_px = [each / (1 + FOCAL_LENGTH * drawn["focal length"]) for each in CAMERAS.left.focal_px]
        left, right = (
            structs.replace(
                camera,
                focal_px=(focal_px[0], focal_px[1]),
                centre_px=(camera.centre_px[0] + x_px, camera.centre_px[1] + y_px),
            )
            for camera, (x_px, y_px) in zip((CAMERAS.left, CAMERAS.right), shifts_px.tolist(), strict=True)
        )
        base = CAMERAS.left_to_right
        base = replace(base, translation_m=base.translation_m / (1 + BASE_LENGTH * drawn["base"]))
        self.cameras = replace(CAMERAS, left=left, right=right, left_to_right=base)

    def heard(self, spot_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, " 3"]:
        """Where a probe with its shared errors finds the source of a spot."""
        key = tuple(spot_m.tolist())
        if key not in self._sources_m:
            sight = spot_m - self.true.translation_m
            beside_m = self._offset_m * self._more.standard_normal(3)
            self._sources_m[key] = spot_m + self._depth_m * sight / np.linalg.norm(sight) + beside_m
        return super().heard(self._sources_m[key])
