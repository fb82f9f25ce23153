"""Faults of the emulated devices: of a stage by name, of the laser box and of the SonixDAQ as switches."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.sim import Fault, FaultKind
from markerseek.wire import sonixdaq as wire


def _fault(name: str, kind: str, meaning: str, *, amount: float = 0.0, observable: bool = True) -> Fault:
    return Fault(device="stage", name=name, kind=FaultKind(kind), observable=observable, meaning=meaning, amount=amount)


_ALL = (
    _fault("silent", "off", "it receives and sends nothing; a move in progress goes on"),
    _fault("power cut", "off", "the motor stops at once, and the stage receives and sends nothing"),
    _fault("power cycle", "intermittent", "it restarts: not homed, its parameters lost"),
    _fault("stall", "stuck", "the motor is blocked; the bit for a motion error is set"),
    _fault("frozen motor", "stuck", "the motor does not turn; it reports that it moves"),
    _fault("frozen readback", "stuck", "it reports the angle at which this began; the motor moves"),
    _fault("obstacle", "stuck", "the motor runs against something at this angle, deg", amount=20.0),
    _fault("garbled answers", "garbage", "a bit is flipped in this share of the bytes it sends", amount=0.01),
    _fault("garbled commands", "garbage", "a bit is flipped in this share of the bytes it receives", amount=0.01),
    _fault("done too early", "wrong", "it reports that a move is done, and begins it later, by s", amount=0.3),
    _fault("says it is there", "wrong", "it reports the commanded angle, and does not move"),
    _fault("hides its moves", "wrong", "its moving bits are clear while it moves"),
    _fault("says done", "wrong", "it reports that a move is done, and does not move"),
    _fault("readback jump", "wrong", "the position counter jumps by this angle, deg", amount=2.0),
    _fault("jump on its way", "wrong", "the position counter jumps by this angle in mid-move, deg", amount=-0.5),
    _fault("overshoot", "wrong", "it goes this far beyond its target, deg", amount=0.5),
    _fault("too fast", "wrong", "it turns at this speed and acceleration, deg/s and deg/s^2", amount=25.0),
    _fault("ignores stop", "wrong", "it reports that it stopped, and goes on"),
    _fault("slow", "slow", "it turns at this share of its speed", amount=0.2),
    _fault("late answers", "delayed", "its answers come this much later, s", amount=0.4),
    _fault("lost bytes", "intermittent", "this share of the bytes is lost, both ways", amount=0.01),
    _fault("drop-outs", "intermittent", "it receives and sends nothing for this share of every second", amount=0.3),
    _fault(
        "slip",
        "wrong",
        "the probe slips on its shaft by this angle, deg; the encoder does not measure it",
        amount=2.0,
        observable=False,
    ),
    _fault(
        "scale",
        "wrong",
        "a degree of the encoder turns the probe by this much more, as a share",
        amount=0.02,
        observable=False,
    ),
    _fault(
        "more play", "wrong", "the play between motor and probe grows to this angle, deg", amount=0.5, observable=False
    ),
)

STAGE_FAULTS: dict[str, Fault] = {fault.name: fault for fault in _ALL}
"""Name of a fault to the fault with its usual amount; `dataclasses.replace` sets another amount or step.

A step is a move that begins at rest.
"""


@dataclass(slots=True, kw_only=True)
class LaserBoxFaults:
    """Faults of the box; may be changed while it runs."""

    laser_dead: bool = False
    """Triggers are sent and no light comes."""
    photodiode_dead: bool = False
    """Light comes and is not seen."""
    extra_pulses: int = 0
    """Pulses beyond the permit that a broken counter lets through."""
    boot_s: float = 0.0
    """Time for which it is deaf, since it restarts when its port is opened: at the first bytes that it gets."""
    silent: bool = False
    """The box works and answers nothing."""
    light_late_us: int = 0
    """Time from a trigger to its light."""
    clock_drift: float = 0.0
    """By how much the clock of its stamps is fast, as a share."""
    clock_step_us: int = 0
    """By how much that clock is ahead."""
    doubled_at: int = 0
    """Number of the pulse of a sweep at which the laser gives two; 0: none."""
    edges_cut: bool = False
    """No edge reaches the trigger input."""
    edge_lost_at: int = 0
    edge_doubled_at: int = 0
    """``edge_lost_at`` and ``edge_doubled_at``: number of the edge of a sweep that does not reach the trigger input, or
    bounces; 0: none."""

    def times_seen(self, edge: int) -> int:
        """How often the edge of that number reaches the trigger input."""
        if self.edges_cut or edge == self.edge_lost_at:
            return 0
        return 2 if edge == self.edge_doubled_at else 1


@dataclass(slots=True, kw_only=True)
class SonixDaqFaults:
    """Faults of the device; may be changed while it runs."""

    off: bool = False
    """Nothing is written."""
    delay_s: float = 0.0
    """Further time before the first file."""
    files: int = wire.CHANNELS
    """Number of channel files that are written; the next one is written half."""
    stuck: bool = False
    """The previous acquisition is written again."""
    one_behind: bool = False
    """Each trigger yields the acquisition of the trigger before it."""
    swapped: bool = False
    """The files of channels 5 and 6 hold one another's data."""
    garbage: bool = False
    """Headers are noise."""
    lost_at: int = 0
    """Number of the trigger of a sweep that is lost; 0: none."""
    doubled_at: int = 0
    """Number of the trigger of a sweep that is recorded twice; 0: none."""
