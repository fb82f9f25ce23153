"""The tip of an instrument as a robot reports it, and a point that a person names: sources that need no light."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from markerseek.core import Clock, ConfigError, Float64, is_finite, require_range
from markerseek.drivers import PoseReader
from markerseek.following.target import ErrorLinks, Target

TIP_SIGMA_M = 0.2e-3
"""Standard deviation of a reported tip from one message to the next, along each direction. What the links of the arm
are off by is the same in all messages, and known only where somebody states it."""

LARGEST_SIGMA_MM = 20.0
"""Largest standard deviation of an arm that is accepted: with more it points nowhere."""


class RobotTip:
    """A `TargetSource` of the poses of a robot in the frame of the left camera.

    A pose whose time stamp does not advance was sent again, and is not heard. The clocks may differ: a stamp counts
    from the message that came soonest after its own.

    ``offset_mm``: from the frame that it reports to the tip, in that frame. ``sigma_mm``: standard deviation of the tip
    along each direction by what is the same in all messages: links of the arm, its base frame, the offset; None: nobody
    states it. ``on_note``: receives sentences for people.
    """

    def __init__(
        self,
        poses: PoseReader,
        clock: Clock,
        *,
        offset_mm: tuple[float, float, float],
        sigma_mm: float | None = None,
        on_note: Callable[[str], None],
    ) -> None:
        if sigma_mm is not None:
            require_range("sigma_mm", sigma_mm, low=0, high=LARGEST_SIGMA_MM, unit="mm")
        if not all(is_finite(each) for each in offset_mm):
            raise ConfigError(f"tool_offset_mm is {offset_mm}, its coordinates must be finite")
        self.name = f"the tip by {poses.name}"
        self._poses = poses
        self._clock = clock
        self._offset_mm = np.array(offset_mm)
        self._sigma_mm = sigma_mm
        self._on_note = on_note
        self._noted = False
        self._heard_s = clock.now_s()
        self._stamp_s = -math.inf
        self._behind_s = math.inf
        # Messages that wait until the rig is armed are old by then.
        first = poses.read()
        if first is not None:
            self._is_new(first.stamp_s)

    def newest(self) -> Target | None:
        """Return the tip of the newest pose since the last call; None: none came, or it is old or not valid."""
        pose = self._poses.read()
        if pose is None or not self._is_new(pose.stamp_s):
            return None
        if pose.matrix is None:
            return None
        place_mm = pose.matrix[:3, :3] @ self._offset_mm + pose.matrix[:3, 3]
        sigma_m = 1e-3 * (self._sigma_mm or 0.0)
        return Target(
            at_s=self._heard_s,
            camera_m=1e-3 * place_mm,
            covariance_m2=np.eye(3) * TIP_SIGMA_M**2,
            shared_m2=np.eye(3) * sigma_m**2,
        )

    @property
    def links(self) -> ErrorLinks:
        """Which links between the camera and the tip are in the uncertainty of a target."""
        noise = f"the pose from one message to the next, ± {1e3 * TIP_SIGMA_M:g} mm"
        arm = "the joints and links of the arm, its base frame, and the offset of the tool"
        if self._sigma_mm is None:
            return ErrorLinks(counted=(noise,), not_counted=(arm,))
        return ErrorLinks(counted=(noise, f"{arm}: ± {self._sigma_mm:g} mm together, as it was stated"))

    def _is_new(self, stamp_s: float | None) -> bool:
        """Take the time of a pose; whether it is later than that of all before."""
        now_s = self._clock.now_s()
        if stamp_s is None:
            if not self._noted:
                self._noted = True
                self._on_note(f"{self.name}: its messages have no time, so that an old pose sent again is not noticed")
            self._heard_s = now_s
            return True
        if not stamp_s > self._stamp_s:
            return False
        self._stamp_s = stamp_s
        self._behind_s = min(self._behind_s, now_s - stamp_s)
        self._heard_s = stamp_s + self._behind_s
        return True

    @property
    def heard_s(self) -> float:
        """Of when the newest pose is."""
        return self._heard_s

    def close(self) -> None:
        """Leave the network; allowed twice."""
        self._poses.close()


class FixedPoint:
    """A `TargetSource` of one point of the left camera's frame, which a person named."""

    def __init__(self, clock: Clock, *, camera_mm: tuple[float, float, float]) -> None:
        if not all(is_finite(each) for each in camera_mm):
            raise ConfigError(f"point is {camera_mm} mm, its coordinates must be finite")
        self.name = "the point {:g}, {:g}, {:g} mm of the left camera".format(*camera_mm)
        self._clock = clock
        self._camera_m: Float64[np.ndarray, " 3"] = 1e-3 * np.array(camera_mm)

    def newest(self) -> Target:
        """Return the point, as the camera stood when it was named."""
        return Target(at_s=self._clock.now_s(), camera_m=self._camera_m, covariance_m2=np.zeros((3, 3)), named=1)

    @property
    def heard_s(self) -> float:
        """The present: there is no link."""
        return self._clock.now_s()
