"""A serial line with faults: bits flipped, bytes lost, answers delayed, line cut."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import numpy as np

from markerseek.sim import Fault


class FaultyLine:
    """Passes bytes to and from a device, changed by the faults that hold.

    Parameters
    ----------
    fault
        Returns the fault of that name if it holds now.
    rng
        Source of randomness.
    """

    def __init__(self, *, fault: Callable[[str], Fault | None], rng: np.random.Generator) -> None:
        self._fault = fault
        self._rng = rng
        self._late: deque[tuple[float, bytes]] = deque()

    def to_device(self, data: bytes, *, now_s: float) -> bytes:
        """Bytes that reach the device."""
        if self._cut(now_s):
            return b""
        return self._garbled(self._thinned(data), "garbled commands")

    def to_host(self, data: bytes, *, now_s: float) -> bytes:
        """Bytes that reach the host now when the device sends these."""
        if self._cut(now_s):
            self._late.clear()
            return b""
        data = self._garbled(self._thinned(data), "garbled answers")
        late = self._fault("late answers")
        if late is not None:
            if data:
                self._late.append((now_s + late.amount, data))
            data = b""
        # In order of sending: a serial line delays bytes, and never reorders them.
        due = bytearray()
        while self._late and self._late[0][0] <= now_s:
            due += self._late.popleft()[1]
        return bytes(due) + data

    def _cut(self, now_s: float) -> bool:
        if self._fault("silent") is not None or self._fault("power cut") is not None:
            return True
        drop_outs = self._fault("drop-outs")
        return drop_outs is not None and now_s % 1.0 < drop_outs.amount

    def _thinned(self, data: bytes) -> bytes:
        lost = self._fault("lost bytes")
        if lost is None or not data:
            return data
        kept = self._rng.random(len(data)) >= lost.amount
        return bytes(byte for byte, keep in zip(data, kept, strict=True) if keep)

    def _garbled(self, data: bytes, name: str) -> bytes:
        garbled = self._fault(name)
        if garbled is None or not data:
            return data
        hit = self._rng.random(len(data)) < garbled.amount
        # One bit of a byte: the fault that a form without a checksum is least able to detect.
        flips = np.where(hit, 1 << self._rng.integers(0, 8, len(data)), 0)
        return bytes(byte ^ int(flip) for byte, flip in zip(data, flips, strict=True))
