"""The tissue around the spot as the cameras see it during a search, in the frame of the probe.

Displacements are seen in the left camera's frame. Which rotations of it to the probe are possible follows from the
markers so far: a displacement is the mean over them, with its scatter as an error. Before the first marker all
rotations are possible, and a displacement is 0 with an error of its size in any direction.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from markerseek.core import Clock, Displacement, Float64
from markerseek.registration.poses import Poses
from markerseek.vision import ClockOffset, Moment, TissueMoves

_KNOWN_AFTER_S = 0.3
"""Time after which the cameras have seen the tissue at a moment: a pair every 0.15 s, which comes later by its exposure
and its way."""

_GAP_S = 0.5
"""Time between two pairs that see the tissue from which it is not known what it did in between."""

_OFFSET_SIGMA_S = 0.05
"""Standard deviation of the cameras' clock where the laser's blinking has not shown it: they are late by up to that."""


class TissueInView:
    """Tissue that the cameras follow: a `FollowedTissue`.

    Its rest is where the tissue was in the pair before the search: there the spot was placed.

    Parameters
    ----------
    moments
        Returns what the cameras have seen so far, in the order of time.
    clock
        Clock of the rig.
    poses
        Possible poses of the camera, by the markers so far; None: any.
    offset
        Offset of the cameras' clock; None: not known.
    breath
        How the tissue was last seen to breathe, on the rig's clock; None: not known.
    """

    known_after_s = _KNOWN_AFTER_S

    def __init__(
        self,
        moments: Callable[[], Sequence[Moment]],
        clock: Clock,
        *,
        poses: Poses | None = None,
        offset: ClockOffset | None = None,
        breath: TissueMoves | None = None,
    ) -> None:
        self._moments = moments
        self._clock = clock
        self._offset_s = 0.0 if offset is None else offset.offset_s
        self._offset_sigma_s = _OFFSET_SIGMA_S if offset is None else offset.sigma_s
        self._breath = breath
        # Means of R and of its products over the poses: of a turn about any axis, 0 and those of an isotropic one.
        self._mean = np.zeros((3, 3))
        self._products = np.einsum("ij,ab->iajb", np.eye(3), np.eye(3)) / 3
        if poses is not None:
            self._mean = poses.rotations.mean(axis=0)
            self._products = np.einsum("kia,kjb->iajb", poses.rotations, poses.rotations) / len(poses.rotations)

    @property
    def breath_s(self) -> float | None:
        """Time from breath to breath."""
        return None if self._breath is None else self._breath.period_s

    @property
    def pause_s(self) -> float:
        """Length of the pause between two breaths."""
        return 0.0 if self._breath is None else self._breath.pause_s

    def rests(self, for_s: float) -> bool | None:
        """Whether it stays in its pause, as far as it breathes on as it did."""
        if self._breath is None or self._breath.period_s is None:
            return None
        now_s = self._clock.now_s()
        return self._breath.in_pause(now_s) and self._breath.in_pause(now_s + for_s)

    def displacement(self, at_s: float) -> Displacement | None:
        """Return the displacement since the pair before the search, between the pairs before and after a moment."""
        seen = [moment for moment in self._moments() if moment.tissue is not None]
        at_s += self._offset_s
        before = next((each for each in reversed(seen) if each.at_s <= at_s), None)
        after = next((each for each in seen if each.at_s > at_s), None)
        if before is None or after is None or after.at_s - before.at_s > _GAP_S:
            return None
        assert before.tissue is not None  # noqa: S101 - of those that see it
        assert after.tissue is not None  # noqa: S101 - as above
        lasts_s = after.at_s - before.at_s
        share = (at_s - before.at_s) / lasts_s
        way_mm = 1e3 * (after.tissue.value_m - before.tissue.value_m)
        camera_mm = 1e3 * before.tissue.value_m + share * way_mm
        late_mm = way_mm / lasts_s * self._offset_sigma_s
        covariance_mm2 = 1e6 * ((1 - share) * before.tissue.covariance_m2 + share * after.tissue.covariance_m2)
        return self._in_trus(camera_mm, covariance_mm2 + np.outer(late_mm, late_mm))

    def _in_trus(
        self, camera_mm: Float64[np.ndarray, " 3"], covariance_mm2: Float64[np.ndarray, "3 3"]
    ) -> Displacement:
        """Return a displacement in the frame of the probe, over all poses."""
        mean_mm = self._mean @ camera_mm
        squares_mm2 = np.outer(camera_mm, camera_mm) + covariance_mm2
        spread_mm2 = np.einsum("iajb,ab->ij", self._products, squares_mm2) - np.outer(mean_mm, mean_mm)
        x, y, z = mean_mm.tolist()
        first, second, third = ((float(row[0]), float(row[1]), float(row[2])) for row in spread_mm2)
        return Displacement(mm=(x, y, z), covariance_mm2=(first, second, third))
