"""What a fault is, and the faults of the simulated stage, laser and receiver that the campaign injects."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace
from enum import StrEnum
from typing import Literal

import numpy as np

DeviceName = Literal["stage", "laser", "receiver"]


class FaultKind(StrEnum):
    """The seven ways in which a device fails."""

    OFF = "off"
    STUCK = "stuck"
    GARBAGE = "garbage"
    WRONG = "wrong"
    SLOW = "slow"
    DELAYED = "delayed"
    INTERMITTENT = "intermittent"


@dataclass(frozen=True, slots=True)
class Fault:
    """Something wrong with a device, and what software cannot prevent about it."""

    device: DeviceName
    name: str
    """Which of that device's faults."""
    kind: FaultKind
    """What sort of fault it is."""
    meaning: str
    """What happens, in a sentence."""
    _: KW_ONLY
    amounts: tuple[float, float] = (0.0, 0.0)
    """The range from which its amount is drawn."""
    harm: Literal["none", "angle", "pulses", "result"] = "none"
    """What is done in truth before anybody can see it, or where nothing that the devices send shows it."""
    covered_by: str = ""
    """Which hardware must prevent that."""
    amount: float = 0.0
    """How much, in the unit that the meaning names."""
    from_step: int = 0
    """First step at which it holds; 0 from the start. What a step is, each device says."""
    to_step: int | None = None
    """First step at which it no longer holds; None for never."""

    def holds_at(self, step: int) -> bool:
        """Whether the device is at fault in that step."""
        return self.from_step <= step and (self.to_step is None or step < self.to_step)


OFF = FaultKind.OFF
STUCK = FaultKind.STUCK
GARBAGE = FaultKind.GARBAGE
WRONG = FaultKind.WRONG
SLOW = FaultKind.SLOW
DELAYED = FaultKind.DELAYED
INTERMITTENT = FaultKind.INTERMITTENT

