"""Serves nodes of devices in one thread: messages are handled between the steps of the devices, and during them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from markerseek.core import MarkerseekError
from markerseek.guard import Guard
from markerseek.ros import RosNode, StampedCommands
from markerseek.scan import Watchdog

_IDLE_S = 0.02
_MAX_MESSAGES = 4
"""Most messages handled in one beat of a device: more would hold up its lease."""


class StepEnded(BaseException):
    """A step of a device is ended from outside, as by Ctrl-C: no error, so that no driver takes it for one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Serving:
    """How a device is served."""

    node: RosNode
    """Messages are handled while it is spun."""
    guard: Guard
    """Its own; armed already."""
    by: str
    """Who has armed the guard."""
    watchdog: Watchdog | None = None
    """Lease of the device, which is held while the device works."""
    simulated: bool = False


class Served(ABC):
    """A node of a device under a guard of its own."""

    def __init__(self, serving: Serving) -> None:
        self.node = serving.node
        self._guard = serving.guard
        self._simulated = serving.simulated
        self._by = serving.by
        self._watchdog = serving.watchdog
        self._commands = StampedCommands()

    @abstractmethod
    def beat(self) -> None:
        """End what the device does, by `StepEnded`, if a message asks for it."""

    @abstractmethod
    def step(self) -> None:
        """Carry out what was asked for, and publish what is due."""

    @abstractmethod
    def _make_safe(self) -> None:
        """Stop the device, or switch it off; an error is a fault of the guard."""

    def close(self) -> None:
        """Disarm, and make the device safe."""
        self._guard.disarm()
        self._make_safe()

    @contextmanager
    def _lease_held(self) -> Iterator[None]:
        if self._watchdog is not None:
            self._watchdog.hold()
        try:
            yield
        finally:
            if self._watchdog is not None:
                self._watchdog.release()

    def _end_interrupted(self) -> None:
        self._make_safe()
        self._guard.disarm()
        # In the name of the same person: a stop ends what the device does, not the session that was armed.
        self._guard.arm(by=self._by)

    def _fail(self, error: MarkerseekError) -> None:
        self._guard.fail(f"{type(error).__name__}: {error}")


class MessagePump:
    """Handles messages while a device works; to be given to its clock before the nodes exist.

    A callback then runs inside of a device's wait: it notes what is wanted, and must not call a device.
    """

    def __init__(self) -> None:
        self.served: list[Served] = []

    def __call__(self) -> None:
        """Handle a few messages, without waiting, and end what the device does if one asks for it."""
        if self.served:
            self.served[0].node.drain(_MAX_MESSAGES)
        for each in self.served:
            each.beat()


def serve_nodes(served: Sequence[Served], *, until: Callable[[], bool]) -> None:
    """Serve nodes that share a network, until a function says so.

    ``until``: asked between two steps, at least every 20 ms unless a device works.
    """
    while not until():
        # One of them is spun for all: they share a network.
        served[0].node.spin(_IDLE_S)
        for each in served:
            each.step()
