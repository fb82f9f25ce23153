"""What the cameras see while a marker is searched: the scene, the tissue around the spot, and the spot on it.

When it looks is up to the room.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, Float64, FrameHeader, Int64, StereoPair, UInt8, as_vector
from markerseek.geometry import Camera
from markerseek.registration.choice import SeenMarker
from markerseek.registration.search_scene import SearchScene
from markerseek.registration.shared_errors import seen_point
from markerseek.registration.spots import SPOT_PAIRS, Looked
from markerseek.registration.stereo_files import StereoSettings
from markerseek.registration.watched_motion import WatchedMotion
from markerseek.vision import (
    LIT_SHARE,
    MOVED_DEG,
    MOVED_MM,
    RETURN_S,
    ClockOffset,
    EndoscopeMoved,
    Moment,
    NotKnown,
    QuickSpot,
    SceneMove,
    SceneTexture,
    SceneWatch,
    SpotSlid,
    TissueMoves,
    ToldApart,
    clock_offset,
    quick_spot,
    told_apart,
)

_MOST_OFFSET_S = 1.0
"""Largest offset of the cameras' clock beyond what the look for the spot has shown of it."""

_MIN_SIGHTINGS = 3
"""Fewest pairs that show the spot, by whose mean it is placed."""

_EXPOSURE_S = 0.05
"""Longest exposure of a pair."""

_FLASH_S = 0.02
"""How much earlier or later than the clocks tell a flash may have been."""

_BESIDE_M = 2e-3
"""Distance of a sighting from the median of all, beyond which it is one of something else."""

_QUICK_PX = 0.15
"""Standard deviation of the middle of a spot that is found quickly, the same in all pairs of one place."""

_STILL_DEG = 0.01
"""Standard deviation of a rotation of the scene where the endoscope has not moved."""

_HALF_PX = 70
"""Half the width of the part of an image in which the spot is looked for: it may slide by that much between two
pairs."""


