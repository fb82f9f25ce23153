"""The faults of one simulated device that fails on request: the truth stays in the simulated world.

A step of the stage is a move, of the laser a firing, of the receiver an acquisition, each counted from 1. ``acted``
holds the faults that changed something that a healthy device would not have done.
"""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np

from markerseek.core import DeviceTimeoutError
from markerseek.sim import VirtualClock

from .vocabulary import DeviceName, Fault

ANSWER_S = 0.5
"""How long a driver waits for an answer."""

SLOWER = 3.0
"""How many times the usual a driver allows for a move, a train of pulses, or a readout."""


class HostKilled(BaseException):
    """The host is dead: no call reaches a device any more."""


class Host:
    """The host of a run; it dies, where it does, at one reading of a stage that sweeps."""

    def __init__(self, *, dies_at: int | None = None) -> None:
        self.left = dies_at
        self.dead = False

    def read(self) -> None:
        """A stage is read in a sweep."""
        if self.left is not None:
            self.left -= 1
            self.dead = self.dead or self.left <= 0
        self.require()

    def require(self) -> None:
        """`HostKilled` once it is dead."""
        if self.dead:
            raise HostKilled


class Faulty:
    """The faults of one device, and its steps; what no fault changes is asked of the simulated device."""

    host = Host()
    device: DeviceName

    def __init__(self, inner: Any, clock: VirtualClock, faults: tuple[Fault, ...], rng: np.random.Generator) -> None:
        self._inner = inner
        self._clock = clock
        self.step = 0
        self.acted: list[Fault] = []
        self._faults = faults
        self._rng = rng

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["_inner"], name)

    def has(self, name: str, *, silently: bool = False, ever: bool = False) -> Fault | None:
        """The fault of that name if it holds now, or at any time; it acts unless it is only asked for."""
        for fault in self._faults:
            if fault.name == name and (ever or fault.holds_at(self.step)):
                if not silently:
                    self.act(fault)
                return fault
        return None

    def reach(self, *, silently: bool = False) -> None:
        """Raise if the line is gone, or the host."""
        self.host.require()
        if self.has("unplugged", silently=silently):
            raise OSError("device disconnected")

    def no_answer(self, *, after_s: float = ANSWER_S) -> NoReturn:
        """Raise what a driver does that has waited for an answer."""
        self._clock.wait(after_s)
        raise DeviceTimeoutError(f"{self.device}: no answer within {ANSWER_S} s")

    def act(self, fault: Fault) -> None:
        """Note that the fault did something."""
        if fault not in self.acted:
            self.acted.append(fault)

    def chance(self, share: float) -> bool:
        return bool(self._rng.random() < share)
