"""An emulated SonixDAQ: it writes channel files into a folder, some time after each trigger.

The files hold each pulse of an acquisition; their average equals the simulated world's averaged frame, count for count.
Like the device it runs independently: when the host dies, triggered acquisitions are still written, one after the
other. An acquisition is one train of triggers.
"""

from __future__ import annotations

import json
import math
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.core import ConfigError
from markerseek.emulators._trains import Train, Trains
from markerseek.emulators.faults import Faults
from markerseek.sim import SimulatedWorld
from markerseek.wire import sonixdaq as wire


@dataclass(slots=True, kw_only=True)
class _Writing:
    """Files of an acquisition, the time at which the first is due in seconds, and how many are written."""

    files: list[bytes]
    begins_s: float
    written: int = 0


class EmulatedSonixDaq:
    """Records the sound of a simulated world into channel files.

    - ``world``: world whose sound is recorded; it must simulate frames.
    - ``folder``: folder of the channel files; created if missing.
    - ``readout_s``: time from the trigger to the last file: about 10 s (paper, section 4).
    """

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        folder: Path,
        readout_s: float = 10.0,
    ) -> None:
        if not 0 <= readout_s < math.inf:
            raise ConfigError(f"sonixdaq: readout_s is {readout_s} s, it must be finite and not negative")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"sonixdaq: the folder {folder} cannot be created ({error.strerror})") from error
        self.faults = Faults("receiver")
        self._trains = Trains(world)
        self._folder = folder
        self._readout_s = readout_s
        self._now_s = 0.0
        self._triggered: deque[Train] = deque()
        self._queue: deque[_Writing] = deque()

    @property
    def said(self) -> str:
        """Where its files are, for people."""
        return f"channel files: {self._folder}"

    @property
    def keys(self) -> str:
        """Its folder, as keys of a rig file."""
        return f'folder = {json.dumps(str(self._folder.resolve()))}\nframes = "triggered"\n'

    def close(self) -> None:
        """Nothing to release."""

    def warm_up(self) -> None:
        """Compute one acquisition and discard it: the first real one is not delayed by imports and compilation."""
        self._acquisition(self._trains.trial())

    def trigger(self, count: int) -> None:
        """Receive a train of triggers at the present angle of the probe; `advance` does the work."""
        self._triggered.append(self._trains.begin(count))

    def advance(self, now_s: float) -> None:
        """Write the files that are due at that time in seconds; the next one is written half.

        It may be called from another thread than `trigger`.
        """
        # Never backwards: the files run in a thread of their own, at a time that they read themselves.
        self._now_s = max(self._now_s, now_s)
        while self._triggered:
            self._finish(self._triggered.popleft())
        while self._queue and self._has_written(self._queue[0]):
            ended_s = self._queue.popleft().begins_s + self._readout_s
            if self._queue:
                self._queue[0].begins_s = max(self._queue[0].begins_s, ended_s)

    def _has_written(self, writing: _Writing) -> bool:
        """Write the files of an acquisition that are due; return whether it is complete."""
        gone_s = self._now_s - writing.begins_s
        if gone_s < 0:
            return False
        share = 1.0 if gone_s >= self._readout_s else gone_s / self._readout_s
        due = min(
            math.floor(share * wire.CHANNELS), round(self.faults.amount("part of the files", otherwise=wire.CHANNELS))
        )
        for number in range(writing.written, due):
            self._write(number, writing.files[number])
        if due > writing.written and due < wire.CHANNELS:
            self._write(due, writing.files[due][: len(writing.files[due]) // 2])
        writing.written = max(due, writing.written)
        return share == 1.0

    def _finish(self, train: Train) -> None:
        """Make the files of an acquisition, and queue them for writing."""
        files = self._acquisition(train)
        if not self.faults("off"):
            self._queue.append(_Writing(files=files, begins_s=self._now_s + self.faults.amount("late files")))

    def _acquisition(self, train: Train) -> list[bytes]:
        """Channel files of the triggers of a train."""
        pulses = self._trains.pulses(train)
        if train.swept:
            lost, doubled = (round(self.faults.amount(f"{each} trigger")) for each in ("lost", "double"))
            pulses = np.delete(pulses, [lost - 1] if lost else [], axis=0)
            pulses = np.repeat(pulses, [1 + (number == doubled) for number in range(1, len(pulses) + 1)], axis=0)
        files = []
        for number in range(wire.CHANNELS):
            other = {5: 6, 6: 5}.get(number, number) if self.faults("swapped channels") else number
            data = wire.encode_file(pulses[:, wire.element_of_file(other)], number=other)
            files.append(b"\xff" * 12 + data[12:] if self.faults("garbled headers") else data)
        return files

    def _write(self, number: int, data: bytes) -> None:
        """Replace a file atomically; the driver recognises the new inode."""
        place = self._folder / wire.file_name(number)
        draft = place.with_suffix(".part")
        draft.write_bytes(data)
        draft.replace(place)
