"""A folder that changes as a script of bytes says, filled with content that could harm a reader.

A step has 8 bytes: an action, its channel, its time, and numbers. If the first byte of the script is even, a valid
acquisition is written before the first step.
"""

from __future__ import annotations

import os
import shutil
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from markerseek.sim import VirtualClock
from markerseek.wire import sonixdaq

STEP = struct.Struct("<BBBBhh")
PULSES, SAMPLES = 4, 6
TRIGGERED = 4
"""When the acquisition is written; a step of a smaller number is made before that, at arming or at the start."""

_LARGE_BYTES = 1 << 33


def whole_folder() -> bytes:
    """Nothing but the acquisition."""
    return b"\0"


class FolderClock(VirtualClock):
    """Time in which a folder changes: each wait is the next moment."""

    def __init__(self, folder: Path, data: bytes) -> None:
        super().__init__()
        self._folder = folder
        self._sound = not (data[:1] and data[0] & 1)
        steps = data[1 : 1 + 64 * STEP.size]
        self._steps = [STEP.unpack_from(steps, at) for at in range(0, len(steps) - STEP.size + 1, STEP.size)]
        self._moment = 0
        self._make(0)

    def wait(self, duration_s: float) -> None:
        super().wait(duration_s)
        self._moment += 1
        self._make(self._moment)

    def trigger(self) -> None:
        """Write an acquisition, and what comes with it."""
        self._moment = max(self._moment, TRIGGERED)
        if self._sound:
            for number in range(sonixdaq.CHANNELS):
                self._write(number, frames=PULSES, samples=SAMPLES)
        self._make(self._moment)

    def _make(self, moment: int) -> None:
        for kind, number, when, name, first, second in self._steps:
            if when % 16 == moment:
                place = self._folder / _NAMES[name % len(_NAMES)].format(number)
                _clear(place)
                _KINDS[kind % len(_KINDS)](place, number, first, second)

    def _write(self, number: int, *, frames: int, samples: int) -> None:
        pulses = np.full((frames, samples), number, np.int16)
        place = self._folder / f"CH{number:03d}.daq"
        _clear(place)  # a pipe would wait for a reader
        place.write_bytes(sonixdaq.encode_file(pulses, number=number))


def _clear(place: Path) -> None:
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)


def _new(place: Path, number: int, frames: int, samples: int) -> None:
    count = 2 * max(0, min(frames * samples, 5000))
    place.write_bytes(struct.pack("<3i", number, frames, samples) + bytes(count))


def _old(place: Path, number: int, frames: int, samples: int) -> None:
    count = 2 * max(0, min(frames * samples, 5000))
    place.write_bytes(struct.pack("<2i", frames, samples) + bytes(count))


def _short(place: Path, number: int, frames: int, samples: int) -> None:
    place.write_bytes(struct.pack("<3i", number, frames, samples)[: frames % 13])


def _sparse(place: Path, number: int, frames: int, samples: int) -> None:
    count = _LARGE_BYTES // max(1, abs(frames)) // 2
    with place.open("wb") as file:
        file.write(struct.pack("<3i", number % 128, PULSES, min(count // PULSES, 2**31 - 1)))
        file.truncate(12 + 2 * PULSES * (count // PULSES))


def _folder(place: Path, number: int, first: int, second: int) -> None:
    place.mkdir()


def _linked_to(target: str) -> Callable[[Path, int, int, int], None]:
    def link(place: Path, number: int, first: int, second: int) -> None:
        place.symlink_to(target if target else place)

    return link


def _pipe(place: Path, number: int, first: int, second: int) -> None:
    os.mkfifo(place)


def _gone(place: Path, number: int, first: int, second: int) -> None:
    pass


_NAMES = ("CH{:03d}.daq", "CH{:03d}-0000.daq", "ch{:03d}.DAQ", "CH{:03d}-9999.daq", "CH{:03d}.part")
_KINDS: tuple[Callable[[Path, int, int, int], None], ...] = (
    _new,
    _old,
    _short,
    _sparse,
    _folder,
    _linked_to("nowhere"),
    _linked_to(""),
    _linked_to("/dev/zero"),
    _linked_to("/"),
    _linked_to("CH001.daq"),
    _pipe,
    _gone,
)
