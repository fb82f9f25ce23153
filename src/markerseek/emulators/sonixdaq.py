"""A SonixDAQ's software as a folder that fills with channel files, some time after each trigger.

Each pulse of an acquisition is in the files; their average is the simulated world's averaged frame, count for count.
"""

from __future__ import annotations

import math
from collections import deque
from copy import copy, deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from markerseek.core import ChannelFrame, ConfigError, FrameHeader
from markerseek.core.shapes import Int16
from markerseek.sim import Flash, Surroundings
from markerseek.wire import sonixdaq as wire

_SPREAD_COUNTS = 8
"""Most counts by which a single pulse differs from the average."""

_FULL_SCALE = 2047


@dataclass(slots=True, kw_only=True)
class SonixDaqFaults:
    """What is broken; may be changed while it runs.

    Attributes
    ----------
    off
        Nothing is written.
    delay_s
        Further time before the first file, in seconds.
    files
        Channel files that are written; the one after them is left half written.
    stuck
        The acquisition before is written again.
    one_behind
        Each trigger brings the acquisition of the trigger before it.
    swapped
        The files of channels 5 and 6 hold one another's data.
    garbage
        Headers are noise.
    """

    off: bool = False
    delay_s: float = 0.0
    files: int = wire.CHANNELS
    stuck: bool = False
    one_behind: bool = False
    swapped: bool = False
    garbage: bool = False


class EmulatedSonixDaq:
    """Writes what the world sounds like.

    Parameters
    ----------
    world
        What is heard; a world of frames.
    folder
        Where the channel files go; made if need be.
    rng
        Source of what differs from pulse to pulse.
    readout_s
        Time from the trigger to the last file, in seconds: about 10 s (paper, section 4).
    sdk
        Layout of the files: that of SDK 6 and later, or that of the earlier ones.
    faults
        What is broken.

    Raises
    ------
    ConfigError
        If the folder cannot be made.
    """

    def __init__(
        self,
        *,
        world: Surroundings,
        folder: Path,
        rng: np.random.Generator,
        readout_s: float = 10.0,
        sdk: Literal[5, 6] = 6,
        faults: SonixDaqFaults | None = None,
    ) -> None:
        if not 0 <= readout_s < math.inf:
            raise ConfigError(f"sonixdaq: readout_s is {readout_s} s, it must be finite and not negative")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"sonixdaq: the folder {folder} cannot be made ({error.strerror})") from error
        self.faults = faults or SonixDaqFaults()
        self._world = world
        self._folder = folder
        self._rng = rng
        self._readout_s = readout_s
        self._numbered = sdk == 6
        self._flashes = len(world.flashes)
        self._now_s = 0.0
        self._begins_s = 0.0
        self._triggered: deque[tuple[Surroundings, Flash | None, int]] = deque()
        self._previous: list[bytes] = []
        self._queue: list[bytes] = []
        self._written = 0

    def warm_up(self) -> None:
        """Take an acquisition that nobody gets, so that the first real one finds its code loaded and its tables made.

        The world, and what it draws next, stay as they are.
        """
        self._acquisition(deepcopy(self._world), Flash(at_s=0.0, pulses=1, energy=1.0), 1)

    def trigger(self, count: int) -> None:
        """Take an acquisition of so many triggers now, with the probe as it stands; all work is left to `advance`."""
        new = self._world.flashes[self._flashes :]
        self._flashes = len(self._world.flashes)
        # A shallow copy stands still while the world turns on.
        self._triggered.append((copy(self._world), new[-1] if new else None, count))

    def advance(self, now_s: float) -> None:
        """Write the files that are due at that moment, in seconds; the one in work is there by half.

        It may be called from another thread than `trigger`.
        """
        self._now_s = max(self._now_s, now_s)
        while self._triggered:
            self._take_up(*self._triggered.popleft())
        gone_s = self._now_s - self._begins_s
        if not self._queue or gone_s < 0:
            return
        share = 1.0 if gone_s >= self._readout_s else gone_s / self._readout_s
        due = min(math.floor(share * wire.CHANNELS), self.faults.files)
        for number in range(self._written, due):
            self._write(number, self._queue[number])
        if due > self._written and due < wire.CHANNELS:
            self._write(due, self._queue[due][: len(self._queue[due]) // 2])
        self._written = max(due, self._written)
        if self._written == wire.CHANNELS:
            self._queue = []

    def _take_up(self, world: Surroundings, flash: Flash | None, count: int) -> None:
        """Make the files of a trigger; they are written from now on."""
        fresh = self._acquisition(world, flash, count)
        files = self._previous if self._previous and (self.faults.stuck or self.faults.one_behind) else fresh
        if not self.faults.stuck or not self._previous:
            self._previous = fresh
        self._queue = [] if self.faults.off else files
        self._written = 0
        self._begins_s = self._now_s + self.faults.delay_s

    def _acquisition(self, world: Surroundings, flash: Flash | None, count: int) -> list[bytes]:
        """Channel files of what is heard after a flash."""
        header = FrameHeader(sequence=0, token="", pulses=count, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
        frame = world.frame(flash, header=header)
        if not isinstance(frame, ChannelFrame):
            raise ConfigError("sonixdaq: this world gives intensities only; emulate a world of frames")
        pulses = self._pulses(frame.samples, count)
        files = []
        for number in range(wire.CHANNELS):
            other = {5: 6, 6: 5}.get(number, number) if self.faults.swapped else number
            data = wire.encode_file(pulses[:, wire.element_of_file(other)], number=other if self._numbered else None)
            files.append(self._rng.bytes(12) + data[12:] if self.faults.garbage else data)
        return files

    def _pulses(
        self, averaged: Int16[np.ndarray, "channels samples"], count: int
    ) -> Int16[np.ndarray, "pulses channels samples"]:
        """Pulses that differ from one another in pairs about their average, which they therefore keep."""
        pulses = np.repeat(averaged[np.newaxis], count, axis=0)
        for pair in range(count // 2):
            apart = self._rng.integers(-_SPREAD_COUNTS, _SPREAD_COUNTS + 1, averaged.shape, dtype=np.int16)
            apart[np.abs(averaged) > _FULL_SCALE - _SPREAD_COUNTS] = 0
            pulses[2 * pair] += apart
            pulses[2 * pair + 1] -= apart
        return pulses

    def _write(self, number: int, data: bytes) -> None:
        """Put a file in place of the one before: under a new inode, so that none is taken for the old."""
        place = self._folder / wire.file_name(number, numbered=self._numbered)
        draft = place.with_suffix(".part")
        draft.write_bytes(data)
        draft.replace(place)