class SearchWatch:
    """Follows the scene, the tissue around the spot, and the spot while a marker is searched.

    Parameters
    ----------
    texture
        The reference, made of the last pair without light before the search; `NotKnown`: nothing is followed.
    looked
        The spot before the search.
    spot_m
        Its place in the left camera's frame.
    stereo
        Calibration of the cameras.
    """

    def __init__(
        self,
        texture: SceneTexture | NotKnown,
        *,
        looked: Looked,
        spot_m: Float64[np.ndarray, " 3"],
        stereo: StereoSettings,
    ) -> None:
        self._texture = texture
        self._looked = looked
        self._spot_m = spot_m
        self._stereo = stereo
        # The same session sees the same motion: only samples of patches are drawn.
        rng = np.random.default_rng(0)
        self._watch = None if isinstance(texture, NotKnown) else SceneWatch(texture, spot_m=spot_m, rng=rng)
        self._reason = texture.reason if isinstance(texture, NotKnown) else None
        # That of the mean of up to `SPOT_PAIRS` pairs is smaller than that of one by the root of their number.
        self._single_px = looked.spot.sigma_px * SPOT_PAIRS**0.5
        self._lit: deque[StereoPair] = deque(maxlen=2 * SPOT_PAIRS)
        self._firsts: dict[str, QuickSpot | None] = {}
        # Times of pairs on the cameras' clock, and whether they show the spot; of flashes on that of the rig.
        self._blinks = [(pair.at_s, False) for pair in looked.dark] + [(pair.at_s, True) for pair in looked.lit]
        self._flashes_s = list(looked.flashes_s)
        # Where the spot lay on the tissue, as that was at the reference.
        self._on_tissue_m: list[tuple[float, Float64[np.ndarray, " 3"]]] = []

    @property
    def follows(self) -> bool:
        """Whether there is texture to follow."""
        return self._watch is not None

    @property
    def moments(self) -> tuple[Moment, ...]:
        """What was seen so far."""
        return () if self._watch is None else self._watch.moments

    def motion(self, name: str, *, breath: TissueMoves | None) -> WatchedMotion:
        """Return what was seen to move so far, for those who look on.

        ``name``: of the marker. ``breath``: how the tissue breathes, on the cameras' clock; None: it is not known.
        """
        return WatchedMotion.of(name, self._seen(self.clock()), spot_m=self._spot_m, breath=breath)

    @property
    def later(self) -> list[StereoPair]:
        """The last pairs that showed the spot; where nothing is followed, the last pairs."""
        return list(self._lit)

    def keep(self, pairs: Sequence[StereoPair]) -> None:
        """Keep pairs of a scene without texture."""
        self._lit.extend(pairs)

    def look(self, pair: StereoPair) -> None:
        """Look at the newest pair, with the laser's light or without."""
        if self._watch is None:
            self.keep([pair])
            return
        moment = self._watch.look(pair)
        self._reason = self._reason if self._watch.not_known is None else self._watch.not_known.reason
        if moment.tissue is None:
            return
        displacement_m = moment.tissue.value_m
        cameras = self._stereo.cameras
        left_px = self._sighted(pair.left, "left", cameras.left, self._spot_m, displacement_m)
        right_m = cameras.left_to_right.apply(self._spot_m)
        right_px = self._sighted(
            pair.right, "right", cameras.right, right_m, cameras.left_to_right.rotation @ displacement_m
        )
        lit = left_px is not None and right_px is not None
        self._blinks.append((pair.at_s, lit))
        if left_px is None or right_px is None:
            return
        self._lit.append(pair)
        try:
            place_m, covariance_m2, _ = seen_point(
                left_px, right_px, cameras, spot_px=self._single_px, calibration_px=self._stereo.calibration_sigma_px
            )
        except ConfigError:
            # Both images do not show one place: a highlight in one of them.
            return
        self._on_tissue_m.append((pair.at_s, place_m - displacement_m))
        self._watch.place_spot(place_m, covariance_m2, at_s=pair.at_s)

    def _sighted(
        self,
        image: UInt8[np.ndarray, "rows columns"],
        side: str,
        camera: Camera,
        spot_m: Float64[np.ndarray, " 3"],
        displacement_m: Float64[np.ndarray, " 3"],
    ) -> Float64[np.ndarray, " 2"] | None:
        """Return where an image shows the spot, near where the tissue has carried it; None if it does not."""
        was_px = np.rint(getattr(self._looked.spot, f"{side}_px")).astype(int)
        before_px, after_px = camera.project(np.stack([spot_m, spot_m + displacement_m]))
        here_px = was_px + np.rint(after_px - before_px).astype(int)
        dark = _part(getattr(self._looked.dark[-1], side), was_px)
        part = _part(image, here_px)
        if dark is None or part is None:
            return None
        found = quick_spot(part, dark=dark)
        first = self._first(side, was_px, dark)
        if found is None or first is None or found.counts < LIT_SHARE * first.counts:
            return None
        # It has moved in the image by as much as its centroid.
        moved_px = here_px - was_px + [found.x_px - first.x_px, found.y_px - first.y_px]
        return np.asarray(getattr(self._looked.spot, f"{side}_px") + moved_px, dtype=np.float64)

    def _first(
        self, side: str, was_px: Int64[np.ndarray, " 2"], dark: UInt8[np.ndarray, "part part"]
    ) -> QuickSpot | None:
        """Return the mean of the spot over the lit pairs before the search; None if none of them shows it."""
        if side not in self._firsts:
            parts = [_part(getattr(pair, side), was_px) for pair in self._looked.lit]
            spots = [quick_spot(part, dark=dark) for part in parts if part is not None]
            seen = [spot for spot in spots if spot is not None]
            self._firsts[side] = _mean_spot(seen) if seen else None
        return self._firsts[side]

    def fire(self, header: FrameHeader) -> None:
        """Note the flashes of a frame."""
        self._flashes_s.extend(np.linspace(header.started_s, header.ended_s, header.pulses + 1)[:-1].tolist())

    def clock(self) -> ClockOffset | None:
        """Return the offset of the cameras' clock, from the flashes and the pairs that show them."""
        if not self._blinks or not self._flashes_s:
            return None
        pairs_s, lit = np.array(sorted(self._blinks)).T
        within_s = _MOST_OFFSET_S + (self._looked.spot.late_s or 0.0)
        return clock_offset(pairs_s, lit > 0, np.sort(self._flashes_s), within_s=within_s)

    @property
    def is_settled(self) -> bool:
        """Whether it can be told what moved: nothing did lately, a breath came back, or a move stayed long enough."""
        last_s = max((moment.at_s for moment in self.moments), default=0.0)
        moments = sorted(self.moments, key=lambda moment: moment.at_s)
        lately = [moment for moment in moments if moment.scene and moment.at_s > last_s - RETURN_S]
        elsewhere = [_stands_elsewhere(moment, self._spot_m) for moment in lately]
        if not any(elsewhere):
            return True
        told = self._told_apart()
        # One step fits the begin of a breath as well as a move of the endoscope.
        came_back = any(was and not now for was, now in pairwise(elsewhere))
        if came_back and told.tissue and told.tissue[-1].period_s is not None:
            return True
        return bool(told.endoscope) and told.endoscope[-1].until_s <= last_s - RETURN_S

    def _told_apart(self, clock: ClockOffset | None = None) -> ToldApart:
        """Return what moved, told apart: endoscope, tissue and spot."""
        return told_apart(sorted(self._seen(clock), key=lambda moment: moment.at_s))

    def _seen(self, clock: ClockOffset | None) -> list[Moment]:
        """Return what was seen, without what looks like a spot while the laser is dark."""
        return [moment for moment in self.moments if moment.spot is None or self._is_lit(moment.at_s, clock)]

    def _is_lit(self, camera_s: float, clock: ClockOffset | None) -> bool:
        """Whether the laser may have fired in the exposure of a pair."""
        if clock is None or not self._flashes_s:
            return True
        since_s = clock.rig_s(camera_s) - np.array(self._flashes_s)
        return bool(np.any((since_s >= -_FLASH_S) & (since_s <= _EXPOSURE_S + _FLASH_S)))

    def scene(self, clock: ClockOffset | None = None) -> SearchScene:
        """Return what moved, at times of the rig's clock.

        ``clock``: the offset of the cameras' clock; None if it is not known.
        """
        told = self._told_apart(clock)
        tissue = told.tissue[-1] if told.tissue else None
        by_s = 0.0 if clock is None else clock.offset_s
        return SearchScene(
            pairs=sum(moment.spot is None for moment in self.moments),
            known=told.known,
            reason=self._reason if told.known < 1 else None,
            tissue=None if tissue is None else _earlier(tissue, by_s),
            spot=_earlier(told.spot[-1], by_s) if told.spot else None,
            endoscope=tuple(_earlier(each, by_s) for each in told.endoscope),
            end=self._end(told),
            clock=clock,
        )

    def _end(self, told: ToldApart) -> SceneMove | None:
        """Return how the scene lies at the end, where the tissue around the spot rests."""
        since_s = told.endoscope[-1].until_s if told.endoscope else -math.inf
        rested = self._rest(told, since_s)
        if rested is None:
            return None
        rest_m, covariance_m2 = rested
        turned = Rotation.identity()
        covariance = np.diag([_STILL_DEG**2] * 3 + [0.0] * 3)
        for each in told.endoscope:
            turned = Rotation.from_rotvec(each.rotation_deg, degrees=True) * turned
            covariance[:3, :3] += np.array(each.covariance)[:3, :3]
        covariance[3:, 3:] += 1e6 * covariance_m2
        return SceneMove(
            displacement_mm=as_vector(1e3 * rest_m),
            rotation_deg=as_vector(turned.as_rotvec(degrees=True)),
            middle_mm=as_vector(1e3 * (self._spot_m + rest_m)),
            covariance=tuple(tuple(row) for row in covariance.tolist()),
        )

    def _rest(
        self, told: ToldApart, since_s: float
    ) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]] | None:
        """Return the displacement of the tissue at its rest since the last move, and its covariance; None: none."""
        seen = [moment.tissue for moment in self.moments if moment.tissue is not None and moment.at_s >= since_s]
        if told.tissue and told.tissue[-1].until_s > since_s:
            tissue = told.tissue[-1]
            return 1e-3 * np.array(tissue.rest_mm), 1e-6 * np.array(tissue.covariance_mm2)
        if not told.endoscope or not seen:
            return None
        return (
            np.median([each.value_m for each in seen], axis=0),
            np.median([each.covariance_m2 for each in seen], axis=0),
        )

    def at_end(self, seen: SeenMarker, end: SceneMove, *, clock: ClockOffset | None = None) -> SeenMarker:
        """Return the spot at the end of the search, where the tissue rests; ``clock``: as of `scene`.

        It lies there where it lay on the tissue in the mean of all pairs that show it, or before the search if fewer
        than three do.
        """
        place_m = seen.camera_m
        covariance_m2 = seen.camera_covariance_m2
        places_m = [each_m for at_s, each_m in self._on_tissue_m if self._is_lit(at_s, clock)]
        if len(places_m) >= _MIN_SIGHTINGS:
            place_m, covariance_m2 = self._mean_place(np.array(places_m), covariance_m2)
        return replace(
            seen,
            camera_m=place_m + 1e-3 * np.array(end.displacement_mm),
            camera_covariance_m2=covariance_m2 + 1e-6 * np.array(end.covariance)[3:, 3:],
        )

    def _mean_place(
        self, places_m: Float64[np.ndarray, "sightings 3"], covariance_m2: Float64[np.ndarray, "3 3"]
    ) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]]:
        """Return the mean place of the spot on the tissue, with its covariance where it is less than before the search.

        A spot that moved while the cameras looked for it is measured better on the tissue that carried it.
        """
        stereo = self._stereo
        place_m = np.median(places_m, axis=0)
        # Some sightings are of a highlight.
        near = np.linalg.norm(places_m - place_m, axis=1) <= _BESIDE_M
        places_m = places_m[near]
        if len(places_m) < _MIN_SIGHTINGS:
            return place_m, covariance_m2
        sides_px = stereo.cameras.project(places_m)
        scatter_px = float(np.sqrt(np.mean([np.var(side_px, axis=0, ddof=1) for side_px in sides_px])))
        spot_px = math.hypot(scatter_px / math.sqrt(len(places_m)), _QUICK_PX)
        if spot_px < self._looked.spot.sigma_px:
            left_px, right_px = (side_px.mean(axis=0) for side_px in sides_px)
            _, covariance_m2, _ = seen_point(
                left_px, right_px, stereo.cameras, spot_px=spot_px, calibration_px=stereo.calibration_sigma_px
            )
        return np.asarray(places_m.mean(axis=0)), covariance_m2


