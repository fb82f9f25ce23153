"""Puts the frames of a Vantage's receive buffer into the order of the scan: the buffer is a ring.

The frame behind the last one is the oldest. `Resource.RcvBuffer.lastFrame` states the last one. Without it, only frames
that were never filled show that the ring has not gone round, so that its frame 1 is the first.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from markerseek.core import Bool, ConfigError, RecordError
from markerseek.records.banks.bank import first_of
from markerseek.records.vantage import LAST, NUMBERS


def in_scan_order(
    path: Path, arrays: Mapping[str, np.ndarray], value: str, *, angles: int | None, first_frame: int | None
) -> dict[str, np.ndarray]:
    """The arrays with ``frames``, ``pulses`` and `NUMBERS` of a ring in the order of the scan.

    ``value``: name of the array that is read; `NUMBERS` are left out where it is not that of the ring. ``angles``: how
    many numbers the variable of the angles holds; None: each frame has its angle by its place, so that the first frame
    must be known. ``first_frame``: number of the frame with the first angle, where a person states it.
    """
    if NUMBERS not in arrays or value != "frames":
        if first_frame is not None:
            raise ConfigError(
                f"{path}: a first frame is for the receive buffer of a Verasonics workspace; leave --first-frame out"
            )
        return {name: each for name, each in arrays.items() if name != NUMBERS}
    numbers = arrays[NUMBERS]
    empty = ~_held(arrays["frames"])
    if first_frame is not None:
        if first_frame not in numbers:
            raise ConfigError(f"{path}: --first-frame is {first_frame}, the buffer has {numbers[0]} to {numbers[-1]}")
        start: int | None = int(np.flatnonzero(numbers == first_frame)[0])
    else:
        start = _start(empty, _last_index(arrays))
    if start is None and angles is None:
        raise RecordError(
            f"{path}: {_unknown(arrays)}, and the angle of a frame follows from its place in the scan; save Resource "
            f"(its RcvBuffer.lastFrame) too, or name the frame with the first angle: --first-frame {numbers[0]} if the "
            "ring has not gone round"
        )
    if start is None:
        warnings.warn(
            f"{path}: {_unknown(arrays)}; the angles are taken in the order of the buffer, frame {numbers[0]} first "
            "(--first-frame)",
            stacklevel=4,
        )
    order = np.roll(np.arange(len(numbers)), -(start or 0))
    if angles is not None and angles != len(order):
        # Frames behind the end of the scan have no angle.
        order = order[: np.flatnonzero(~empty[order])[-1] + 1]
    return {**arrays, **{name: arrays[name][order] for name in ("frames", "pulses", NUMBERS)}}


def filled(path: Path, frames: np.ndarray, numbers: np.ndarray) -> Bool[np.ndarray, " frames"]:
    """Which frames of a buffer hold anything but zeros; warns of the others.

    Where all hold zeros only, none is left out: the receiver received nothing.
    """
    held = _held(frames)
    if not held.any():
        return np.ones_like(held)
    if not held.all():
        names = [str(number) for number in np.sort(numbers[~held])]
        warnings.warn(f"{path}: {len(names)} frames hold zeros only, and are left out: {first_of(names)}", stacklevel=3)
    return held


def _held(frames: np.ndarray) -> Bool[np.ndarray, " frames"]:
    """Which frames hold anything but zeros."""
    return np.asarray(frames.any(axis=(1, 2)))


def _last_index(arrays: Mapping[str, np.ndarray]) -> int | None:
    """Index of the last frame; None if the file does not state it, or states another number."""
    last = arrays.get(LAST, np.array(0))
    found = np.flatnonzero(arrays[NUMBERS] == last)
    return int(found[0]) if found.size else None


def _start(empty: Bool[np.ndarray, " frames"], last: int | None) -> int | None:
    """Index of the oldest frame; None if nothing proves which one it is."""
    end = len(empty) if last is None else last + 1
    if last is None:
        end = int(np.flatnonzero(~empty)[-1]) + 1
    behind = empty[end:]
    if not behind.size:
        return None if last is None else 0
    if not behind.all():
        return end
    # Frames that were never filled are the end of a ring that has not gone round. Frames that were lost are empty too:
    # the end counts only if it is longer than any gap before it.
    longest = int(np.diff(np.flatnonzero(~empty[:end]), prepend=-1).max()) - 1
    return 0 if behind.size > longest else None


def _unknown(arrays: Mapping[str, np.ndarray]) -> str:
    last = _last_index(arrays)
    if last is None:
        return "Resource.RcvBuffer.lastFrame is missing, so that it is unknown where the ring of frames begins"
    return f"all frames behind the last, {arrays[NUMBERS][last]}, hold zeros, and so do others: lost or never filled"
