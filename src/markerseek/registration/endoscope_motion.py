"""Whether the endoscope has moved between two markers, from image pairs without the laser's light.

The cameras see how the scene lies in their own frame. If it lies elsewhere than at an earlier marker, the endoscope has
moved against the tissue; which of the two moved in the room cannot be told from two pairs.
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, Float64, StereoPair
from markerseek.geometry import RigidTransform, StereoCameras, StereoMotion, motion_about
from markerseek.vision import NotKnown, SceneFollower, SceneSeen, SceneTexture, scene_texture

MOVED_MM = 0.25
MOVED_DEG = 0.15
"""Least displacement and rotation of the scene that are called a move: half of what must be noticed."""

Vector: TypeAlias = tuple[float, float, float]


class EndoscopeMotion(msgspec.Struct, frozen=True, kw_only=True, tag="known"):
    """How the scene lies in the camera's frame, compared with an earlier marker."""

    since: str
    """Name of the marker with whose images it was compared."""
    after: str
    """Name of the last marker before."""
    displacement_mm: Vector
    """Displacement of the middle of the scene."""
    rotation_deg: Vector
    """Rotation of the scene: its axis, times its angle."""
    middle_mm: Vector
    """Where that middle is now."""
    covariance: tuple[tuple[float, ...], ...]
    """Covariance of the rotation about the middle (deg) and of its displacement (mm); shape (6, 6)."""

    def __post_init__(self) -> None:
        # Also of a record: its check sums say that it was not damaged, not that its numbers are possible.
        numbers = np.array([self.displacement_mm, self.rotation_deg, self.middle_mm])
        if not (np.abs(numbers) <= _FARTHEST).all():
            raise ConfigError(f"the motion of the scene is {numbers.tolist()}, within ± {_FARTHEST:g} is possible")
        shape = {len(row) for row in self.covariance}
        if len(self.covariance) != 6 or shape != {6} or not np.linalg.eigvalsh(np.array(self.covariance))[0] > 0:
            raise ConfigError(f"covariance is {self.covariance}, which is none of a motion: 6 x 6, positive")

    @classmethod
    def of(cls, motion: StereoMotion, *, since: str, after: str) -> EndoscopeMotion:
        """Return the motion that the cameras saw."""
        units = np.diag([*[np.degrees(1.0)] * 3, *[1e3] * 3])
        middle_m = motion.middle_m
        before_m = motion.transform.inverse().apply(middle_m)
        return cls(
            since=since,
            after=after,
            displacement_mm=_vector(1e3 * (middle_m - before_m)),
            rotation_deg=_vector(np.degrees(Rotation.from_matrix(motion.transform.rotation).as_rotvec())),
            middle_mm=_vector(1e3 * middle_m),
            covariance=tuple(tuple(row) for row in (units @ motion.covariance @ units).tolist()),
        )

    @property
    def state(self) -> Literal["at rest", "moved"]:
        """Whether the endoscope stands where it stood, in two words."""
        return "moved" if self.moved_mm >= MOVED_MM or self.turned_deg >= MOVED_DEG else "at rest"

    @property
    def moved_mm(self) -> float:
        """How far the middle of the scene was displaced."""
        return float(np.linalg.norm(self.displacement_mm))

    @property
    def turned_deg(self) -> float:
        """By which angle the scene was turned."""
        return float(np.linalg.norm(self.rotation_deg))

    @property
    def said(self) -> str:
        """The motion in a sentence."""
        by = (
            f"{self.moved_mm:.2f} ± {self._sigma(self.displacement_mm, slice(3, 6)):.2f} mm and "
            f"{self.turned_deg:.2f} ± {self._sigma(self.rotation_deg, slice(0, 3)):.2f} deg against the tissue"
        )
        if self.state == "moved":
            return f"the endoscope has moved after marker {self.after}, by {by}"
        return f"the endoscope stands where it stood at marker {self.since}: moved by {by}"

    def _sigma(self, vector: Vector, which: slice) -> float:
        """Return the standard deviation of the length of a displacement or rotation, along its direction."""
        covariance = np.array(self.covariance)[which, which]
        length = float(np.linalg.norm(vector))
        along = np.array(vector) / length if length > 0 else np.array([1.0, 0.0, 0.0])
        return float(np.sqrt(along @ covariance @ along))

    @property
    def shown(self) -> dict[str, object]:
        """The motion for other programs."""
        values: dict[str, object] = msgspec.to_builtins(self)
        return values | {"state": self.state, "said": self.said}

    @property
    def transform(self) -> RigidTransform:
        """Map where a point was in the camera's frame to where it is now."""
        return motion_about(
            1e-3 * np.array(self.middle_mm),
            rotation_deg=np.array(self.rotation_deg),
            displacement_m=1e-3 * np.array(self.displacement_mm),
        )

    @property
    def sigmas(self) -> Float64[np.ndarray, "6 6"]:
        """Rotations about the middle (rad) and displacements (m) by one standard deviation of independent errors."""
        return np.diag([*[np.radians(1.0)] * 3, *[1e-3] * 3]) @ np.linalg.cholesky(np.array(self.covariance))


