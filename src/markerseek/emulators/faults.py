"""One table of the faults of all emulated devices, and those that one device has now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from markerseek.core import ConfigError
from markerseek.sim import DeviceName, Fault, FaultKind


def _table(device: DeviceName, *rows: tuple[str, str, float, str], unseen: tuple[str, ...] = ()) -> dict[str, Fault]:
    """Faults of one device by name: of each its kind, its usual amount, and its meaning.

    ``unseen``: those that no message of the device shows.
    """
    return {
        name: Fault(
            device=device,
            name=name,
            kind=FaultKind(kind),
            observable=name not in unseen,
            meaning=meaning,
            amount=amount,
        )
        for name, kind, amount, meaning in rows
    }


FAULTS: dict[DeviceName, dict[str, Fault]] = {
    "stage": _table(
        "stage",
        ("silent", "off", 0.0, "it receives and sends nothing; a move in progress goes on"),
        ("power cut", "off", 0.0, "the motor stops at once, and the stage receives and sends nothing"),
        ("power cycle", "intermittent", 0.0, "it restarts: not homed, its parameters lost"),
        ("stall", "stuck", 0.0, "the motor is blocked; the bit for a motion error is set"),
        ("frozen motor", "stuck", 0.0, "the motor does not turn; it reports that it moves"),
        ("frozen readback", "stuck", 0.0, "it reports the angle at which this began; the motor moves"),
        ("obstacle", "stuck", 20.0, "the motor runs against something at this angle, deg"),
        ("garbled answers", "garbage", 0.01, "a bit is flipped in this share of the bytes it sends"),
        ("garbled commands", "garbage", 0.01, "a bit is flipped in this share of the bytes it receives"),
        ("done too early", "wrong", 0.3, "it reports that a move is done, and begins it later, by s"),
        ("says it is there", "wrong", 0.0, "it reports the commanded angle, and does not move"),
        ("hides its moves", "wrong", 0.0, "its moving bits are clear while it moves"),
        ("says done", "wrong", 0.0, "it reports that a move is done, and does not move"),
        ("readback jump", "wrong", 2.0, "the position counter jumps by this angle, deg"),
        ("jump on its way", "wrong", -0.5, "the position counter jumps by this angle in mid-move, deg"),
        ("overshoot", "wrong", 0.5, "it goes this far beyond its target, deg"),
        ("too fast", "wrong", 25.0, "it turns at this speed and acceleration, deg/s and deg/s^2"),
        ("ignores stop", "wrong", 0.0, "it reports that it stopped, and goes on"),
        ("slow", "slow", 0.2, "it turns at this share of its speed"),
        ("late answers", "delayed", 0.4, "its answers come this much later, s"),
        ("lost bytes", "intermittent", 0.01, "this share of the bytes is lost, both ways"),
        ("drop-outs", "intermittent", 0.3, "it receives and sends nothing for this share of every second"),
        ("slip", "wrong", 2.0, "the probe slips on its shaft by this angle, deg; the encoder does not measure it"),
        ("scale", "wrong", 0.02, "a degree of the encoder turns the probe by this much more, as a share"),
        ("more play", "wrong", 0.5, "the play between motor and probe grows to this angle, deg"),
        unseen=("slip", "scale", "more play"),
    ),
    "laser": _table(
        "laser",
        ("silent", "off", 0, "it works and answers nothing"),
        ("dead lamp", "off", 0, "triggers are sent and no light comes"),
        ("blind photodiode", "off", 0, "light comes and is not seen"),
        ("extra pulses", "wrong", 2, "a broken counter lets as many pulses beyond the permit through"),
        (
            "restart",
            "intermittent",
            1.5,
            "it restarts at the first bytes after power-up, and is deaf for this time, s",
        ),
        ("late light", "delayed", 5000, "light comes this long after its trigger, µs"),
        ("clock drift", "wrong", 2e-05, "the clock of its stamps is fast by this share"),
        ("clock step", "wrong", 5000, "the clock of its stamps is ahead by this time, µs"),
        ("double pulse", "wrong", 15, "the laser gives two pulses at the pulse of a sweep with this number"),
        ("no edges", "off", 0, "no edge reaches the trigger input"),
        ("lost edge", "intermittent", 8, "the edge of a sweep with this number does not reach the trigger input"),
        ("double edge", "intermittent", 8, "the edge of a sweep with this number bounces"),
    ),
    "receiver": _table(
        "receiver",
        ("off", "off", 0, "nothing is written"),
        ("late files", "delayed", 9, "the first file comes later by this time, s"),
        (
            "part of the files",
            "stuck",
            100,
            "only this number of files is written; the next file is written half",
        ),
        ("repeats", "stuck", 0, "the acquisition before is written again"),
        ("one behind", "delayed", 0, "each trigger gives the acquisition of the trigger before"),
        ("swapped channels", "wrong", 0, "the files of channels 5 and 6 hold the data of the other"),
        ("garbled headers", "garbage", 0, "headers are noise"),
        ("lost trigger", "intermittent", 3, "the trigger of a sweep with this number is lost"),
        ("double trigger", "intermittent", 3, "the trigger of a sweep with this number is recorded twice"),
    ),
}
"""Faults by device and name, each with its usual amount. A step is a move of the stage that begins at rest."""


class Faults:
    """The faults of one emulated device; they may change while it runs.

    ``device``: whose faults they are. ``step``: number of the present step of the device.
    """

    __slots__ = ("_device", "_held", "_step")

    def __init__(self, device: DeviceName, *, step: Callable[[], int] = lambda: 0) -> None:
        self._device, self._step = device, step
        self._held: dict[str, Fault] = {}

    def __bool__(self) -> bool:
        """Whether there is one, in whatever step."""
        return bool(self._held)

    def __call__(self, name: str) -> Fault | None:
        """The fault of that name if it holds now."""
        fault = self._held.get(name)
        return fault if fault is not None and fault.holds_at(self._step()) else None

    def amount(self, name: str, *, otherwise: float = 0.0) -> float:
        """Amount of the fault of that name if it holds now."""
        fault = self(name)
        return otherwise if fault is None else fault.amount

    def inject(self, fault: Fault | str, amount: float | None = None) -> None:
        """Add a fault, from its own step on; by its name with its usual amount, or another."""
        known = FAULTS[self._device]
        name, device = (fault, self._device) if isinstance(fault, str) else (fault.name, fault.device)
        if name not in known or device != self._device:
            raise ConfigError(
                f"fault {name!r} of the {device} is none of an emulated {self._device}; it has: {', '.join(known)}"
            )
        found = known[fault] if isinstance(fault, str) else fault
        self._held[name] = found if amount is None else replace(found, amount=amount)

    def heal(self, *names: str) -> None:
        """Remove faults, all of them without a name; their effects so far remain."""
        for name in names or tuple(self._held):
            self._held.pop(name, None)
