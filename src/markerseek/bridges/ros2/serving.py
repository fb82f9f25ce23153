"""Serves nodes of devices in one thread: messages are handled between the steps of the devices, and during them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from markerseek.ros import RosNode

_IDLE_S = 0.02
_MOST_MESSAGES = 4
"""Most messages handled in one beat of a device: more would hold up its lease."""


class Served(Protocol):
    """A node of a device."""

    node: RosNode

    def beat(self) -> None:
        """End what the device does, by `Interrupted`, if a message asks for it."""

    def step(self) -> None:
        """Carry out what was asked for, and publish what is due."""

    def set_active(self, active: bool) -> None:
        """Follow the lifecycle."""

    def close(self) -> None:
        """Make the device safe, and disarm."""


class Beat:
    """Handles messages while a device works; to be given to its clock before the nodes exist.

    A callback then runs inside of a device's wait: it notes what is wanted, and must not call a device.
    """

    def __init__(self) -> None:
        self.served: list[Served] = []

    def __call__(self) -> None:
        """Handle a few messages, without waiting, and end what the device does if one asks for it."""
        for _ in range(_MOST_MESSAGES if self.served else 0):
            before = self.served[0].node.handled
            self.served[0].node.spin(0.0)
            if self.served[0].node.handled == before:
                break
        for each in self.served:
            each.beat()


def serve(served: Sequence[Served], *, until: Callable[[], bool]) -> None:
    """Serve nodes that share a network, until told to stop.

    Parameters
    ----------
    served
        The nodes.
    until
        Asked between two steps, at least every 20 ms unless a device works.
    """
    while not until():
        # One of them is spun for all: they share a network.
        served[0].node.spin(_IDLE_S)
        for each in served:
            each.step()