_FARTHEST = 1e4
"""Largest number of a motion, in mm or deg."""


class EndoscopeNotKnown(msgspec.Struct, frozen=True, kw_only=True, tag="not-known"):
    """The images do not show whether the endoscope has moved."""

    after: str
    """Name of the last marker before."""
    reason: str
    """Why, with the numbers."""

    @property
    def state(self) -> Literal["not known"]:
        """The same in two words."""
        return "not known"

    @property
    def said(self) -> str:
        """The same in a sentence."""
        return f"it is not known whether the endoscope has moved after marker {self.after}: {self.reason}"

    @property
    def shown(self) -> dict[str, object]:
        """The same for other programs."""
        values: dict[str, object] = msgspec.to_builtins(self)
        return values | {"state": self.state, "said": self.said}


SeenEndoscope: TypeAlias = EndoscopeMotion | EndoscopeNotKnown
"""What the cameras show of the endoscope's own motion."""


class EndoscopeWatch:
    """Compares image pairs with those of earlier markers.

    Each pair is compared with the first pair of each place where the endoscope has stood, the latest place first, so
    that small errors do not add up, and a place to which the endoscope comes back is recognised.
    """

    def __init__(self, cameras: StereoCameras) -> None:
        self._cameras = cameras
        # The same session sees the same motion: only samples of patches are drawn.
        self._rng = np.random.default_rng(0)
        self._places: dict[str, SceneFollower | NotKnown] = {}

    def begin(self, name: str, pair: StereoPair | None) -> None:
        """Note a pair as that of a new place of the endoscope.

        ``name``: of the marker. ``pair``: without the laser's light; None: it was not kept.
        """
        texture: SceneTexture | NotKnown
        if pair is None:
            texture = NotKnown(at_s=0.0, cause="hidden", reason="its images without light were not kept")
        else:
            texture = scene_texture(pair, self._cameras)
        self._places[name] = SceneFollower(texture, rng=self._rng) if isinstance(texture, SceneTexture) else texture

    def look(self, pair: StereoPair, *, after: str) -> SeenEndoscope | None:
        """Return how the endoscope has moved; None if there was no place before.

        ``pair``: without the laser's light. ``after``: name of the last marker.
        """
        reasons = []
        for name, place in reversed(self._places.items()):
            if isinstance(place, NotKnown):
                reasons.append(f"at marker {name}, {place.reason}")
                continue
            seen = place.follow(pair)
            motion = seen.motion if isinstance(seen, SceneSeen) else seen
            if not isinstance(motion, NotKnown):
                return EndoscopeMotion.of(motion, since=name, after=after)
            reasons.append(motion.reason)
        return EndoscopeNotKnown(after=after, reason=reasons[0]) if reasons else None


def _vector(values: Float64[np.ndarray, " 3"]) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
