"""A rigid move of the scene in the left camera's frame, as it is stored, and what it does to points."""

from __future__ import annotations

import msgspec
import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import ConfigError, Float64, Vector, as_vector
from markerseek.geometry import RigidTransform, StereoMotion, effect_of_motion, motion_about

MOVED_MM = 0.25
MOVED_DEG = 0.15
"""Least displacement and rotation that are called a move of the endoscope: half of what must be noticed."""

_FARTHEST = 1e4
"""Largest number of a motion, in mm or deg."""


class SceneMove(msgspec.Struct, frozen=True, kw_only=True):
    """How a scene lies in the camera's frame, compared with an earlier time."""

    displacement_mm: Vector
    """Displacement of the middle of the scene."""
    rotation_deg: Vector
    """Rotation of the scene: its axis, times its angle."""
    middle_mm: Vector
    """Where that middle is afterwards."""
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

    @staticmethod
    def of(motion: StereoMotion) -> SceneMove:
        """Return the motion that the cameras saw."""
        units = np.diag([*[np.degrees(1.0)] * 3, *[1e3] * 3])
        before_m = motion.transform.inverse().apply(motion.middle_m)
        covariance = units @ motion.covariance @ units
        return _move(before_m, motion.middle_m, motion.transform.rotation, covariance)

    @property
    def moved_mm(self) -> float:
        """How far the middle of the scene was displaced."""
        return float(np.linalg.norm(self.displacement_mm))

    @property
    def turned_deg(self) -> float:
        """By which angle the scene was turned."""
        return float(np.linalg.norm(self.rotation_deg))

    @property
    def is_move(self) -> bool:
        """Whether this is more than what is called at rest."""
        return self.moved_mm >= MOVED_MM or self.turned_deg >= MOVED_DEG

    @property
    def by(self) -> str:
        """Displacement and rotation in words, with their standard deviations."""
        return (
            f"{self.moved_mm:.2f} ± {self._sigma(self.displacement_mm, slice(3, 6)):.2f} mm and "
            f"{self.turned_deg:.2f} ± {self._sigma(self.rotation_deg, slice(0, 3)):.2f} deg"
        )

    def _sigma(self, vector: Vector, which: slice) -> float:
        """Return the standard deviation of the length of a displacement or rotation, along its direction."""
        covariance = np.array(self.covariance)[which, which]
        length = float(np.linalg.norm(vector))
        along = np.array(vector) / length if length > 0 else np.array([1.0, 0.0, 0.0])
        return float(np.sqrt(along @ covariance @ along))

    @property
    def transform(self) -> RigidTransform:
        """Map where a point was in the camera's frame to where it is afterwards."""
        return motion_about(
            1e-3 * np.array(self.middle_mm),
            rotation_deg=np.array(self.rotation_deg),
            displacement_m=1e-3 * np.array(self.displacement_mm),
        )

    @property
    def sigmas(self) -> Float64[np.ndarray, "6 6"]:
        """Rotations about the middle (rad) and displacements (m) by one standard deviation of independent errors."""
        return np.diag([*[np.radians(1.0)] * 3, *[1e-3] * 3]) @ np.linalg.cholesky(np.array(self.covariance))

    def effect_m(self, after_m: Float64[np.ndarray, " 3"]) -> Float64[np.ndarray, "3 6"]:
        """Return the displacements of a point after the move by its `sigmas`."""
        away_m = after_m - 1e-3 * np.array(self.middle_mm)
        return np.asarray(effect_of_motion(away_m[None])[0] @ self.sigmas)

    def carried(
        self, point_m: Float64[np.ndarray, " 3"], covariance_m2: Float64[np.ndarray, "3 3"]
    ) -> tuple[Float64[np.ndarray, " 3"], Float64[np.ndarray, "3 3"]]:
        """Return where a point from before the move is after it, and its covariance, with that of the move."""
        transform = self.transform
        after_m = transform.apply(point_m)
        effect_m = self.effect_m(after_m)
        rotation = transform.rotation
        return after_m, rotation @ covariance_m2 @ rotation.T + effect_m @ effect_m.T

    def then(self, later: SceneMove) -> SceneMove:
        """Return this move and a later one as one, with the errors of both, which are independent."""
        middle_m = later.transform.apply(1e-3 * np.array(self.middle_mm))
        before_m = self.transform.inverse().apply(1e-3 * np.array(self.middle_mm))
        turned = later.transform.rotation
        rotation = turned @ self.transform.rotation
        own = np.kron(np.eye(2), turned)
        effect = np.eye(6)
        effect[3:] = effect_of_motion((1e3 * middle_m - np.array(later.middle_mm))[None])[0]
        effect[3:, :3] *= np.radians(1.0)
        covariance = own @ np.array(self.covariance) @ own.T + effect @ np.array(later.covariance) @ effect.T
        return _move(before_m, middle_m, rotation, covariance)

    def back(self) -> SceneMove:
        """Return the move from afterwards to before."""
        middle_m = 1e-3 * np.array(self.middle_mm)
        back = self.transform.inverse()
        own = np.kron(np.eye(2), back.rotation)
        return _move(middle_m, back.apply(middle_m), back.rotation, own @ np.array(self.covariance) @ own.T)


def _move(
    before_m: Float64[np.ndarray, " 3"],
    after_m: Float64[np.ndarray, " 3"],
    rotation: Float64[np.ndarray, "3 3"],
    covariance: Float64[np.ndarray, "6 6"],
) -> SceneMove:
    """Return the move that brings a middle from one place to another."""
    return SceneMove(
        displacement_mm=as_vector(1e3 * (after_m - before_m)),
        rotation_deg=as_vector(np.degrees(Rotation.from_matrix(rotation).as_rotvec())),
        middle_mm=as_vector(1e3 * after_m),
        covariance=tuple(tuple(row) for row in ((covariance + covariance.T) / 2).tolist()),
    )
