"""Watches a scene while a search or a session runs: every pair is compared with a reference, and what moved is told."""

from __future__ import annotations

import numpy as np

from markerseek.core import Float64, StereoPair
from markerseek.vision.scene_motion import SceneFollower, SceneSeen
from markerseek.vision.texture import NotKnown, SceneTexture
from markerseek.vision.told_apart import Moment, Sighting, ToldApart, told_apart


class SceneWatch:
    """Collects what two cameras see of a scene, of the tissue around the laser's spot, and of the spot.

    It knows no clock and no thread: hand it each pair as it comes, in the order of time. A pair takes some 30 ms.

    Parameters
    ----------
    texture
        The reference, made by `scene_texture` of a pair without the laser's light.
    spot_m
        Place of the spot in the left camera's frame, at the time of the reference.
    rng
        Draws the samples of patches that are tried.

    Examples
    --------
    ::

        texture = scene_texture(dark_pair, cameras)
        if isinstance(texture, SceneTexture):
            watch = SceneWatch(texture, spot_m=spot_m, rng=rng)
            for pair in pairs:
                watch.look(pair)
            for move in watch.told().endoscope:
                point_m, covariance_m2 = move.carried(point_m, covariance_m2)
    """

    def __init__(self, texture: SceneTexture, *, spot_m: Float64[np.ndarray, " 3"], rng: np.random.Generator) -> None:
        self._follower = SceneFollower(texture, rng=rng)
        self._spot_m = spot_m
        self._moments: list[Moment] = []
        self._not_known: NotKnown | None = None

    @property
    def moments(self) -> tuple[Moment, ...]:
        """What was seen so far."""
        return tuple(self._moments)

    @property
    def not_known(self) -> NotKnown | None:
        """Why the motion of the scene is not known from the last pair; None if it is."""
        return self._not_known

    def look(self, pair: StereoPair) -> Moment:
        """Look at a pair without the laser's light, and return what it shows."""
        seen = self._follower.follow(pair)
        motion = seen.motion if isinstance(seen, SceneSeen) else seen
        self._not_known = motion if isinstance(motion, NotKnown) else None
        moment = Moment(
            at_s=pair.at_s,
            scene=None if isinstance(motion, NotKnown) else motion,
            tissue=self._tissue(seen) if isinstance(seen, SceneSeen) else None,
        )
        self._moments.append(moment)
        return moment

    def place_spot(
        self, place_m: Float64[np.ndarray, " 3"], covariance_m2: Float64[np.ndarray, "3 3"], *, at_s: float
    ) -> None:
        """Note where the spot was seen, in the left camera's frame."""
        self._moments.append(Moment(at_s=at_s, spot=Sighting(value_m=place_m, covariance_m2=covariance_m2)))

    def told(self, *, gate_mm: float = 0.2) -> ToldApart:
        """Tell apart what moved so far; see `told_apart`."""
        return told_apart(sorted(self._moments, key=lambda moment: moment.at_s), gate_mm=gate_mm)

    def _tissue(self, seen: SceneSeen) -> Sighting | None:
        """Return the displacement of the tissue around the spot; where it has too little texture, that of the scene."""
        found = seen.displacement_near(self._spot_m)
        if found is not None:
            return Sighting(value_m=found[0], covariance_m2=found[1])
        if isinstance(seen.motion, NotKnown):
            return None
        point_m = self._spot_m[None]
        return Sighting(
            value_m=seen.motion.displacement_m(point_m)[0], covariance_m2=seen.motion.covariances_m2(point_m)[0]
        )
