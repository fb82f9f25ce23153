"""Wait of the drivers of ROS 2 nodes."""

from __future__ import annotations

from collections.abc import Callable

from markerseek.core import Clock, NotConnectedError
from markerseek.ros import RosNode

_SLICE_S = 0.02
"""Longest time between two beats of the clock while a message is awaited, in seconds."""


def wait_until(node: RosNode, clock: Clock, arrived: Callable[[], bool], *, timeout_s: float, of: str = "") -> bool:
    """Whether a condition came true in time; meanwhile the node is spun, and the clock beats.

    ``arrived``: the condition, which messages change. ``timeout_s``: longest time. ``of``: topic of the node that is
    waited for; empty while it is looked for. Raises `NotConnectedError` if nobody publishes its topic any more: it has
    ended, or was killed.
    """
    ends_s = clock.now_s() + timeout_s
    while not arrived():
        if not clock.now_s() < ends_s:
            return False
        if of and not node.publishes(of):
            raise NotConnectedError(f"its node is gone: nobody publishes {of} any more; start it again")
        node.spin(_SLICE_S)
        clock.wait(0.0)
    return True
