"""Rigid transform from one named frame to another, in metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, Float64

_ORTHONORMAL = 1e-6
"""Largest deviation of R Rᵀ from the identity: a matrix printed with seven digits passes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigidTransform:
    """Transform ``AToB``: it maps coordinates of a point in frame A to those in frame B, p_B = R p_A + t."""

    source: str
    target: str
    """``source`` and ``target``: names of A and B, for example "DaVinci" and "ProbeHome"."""
    rotation: Float64[np.ndarray, "3 3"]
    """Rotation matrix R."""
    translation_m: Float64[np.ndarray, " 3"]
    """Translation t, in frame B."""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.rotation).all() and np.isfinite(self.translation_m).all()):
            raise ConfigError(f"{self.name}: the matrix holds a number that is not finite; leave out points with NaN")
        deviation = float(np.abs(self.rotation @ self.rotation.T - np.eye(3)).max())
        if not deviation <= _ORTHONORMAL:
            raise ConfigError(
                f"{self.name}: the rows of the rotation are off orthonormal by {deviation:.2g}, at most "
                f"{_ORTHONORMAL:g} is allowed; it must be a rotation without scale"
            )
        if np.linalg.det(self.rotation) < 0:
            raise ConfigError(f"{self.name}: the matrix mirrors space; both frames must be right-handed")

    @property
    def name(self) -> str:
        """Name of the transform, ``AToB``."""
        return f"{self.source}To{self.target}"

    @property
    def matrix(self) -> Float64[np.ndarray, "4 4"]:
        """Homogeneous matrix; the last column is in metres."""
        matrix = np.eye(4)
        matrix[:3, :3] = self.rotation
        matrix[:3, 3] = self.translation_m
        return matrix

    def apply(self, points_m: Float64[np.ndarray, "*points 3"]) -> Float64[np.ndarray, "*points 3"]:
        """Return the coordinates in frame B of points in frame A, in metres."""
        return np.asarray(points_m @ self.rotation.T + self.translation_m)

    def inverse(self) -> RigidTransform:
        """Return the transform ``BToA``."""
        back = self.rotation.T
        return RigidTransform(
            source=self.target, target=self.source, rotation=back.copy(), translation_m=-back @ self.translation_m
        )

    def __matmul__(self, first: RigidTransform) -> RigidTransform:
        """``BToC @ AToB`` is ``AToC``; frames that do not meet are refused."""
        if first.target != self.source:
            raise ConfigError(
                f"{self.name} after {first.name}: the first ends in {first.target} and the second begins in "
                f"{self.source}; invert one of them, or name the frames alike"
            )
        return RigidTransform(
            source=first.source,
            target=self.target,
            rotation=self.rotation @ first.rotation,
            translation_m=self.rotation @ first.translation_m + self.translation_m,
        )