_ALL = (
    Fault("stage", "silent", OFF, "it says nothing any more; a move that was begun goes on"),
    Fault("stage", "unplugged", OFF, "the line is gone"),
    Fault("stage", "frozen motor", STUCK, "the motor does not turn; the readback is true"),
    Fault("stage", "frozen readback", STUCK, "it reports the angle at which this began; the motor moves"),
    Fault("stage", "stall", STUCK, "it stops on its way, and says so"),
    Fault("stage", "obstacle", STUCK, "it cannot pass an angle, deg, and reports where it stands", amounts=(-30, 30)),
    Fault("stage", "NaN readback", GARBAGE, "the readback is no number"),
    Fault("stage", "wild readback", GARBAGE, "the readback is any number within this, deg", amounts=(40, 1e6)),
    Fault("stage", "turned readback", WRONG, "the readback counts from 0 to 360 deg"),
    Fault("stage", "stops short", WRONG, "it stops this far before its target, deg", amounts=(0.11, 20)),
    Fault("stage", "overshoot", WRONG, "it goes this far beyond its target, deg", amounts=(0.11, 1.4)),
    Fault("stage", "readback jump", WRONG, "the readback is off by this after a move, deg", amounts=(0.15, 30)),
    Fault("stage", "jump on its way", WRONG, "its counter jumps in mid-move, deg; the driver sees", amounts=(-1, 1)),
    Fault("stage", "slow", SLOW, "it turns this many times as slowly", amounts=(1.5, 100)),
    Fault("stage", "late rest", DELAYED, "it turns by so much more while it should rest, deg", amounts=(0.06, 3)),
    Fault("stage", "late readback", DELAYED, "the readback is that of the move before"),
    Fault("stage", "drop-outs", INTERMITTENT, "this share of its answers is lost", amounts=(0.05, 0.5)),
    Fault("stage", "fast", WRONG, "it turns this many times as fast in a sweep", amounts=(1.5, 4)),
    Fault("stage", "late readings", DELAYED, "each reading of a sweep takes so long, s", amounts=(0.25, 3)),
    Fault("laser", "clock step", WRONG, "its clock jumps in mid-sweep by so much, s", amounts=(-3, 3)),
    Fault("receiver", "trigger lost", WRONG, "a frame of a sweep is missing, and was not counted"),
    Fault("receiver", "trigger doubled", WRONG, "a frame of a sweep comes twice, and was counted twice"),
    Fault("laser", "silent", OFF, "it fires and says nothing"),
    Fault("laser", "unplugged", OFF, "the line is gone"),
    Fault("laser", "dead lamp", OFF, "no light comes, and it says so"),
    Fault("laser", "interlock", OFF, "the interlock opens after a share of the pulses", amounts=(0, 0.9)),
    Fault("laser", "busy", STUCK, "it refuses permits"),
    Fault("laser", "garbled count", GARBAGE, "the number of pulses it reports is nonsense"),
    Fault("laser", "fewer pulses", WRONG, "so many pulses are missing, and it says so", amounts=(1, 8)),
    Fault("laser", "hidden misfire", WRONG, "so many pulses are missing, and it does not say so", amounts=(1, 8)),
    Fault("laser", "late light", DELAYED, "the light comes later, as a share of the readout", amounts=(0.05, 0.9)),
    Fault("laser", "late answer", DELAYED, "its answer comes later, s", amounts=(0.6, 20)),
    Fault("laser", "slow", SLOW, "it fires this many times as slowly", amounts=(1.5, 100)),
    Fault("laser", "misfires", INTERMITTENT, "this share of its trains lacks pulses; it says so", amounts=(0.05, 1)),
    Fault("receiver", "off", OFF, "no frame comes"),
    Fault("receiver", "unplugged", OFF, "the line is gone"),
    Fault("receiver", "stuck", STUCK, "it hands over the frame before"),
    Fault("receiver", "same data", STUCK, "the data are those of the frame before, under a new header"),
    Fault("receiver", "dead", STUCK, "all intensities are 0"),
    Fault("receiver", "NaN", GARBAGE, "the intensity is NaN"),
    Fault("receiver", "infinite", GARBAGE, "the intensity is infinite"),
    Fault("receiver", "negative", GARBAGE, "the intensity is negative"),
    Fault("receiver", "other kind", GARBAGE, "a frame of channel data comes where intensities came"),
    Fault("receiver", "burst", GARBAGE, "the noise is this many times as strong", amounts=(3, 50)),
    Fault("receiver", "garbled feature", GARBAGE, "the noise floor is no number"),
    Fault("receiver", "other token", WRONG, "the header carries another token"),
    Fault("receiver", "out of order", WRONG, "the sequence numbers do not rise"),
    Fault("receiver", "other pulses", WRONG, "the header states other pulses than were fired", amounts=(1, 8)),
    Fault("receiver", "other angle", WRONG, "the header is of another angle, off by deg", amounts=(0.1, 20)),
    Fault("receiver", "saturated", WRONG, "this share of the channels is at full scale", amounts=(0.06, 1)),
    Fault("receiver", "slow", SLOW, "the readout takes this many times as long", amounts=(1.5, 100)),
    Fault("receiver", "late frames", DELAYED, "each acquisition returns the frame of the one before"),
    Fault("receiver", "late files", DELAYED, "the files of a search before land when this one begins"),
    Fault("receiver", "old frames", DELAYED, "the frame was taken this much earlier, s", amounts=(5.1, 100)),
    Fault("receiver", "frames of the future", WRONG, "the frame is stamped so much later, s", amounts=(0.01, 100)),
    Fault("receiver", "lost frames", INTERMITTENT, "this share of the frames is lost", amounts=(0.05, 0.7)),
    Fault("receiver", "garbage at times", INTERMITTENT, "this share of the frames is no number", amounts=(0.05, 0.7)),
    Fault(
        "stage", "slip", WRONG, "the probe slips on its shaft, deg; the encoder does not see it", amounts=(-5, 5),
        harm="angle", covered_by="hard stop; second encoder on the probe; repeated angle",
    ),
    Fault(
        "stage", "scale", WRONG, "an encoder degree turns the probe by this share more", amounts=(-0.1, 0.1),
        harm="angle", covered_by="hard stop; second encoder; calibration at start-up",
    ),
    Fault(
        "stage", "more play", WRONG, "the probe stands this far above the encoder after a move, deg", amounts=(0.2, 2),
        harm="angle", covered_by="approach from one side; second encoder",
    ),
    Fault(
        "stage", "says it is there", STUCK, "it reports its target, and has not moved",
        harm="result", covered_by="second encoder; its driver's time of travel and moving bits",
    ),
    Fault(
        "stage", "runaway", WRONG, "it goes this far beyond its target before it is stopped, deg", amounts=(1.5, 10),
        harm="angle", covered_by="hard stop; the controller's own limits; the driver's lead of 5 deg",
    ),
    Fault(
        "laser", "extra pulses", WRONG, "so many pulses more than permitted, and it says so", amounts=(1, 32),
        harm="pulses", covered_by="the laser box's second counter (photodiode); the laser's interlock",
    ),
    Fault(
        "laser", "light in the dark", WRONG, "so many pulses under a permit of none; it says none", amounts=(1, 4),
        harm="pulses", covered_by="the laser box's output gate; the laser's interlock",
    ),
    Fault(
        "laser", "fires by itself", WRONG, "so many pulses while the stage moves, reported to nobody", amounts=(1, 4),
        harm="pulses", covered_by="the laser box's output gate; photodiode; shutter",
    ),
    Fault(
        "laser", "energy drops", WRONG, "the light is this share of the usual, the count is right", amounts=(0.1, 0.8),
        harm="result", covered_by="energy meter; repeated angle",
    ),
    Fault(
        "receiver", "one behind", DELAYED, "the data are those of the acquisition before, the header is the new one",
        harm="result", covered_by="closing dark frame, if it lasts; a counter in the data",
    ),
    Fault(
        "receiver", "mixed triggers", WRONG, "this share of the triggers is of the acquisition before",
        amounts=(0.0625, 0.9375), harm="result", covered_by="closing dark frame, if it lasts",
    ),
    Fault(
        "receiver", "gain drops", WRONG, "the signal is this share of the usual, the noise is the same",
        amounts=(0.1, 0.8), harm="result", covered_by="test pulse; repeated angle",
    ),
)  # fmt: skip

IN_SWEEPS = frozenset({"fast", "late readings", "clock step", "trigger lost", "trigger doubled"})
"""Faults of a sweep only."""

FAULTS: dict[tuple[DeviceName, str], Fault] = {(each.device, each.name): each for each in _ALL}
"""By device and name."""


def drawn(rng: np.random.Generator, fault: Fault, *, steps: int) -> Fault:
    """The fault with a random amount, and the steps at which it holds: from a random one on, often not to the end."""
    from_step = int(rng.integers(1, steps + 1))
    # Noise that is high from the first frame to the last is a noisy rig and no burst.
    lasts = int(rng.integers(1, 4)) if rng.random() < 0.4 or fault.name == "burst" else None
    low, high = fault.amounts
    spread = np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0 else rng.uniform(low, high)
    to_step = None if lasts is None else from_step + lasts
    return replace(fault, amount=float(spread), from_step=from_step, to_step=to_step)