def _stands_elsewhere(moment: Moment, spot_m: Float64[np.ndarray, " 3"]) -> bool:
    """Whether the scene lies elsewhere than at the reference, by more than what is called at rest."""
    assert moment.scene is not None  # noqa: S101  as it was chosen
    moved_m = float(np.linalg.norm(moment.scene.displacement_m(spot_m[None])[0]))
    turned = Rotation.from_matrix(moment.scene.transform.rotation).magnitude()
    return 1e3 * moved_m >= MOVED_MM or math.degrees(turned) >= MOVED_DEG


def _mean_spot(spots: Sequence[QuickSpot]) -> QuickSpot:
    x_px, y_px, counts = np.mean([(each.x_px, each.y_px, each.counts) for each in spots], axis=0).tolist()
    return QuickSpot(x_px=x_px, y_px=y_px, counts=counts)


_Timed = TypeVar("_Timed", TissueMoves, SpotSlid, EndoscopeMoved)


def _earlier(value: _Timed, by_s: float) -> _Timed:
    """Return what was seen, at the times of a clock that is behind."""
    names = [name for name in ("from_s", "until_s", "pause_at_s") if getattr(value, name, None) is not None]
    return structs.replace(value, **{name: getattr(value, name) - by_s for name in names})


def _part(
    image: UInt8[np.ndarray, "rows columns"], middle_px: Int64[np.ndarray, " 2"]
) -> UInt8[np.ndarray, "part part"] | None:
    """Return the part of an image around a pixel (x, y); None if it is not all in the image."""
    x, y = middle_px.tolist()
    rows, columns = image.shape
    if not (_HALF_PX <= x < columns - _HALF_PX and _HALF_PX <= y < rows - _HALF_PX):
        return None
    return image[y - _HALF_PX : y + _HALF_PX + 1, x - _HALF_PX : x + _HALF_PX + 1]
