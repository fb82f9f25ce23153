"""Checks of commands on the network: their stamp, their joint, their angle."""

from __future__ import annotations

import math
from typing import Any

from markerseek.core import is_finite
from markerseek.ros.messages import JOINT

MAX_AGE_S = 0.3
"""Oldest command that is carried out, in seconds: one that waited on the network is not what is wanted now."""

MAX_AHEAD_S = 0.05
"""Most by which a stamp may lie in the future, in seconds: clocks of two computers differ by some milliseconds."""


class StampedCommands:
    """Accepts commands whose stamp is fresh and later than the last."""

    def __init__(self) -> None:
        self._last_ns = 0

    def refusal(self, stamp_ns: int, *, now_s: float) -> str | None:
        """Why a command is dropped; None if it is accepted.

        ``stamp_ns``: its stamp in nanoseconds; 0 is none.
        """
        age_s = now_s - stamp_ns * 1e-9
        if self._last_ns * 1e-9 > now_s + MAX_AHEAD_S:
            # The clock was set back: what came before it says nothing of what is new.
            self._last_ns = 0
        if stamp_ns == 0:
            return "it carries no stamp; set header.stamp to the time at which it is sent"
        if age_s > MAX_AGE_S:
            return f"it is {age_s:.2f} s old, at most {MAX_AGE_S} s are accepted"
        if not age_s >= -MAX_AHEAD_S:
            return f"it is stamped {-age_s:.2f} s ahead; compare the computers' clocks"
        if stamp_ns <= self._last_ns:
            return "its stamp is not later than that of the command before; it is a repetition"
        self._last_ns = stamp_ns
        return None


def joint_angle_deg(message: Any) -> float | None:
    """Angle in degrees of a JointState of the one joint; None if it holds anything else, or no finite number.

    ``message``: a sensor_msgs/JointState; its name may be left out.
    """
    names = list(message.name)
    if names not in ([], [JOINT]) or len(message.position) != 1 or not is_finite(message.position[0]):
        return None
    return degrees(message.position[0])


def degrees(angle_rad: float) -> float:
    """An angle in degrees, to 1e-9 degrees: the end of a range stays in the range on its way over radians."""
    return round(math.degrees(angle_rad), 9)
