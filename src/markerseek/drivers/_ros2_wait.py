"""Wait of the drivers of ROS 2 nodes."""

from __future__ import annotations

from collections.abc import Callable

from markerseek.core import Clock
from markerseek.ros import RosNode

_SLICE_S = 0.02
"""Longest time between two beats of the clock while a message is awaited, in seconds."""


def wait_until(node: RosNode, clock: Clock, arrived: Callable[[], bool], *, timeout_s: float) -> bool:
    """Whether a condition came true in time; meanwhile the node is spun, and the clock beats.

    Parameters
    ----------
    node, clock
        The node that receives, and real time.
    arrived
        The condition, which messages change.
    timeout_s
        Longest time in seconds.
    """
    ends_s = clock.now_s() + timeout_s
    while not arrived():
        if not clock.now_s() < ends_s:
            return False
        node.spin(_SLICE_S)
        clock.wait(0.0)
    return True
