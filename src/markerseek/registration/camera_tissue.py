"""The tissue around a marker as the cameras follow it, for the search: a `markerseek.core.FollowedTissue`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from markerseek.core import Clock, Displacement, Float64, as_matrix, as_vector
from markerseek.registration.poses import Poses
from markerseek.registration.room import FOLLOW_S
from markerseek.registration.search_watch import SearchWatch
from markerseek.vision import ClockOffset, Sighting, TissueMoves

MIN_RESTS = 2
"""Fewest pairs in a pause by which the rest of the tissue is placed."""

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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraTissue:
    """Tissue whose breath was seen at an earlier marker, while the next one is searched."""

    watch: SearchWatch
    """What follows it."""
    clock: Clock
    """That of the rig."""
    offset: ClockOffset
    """Offset of the cameras' clock."""
    breath: TissueMoves
    """Its breath, at times of the rig's clock."""
    rotation: CameraRotation | None
    """None: it is not known in which direction of the probe's frame the tissue moves."""

    @property
    def known_after_s(self) -> float:
        """Time from a moment until its displacement is known, in seconds."""
        # A pair that is followed lies on either side of each moment.
        return max(self.offset.offset_s, 0.0) + 2 * FOLLOW_S

    @property
    def breath_s(self) -> float | None:
        """Time from breath to breath in seconds; None if it has no period."""
        return self.breath.period_s

    @property
    def pause_s(self) -> float:
        """Time in seconds in which it rests between two breaths."""
        return self.breath.pause_s

    def rests(self, for_s: float) -> bool | None:
        """Whether it stays in its pause from now on, for so many seconds, as far as it breathes as it did."""
        if self.breath.period_s is None:
            return None
        now_s = self.clock.now_s()
        return for_s <= self.breath.pause_s and self.breath.in_pause(now_s) and self.breath.in_pause(now_s + for_s)

    @property
    def rest_is_known(self) -> bool:
        """Whether the tissue was seen at its rest since the search began."""
        return self._rest() is not None

    def displacement(self, at_s: float) -> Displacement | None:
        """Displacement of the tissue from its rest at a moment of the rig's clock; None if it was not seen then."""
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
        """Return where the tissue rests, as it was seen in its pauses since the search began."""
        rests = [sighting for at_s, sighting in self._seen() if self.breath.in_pause(at_s - self.offset.offset_s)]
        if len(rests) < MIN_RESTS:
            return None
        return Sighting(
            value_m=np.mean([each.value_m for each in rests], axis=0),
            covariance_m2=np.mean([each.covariance_m2 for each in rests], axis=0) / len(rests),
        )
