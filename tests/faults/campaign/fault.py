"""One vocabulary of faults for every device: what is wrong, with which device, from when on, and how much."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """Something wrong with a device."""

    device: DeviceName
    name: str
    """Which of that device's faults."""
    kind: FaultKind
    """What sort of fault it is."""
    observable: bool
    """Whether the evidence is in what the devices send. What command and readback share is not observable: another
    device must cover it, as a hard stop or a second encoder does."""
    meaning: str
    """What happens, in a sentence."""
    amount: float = 0.0
    """How much, in the unit that the meaning names."""
    from_step: int = 0
    """First step at which it holds; 0 from the start. What a step is, each device says."""
    to_step: int | None = None
    """First step at which it no longer holds; None for never."""

    def holds_at(self, step: int) -> bool:
        """Whether the device is at fault in that step."""
        return self.from_step <= step and (self.to_step is None or step < self.to_step)
