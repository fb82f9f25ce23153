"""The tissue around a marker as the cameras follow it, for the search: a `markerseek.core.FollowedTissue`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from msgspec import structs
from scipy.spatial.transform import Rotation

from markerseek.core import Clock, Displacement, Float64, as_matrix, as_vector
from markerseek.registration.poses import Poses
from markerseek.registration.room import FOLLOW_S
from markerseek.vision import ClockOffset, Moment, Sighting, TissueMoves

MIN_RESTS = 2
"""Fewest pairs in a pause by which the rest of the tissue is placed."""

RESTS_WITHIN_MM = 0.1
"""Distance from the end of exhalation within which the tissue is at its rest."""

PAUSES_WITHIN_MM = 0.25
"""Distance from it within which the tissue pauses."""

MOST_LEFT_MM = 0.1
"""Largest error of a displacement, by that of the rotation, with which nothing has to wait for a pause."""

_LOW = 0.1
"""Quantile of the places of a breath that is the end of exhalation: there it stays longest."""

_MOST_BETWEEN_S = 0.5
"""Longest time between two pairs between which the begin of a pause is seen."""

MOST_TURNED_DEG = 30.0
"""Largest standard deviation of the rotation between camera and probe with which a displacement has a direction."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraRotation:
    """The rotation from the left camera's frame to that of the probe."""

    matrix: Float64[np.ndarray, "3 3"]
    sigma_rad: float
    """Standard deviation about each axis."""

    @classmethod
    def of(cls, poses: Poses | None) -> CameraRotation | None:
        """Return the rotation that the possible poses agree on; None if they do not."""
        if poses is None:
            return None
        rotations = Rotation.from_matrix(poses.rotations)
        mean = rotations.mean()
        away = (mean.inv() * rotations).magnitude()
        sigma_rad = float(np.sqrt(np.mean(away**2) / 3))
        return cls(matrix=mean.as_matrix(), sigma_rad=sigma_rad) if sigma_rad <= np.radians(MOST_TURNED_DEG) else None


