"""Faults of an emulated stage, by name. A step is a move that begins at rest."""

from __future__ import annotations

from markerseek.sim import Fault, FaultKind


def _fault(name: str, kind: FaultKind, meaning: str, *, amount: float = 0.0, observable: bool = True) -> Fault:
    return Fault(device="stage", name=name, kind=kind, observable=observable, meaning=meaning, amount=amount)


_ALL = (
    _fault("silent", FaultKind.OFF, "it receives and sends nothing; a move in progress goes on"),
    _fault("power cut", FaultKind.OFF, "the motor stops at once, and the stage receives and sends nothing"),
    _fault("power cycle", FaultKind.INTERMITTENT, "it restarts: not homed, its parameters lost"),
    _fault("stall", FaultKind.STUCK, "the motor is blocked; the bit for a motion error is set"),
    _fault("frozen motor", FaultKind.STUCK, "the motor does not turn; it reports that it moves"),
    _fault("frozen readback", FaultKind.STUCK, "it reports the angle at which this began; the motor moves"),
    _fault("obstacle", FaultKind.STUCK, "the motor runs against something at this angle, deg", amount=20.0),
    _fault("garbled answers", FaultKind.GARBAGE, "a bit is flipped in this share of the bytes it sends", amount=0.01),
    _fault(
        "garbled commands", FaultKind.GARBAGE, "a bit is flipped in this share of the bytes it receives", amount=0.01
    ),
    _fault("done too early", FaultKind.WRONG, "it reports that a move is done, and begins it later, by s", amount=0.3),
    _fault("says it is there", FaultKind.WRONG, "it reports the commanded angle, and does not move"),
    _fault("hides its moves", FaultKind.WRONG, "its moving bits are clear while it moves"),
    _fault("says done", FaultKind.WRONG, "it reports that a move is done, and does not move"),
    _fault("readback jump", FaultKind.WRONG, "the position counter jumps by this angle, deg", amount=2.0),
    _fault(
        "jump on its way", FaultKind.WRONG, "the position counter jumps by this angle in mid-move, deg", amount=-0.5
    ),
    _fault("overshoot", FaultKind.WRONG, "it goes this far beyond its target, deg", amount=0.5),
    _fault("too fast", FaultKind.WRONG, "it turns at this speed and acceleration, deg/s and deg/s^2", amount=25.0),
    _fault("ignores stop", FaultKind.WRONG, "it reports that it stopped, and goes on"),
    _fault("slow", FaultKind.SLOW, "it turns at this share of its speed", amount=0.2),
    _fault("late answers", FaultKind.DELAYED, "its answers come this much later, s", amount=0.4),
    _fault("lost bytes", FaultKind.INTERMITTENT, "this share of the bytes is lost, both ways", amount=0.01),
    _fault(
        "drop-outs", FaultKind.INTERMITTENT, "it receives and sends nothing for this share of every second", amount=0.3
    ),
    _fault(
        "slip",
        FaultKind.WRONG,
        "the probe slips on its shaft by this angle, deg; the encoder does not measure it",
        amount=2.0,
        observable=False,
    ),
    _fault(
        "scale",
        FaultKind.WRONG,
        "a degree of the encoder turns the probe by this much more, as a share",
        amount=0.02,
        observable=False,
    ),
    _fault(
        "more play",
        FaultKind.WRONG,
        "the play between motor and probe grows to this angle, deg",
        amount=0.5,
        observable=False,
    ),
)

STAGE_FAULTS: dict[str, Fault] = {fault.name: fault for fault in _ALL}
"""Name of a fault to the fault with its usual amount; `dataclasses.replace` sets another amount or step."""
