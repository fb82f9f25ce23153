"""What can be wrong with a receiver of intensities, by name, and a receiver that has one of these faults.

A step is an acquisition, counted from 1.
"""

from __future__ import annotations

import math
from dataclasses import replace

from markerseek.core import AcquisitionError, Frame, Permit, ReadingFrame, Receiver
from markerseek.sim import Fault, FaultKind


def _fault(name: str, kind: FaultKind, meaning: str) -> Fault:
    return Fault(device="receiver", name=name, kind=kind, observable=True, meaning=meaning)


_ALL = (
    _fault("dead", FaultKind.STUCK, "all intensities are 0"),
    _fault("NaN", FaultKind.GARBAGE, "the intensity is NaN"),
    _fault("late frames", FaultKind.DELAYED, "each acquisition returns the frame of the one before"),
    _fault("clipped", FaultKind.WRONG, "intensities end at this level"),
)

RECEIVER_FAULTS: dict[str, Fault] = {fault.name: fault for fault in _ALL}
"""Faults by name; `dataclasses.replace` sets the amount and the steps."""


class FaultyReceiver:
    """A receiver with one fault, around one that works.

    ``fault``: one of `RECEIVER_FAULTS`.
    """

    def __init__(self, inner: Receiver, fault: Fault) -> None:
        self._inner = inner
        self._fault = fault
        self._step = 0
        self._previous: Frame | None = None

    def settle(self) -> None:
        """Settle the receiver behind."""
        self._inner.settle()

    def arm(self, permit: Permit) -> None:
        """Arm the receiver behind."""
        self._inner.arm(permit)

    def acquire(self, permit: Permit) -> Frame:
        """Frame of the receiver behind, with the fault while it holds."""
        self._step += 1
        frame, previous = self._inner.acquire(permit), self._previous
        # Kept at every step, so that the first late frame is the one just before the fault began.
        self._previous = frame
        if not self._fault.holds_at(self._step):
            return frame
        if self._fault.name == "late frames":
            return frame if previous is None else previous
        if not isinstance(frame, ReadingFrame):
            raise AcquisitionError(f"receiver: this fault changes an intensity, and a {type(frame).__name__} has none")
        changed = {"dead": 0.0, "NaN": math.nan, "clipped": min(frame.intensity, self._fault.amount)}
        return replace(frame, intensity=changed[self._fault.name])