class FollowedScene(Protocol):
    """What follows the scene: a `SearchWatch`, or what it saw."""

    @property
    def moments(self) -> tuple[Moment, ...]:
        """What was seen so far."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenScene:
    """What a watch saw, without its images."""

    moments: tuple[Moment, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTissue:
    """Tissue whose breath was seen at an earlier marker, while the next one is searched."""

    watch: FollowedScene
    """What follows it."""
    clock: Clock
    """That of the rig."""
    offset: ClockOffset
    """Offset of the cameras' clock."""
    breath: TissueMoves
    """Its breath, at times of the rig's clock."""
    rotation: CameraRotation | None
    """None: it is not known in which direction of the probe's frame the tissue moves."""
    waits: bool = True
    """Whether light waits for the pause, unless displacements are taken out as well as a pause would do."""

    @property
    def known_after_s(self) -> float:
        """Time from a moment until its displacement is known, in seconds."""
        # A pair that is followed lies on either side of each moment.
        return max(self.offset.offset_s, 0.0) + 2 * FOLLOW_S

    @property
    def is_taken_out(self) -> bool:
        """Whether displacements are known so well that they are as good as a pause."""
        if self.rotation is None:
            return False
        return 2 * self.breath.amplitude_mm * self.rotation.sigma_rad <= MOST_LEFT_MM

    @property
    def breath_s(self) -> float | None:
        """Time from breath to breath in seconds; None if it has no period, or nothing has to wait for it."""
        return self.breath.period_s if self._gates else None

    @property
    def pause_s(self) -> float:
        """Time in seconds in which it rests between two breaths; 0 where nothing has to wait for that."""
        return self.breath.pause_s if self._gates else 0.0

    @property
    def _gates(self) -> bool:
        return self.waits and not self.is_taken_out

    def rests(self, for_s: float) -> bool | None:
        """Return whether it stays in its pause for so many seconds, if this breath is as long as the others.

        It is in step with the last pause whose begin was seen.
        """
        if self.breath.period_s is None:
            return None
        now_s = self.clock.now_s()
        breath = structs.replace(self.breath, pause_at_s=self._pause_at_s())
        return for_s <= breath.pause_s and breath.in_pause(now_s) and breath.in_pause(now_s + for_s)

    def _pause_at_s(self) -> float | None:
        """Return when the last pause began that was seen to begin, on the rig's clock; else as it was seen before."""
        way_mm = self._way_mm()
        near = way_mm <= PAUSES_WITHIN_MM
        times_s = np.array([at_s for at_s, _ in self._seen()])
        if not self._is_whole(way_mm):
            return self.breath.pause_at_s
        begins = np.flatnonzero(near[1:] & ~near[:-1] & (np.diff(times_s) <= _MOST_BETWEEN_S))
        if not begins.size:
            return self.breath.pause_at_s
        return float(times_s[begins[-1] : begins[-1] + 2].mean()) - self.offset.offset_s

    def _is_whole(self, way_mm: Float64[np.ndarray, " pairs"]) -> bool:
        """Return whether a whole breath was seen, as far as its depth tells."""
        return way_mm.size > 0 and float(way_mm.max()) >= self.breath.amplitude_mm

    def _way_mm(self) -> Float64[np.ndarray, " pairs"]:
        """Return how far the tissue was from its end of exhalation in each pair, in the direction of its breath."""
        seen = self._seen()
        if not seen:
            return np.zeros(0)
        along_mm = 1e3 * np.array([sighting.value_m for _, sighting in seen]) @ np.array(self.breath.direction)
        return np.asarray(along_mm - np.quantile(along_mm, _LOW))

    @property
    def rest_is_known(self) -> bool:
        """Whether the tissue was seen at its rest since the search began."""
        return self._rest() is not None

    def displacement(self, at_s: float) -> Displacement | None:
        """Return the displacement of the tissue from its rest at a moment of the rig's clock.

        None if it was not seen then.
        """
        rest = self._rest()
        seen = self._seen()
        camera_s = at_s + self.offset.offset_s
        if rest is None or not seen[0][0] <= camera_s <= seen[-1][0]:
            return None
        times_s = [time_s for time_s, _ in seen]
        values_m = np.array([sighting.value_m for _, sighting in seen])
        away_m = np.array([np.interp(camera_s, times_s, axis) for axis in values_m.T]) - rest.value_m
        nearest = seen[int(np.argmin(np.abs(np.array(times_s) - camera_s)))][1]
        away_mm = 1e3 * away_m
        covariance_mm2 = 1e6 * (nearest.covariance_m2 + rest.covariance_m2)
        square_mm2 = float(away_mm @ away_mm)
        if self.rotation is None:
            return Displacement(mm=(0.0, 0.0, 0.0), covariance_mm2=as_matrix(covariance_mm2 + square_mm2 * np.eye(3)))
        turned = self.rotation.matrix
        across_mm2 = self.rotation.sigma_rad**2 * (square_mm2 * np.eye(3) - np.outer(away_mm, away_mm))
        return Displacement(
            mm=as_vector(turned @ away_mm),
            covariance_mm2=as_matrix(turned @ (covariance_mm2 + across_mm2) @ turned.T),
        )

    def _seen(self) -> list[tuple[float, Sighting]]:
        """Return what was seen of the tissue, at times of the cameras' clock."""
        return [(moment.at_s, moment.tissue) for moment in self.watch.moments if moment.tissue is not None]

    def _rest(self) -> Sighting | None:
        """Return where the tissue rests, as it was seen since the search began: in a whole breath, or in its pauses."""
        seen = self._seen()
        way_mm = self._way_mm()
        if self._is_whole(way_mm):
            rests = [sighting for (_, sighting), mm in zip(seen, way_mm, strict=True) if abs(mm) <= RESTS_WITHIN_MM]
        else:
            rests = [sighting for at_s, sighting in seen if self.breath.in_pause(at_s - self.offset.offset_s)]
        if len(rests) < MIN_RESTS:
            return None
        return Sighting(
            value_m=np.mean([each.value_m for each in rests], axis=0),
            covariance_m2=np.mean([each.covariance_m2 for each in rests], axis=0) / len(rests),
        )
