"""Faults of the emulated devices, by which tests of drivers break them: their names, and those that a device has."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from markerseek.core import ConfigError

DeviceName = Literal["stage", "laser", "receiver"]

FAULTS: dict[DeviceName, dict[str, float]] = {
    "stage": {
        "silent": 0.0,  # it receives and sends nothing; a move in progress goes on
        "power cut": 0.0,  # the motor stops at once, and the stage receives and sends nothing
        "power cycle": 0.0,  # it restarts: not homed, its parameters lost
        "stall": 0.0,  # the motor is blocked; the bit for a motion error is set
        "frozen motor": 0.0,  # the motor does not turn; it reports that it moves
        "frozen readback": 0.0,  # it reports the angle at which this began; the motor moves
        "obstacle": 20.0,  # the motor runs against something at this angle, deg
        "done too early": 0.3,  # it reports that a move is done, and begins it later, by s
        "says it is there": 0.0,  # it reports the commanded angle, and does not move
        "hides its moves": 0.0,  # its moving bits are clear while it moves
        "says done": 0.0,  # it reports that a move is done, and does not move
        "readback jump": 2.0,  # the position counter jumps by this angle, deg
        "jump on its way": -0.5,  # the position counter jumps by this angle in mid-move, deg
        "overshoot": 0.5,  # it goes this far beyond its target, deg
        "too fast": 25.0,  # it turns at this speed and acceleration, deg/s and deg/s^2
        "ignores stop": 0.0,  # it reports that it stopped, and goes on
        "slow": 0.2,  # it turns at this share of its speed
    },
    "laser": {
        "silent": 0.0,  # it works and answers nothing
        "dead lamp": 0.0,  # triggers are sent and no light comes
        "blind photodiode": 0.0,  # light comes and is not seen
        "extra pulses": 2.0,  # a broken counter lets as many pulses beyond the permit through
        "restart": 1.5,  # it restarts at the first bytes after power-up, and is deaf for this time, s
        "late light": 5000.0,  # light comes this long after its trigger, µs
        "clock drift": 2e-05,  # the clock of its stamps is fast by this share
        "clock step": 5000.0,  # the clock of its stamps is ahead by this time, µs
        "double pulse": 15.0,  # the laser gives two pulses at the pulse of a sweep with this number
    },
    "receiver": {
        "off": 0.0,  # nothing is written
        "late files": 9.0,  # the first file comes later by this time, s
        "part of the files": 100.0,  # only this number of files is written; the next file is written half
        "size first": 0.8,  # a file has its size at once, and the last two fifths of its contents later by this time, s
        "swapped channels": 0.0,  # the files of channels 5 and 6 hold the data of the other
        "garbled headers": 0.0,  # headers are noise
        "lost trigger": 3.0,  # the trigger of a sweep with this number is lost
        "double trigger": 3.0,  # the trigger of a sweep with this number is recorded twice
    },
}
"""Faults by device and name, each with its usual amount."""


class Fault(NamedTuple):
    """A fault that a device has: how much, and the first step at which it holds."""

    amount: float
    from_step: int


class Faults:
    """The faults of one emulated device; they may change while it runs.

    ``device``: whose faults they are. ``step``: number of the present step of the device; that of a stage is a move
    that begins at rest.
    """

    __slots__ = ("_device", "_held", "_step")

    def __init__(self, device: DeviceName, *, step: Callable[[], int] = lambda: 0) -> None:
        self._device = device
        self._step = step
        self._held: dict[str, Fault] = {}

    def __bool__(self) -> bool:
        """Whether there is one, in whatever step."""
        return bool(self._held)

    def __call__(self, name: str) -> Fault | None:
        """Return the fault of that name if it holds now."""
        fault = self._held.get(name)
        return fault if fault is not None and fault.from_step <= self._step() else None

    def amount(self, name: str, *, otherwise: float = 0.0) -> float:
        """Return the amount of the fault of that name if it holds now."""
        fault = self(name)
        return otherwise if fault is None else fault.amount

    def inject(self, name: str, amount: float | None = None, *, from_step: int = 0) -> None:
        """Add a fault with its usual amount, or another."""
        known = FAULTS[self._device]
        if name not in known:
            raise ConfigError(f"fault {name!r} is none of an emulated {self._device}; it has: {', '.join(known)}")
        self._held[name] = Fault(known[name] if amount is None else amount, from_step)

    def heal(self, *names: str) -> None:
        """Remove faults, all of them without a name; their effects so far remain."""
        for name in names or tuple(self._held):
            self._held.pop(name, None)
