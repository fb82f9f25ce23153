"""Waits of the drivers of ROS 2 nodes."""

from __future__ import annotations

from collections.abc import Callable

from markerseek.core import Clock
from markerseek.ros import RosNode

_SLICE_S = 0.02
"""Longest time between two beats of the clock while a message is awaited, in seconds."""


class RosWait:
    """Waits for messages: spins the node, and lets the clock beat."""

    def __init__(self, node: RosNode, clock: Clock) -> None:
        self.node, self.clock = node, clock

    def until(self, arrived: Callable[[], bool], *, timeout_s: float) -> bool:
        """Whether a condition came true in time.

        Parameters
        ----------
        arrived
            The condition, which messages change.
        timeout_s
            Longest time in seconds.
        """
        ends_s = self.clock.now_s() + timeout_s
        while not arrived():
            if not self.clock.now_s() < ends_s:
                return False
            self.node.spin(_SLICE_S)
            self.clock.wait(0.0)
        return True
