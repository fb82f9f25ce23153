"""The frames of a receive buffer, a ring, in the order of the scan: where it begins, and which frames were filled."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from markerseek.core import Bool, ConfigError, RecordError
from markerseek.records.banks.bank import first_of
from markerseek.records.notes import note
from markerseek.records.vantage import LAST, NUMBERS


def in_scan_order(
    path: Path, arrays: Mapping[str, np.ndarray], value: str, *, angles: np.ndarray | None, first_frame: int | None
) -> dict[str, np.ndarray]:
    """Return the arrays with ``frames``, ``pulses`` and `NUMBERS` of a ring in the order of their angles.

    ``value``: name of the array that is read; `NUMBERS` are left out where it is not that of the ring. ``angles``: as
    they are stated, in the order of the scan or of the buffer; None: each frame has its angle by its place in the scan.
    ``first_frame``: number of the frame with the first angle, where a person states it.
    """
    if NUMBERS not in arrays or value != "frames":
        if first_frame is not None:
            raise ConfigError(
                f"{path}: a first frame is for the receive buffer of a Verasonics workspace; leave `first_frame` out"
            )
        return {name: each for name, each in arrays.items() if name != NUMBERS}
    numbers = arrays[NUMBERS]
    empty = ~_held(arrays["frames"])
    if first_frame is not None and first_frame not in numbers:
        raise ConfigError(f"{path}: `first_frame` is {first_frame}, the buffer has {numbers[0]} to {numbers[-1]}")
    if first_frame is not None:
        start: int | None = int(np.flatnonzero(numbers == first_frame)[0])
    else:
        start = _start_by_angles(path, arrays, angles, _start(empty, _last_index(arrays)))
    if start is None:
        raise RecordError(
            f"{path}: {_unknown(arrays)}, and the angle of a frame follows from its place in the scan; save Resource "
            f"(its RcvBuffer.lastFrame) too, or name the frame with the first angle: `first_frame={numbers[0]}` if the "
            "ring has not gone round, or the angles are in the order of the buffer"
        )
    order = np.roll(np.arange(len(numbers)), -start)
    if angles is not None and len(angles) != len(order):
        # Frames behind the end of the scan have no angle.
        order = order[: np.flatnonzero(~empty[order])[-1] + 1]
    return {**arrays, **{name: arrays[name][order] for name in ("frames", "pulses", NUMBERS)}}


def _start_by_angles(
    path: Path, arrays: Mapping[str, np.ndarray], angles: np.ndarray | None, start: int | None
) -> int | None:
    """Return the index of the frame with the first of the angles; None if nothing proves which one it is.

    Angles that rise or fall all around but for one jump are in the order of a ring that has gone round: the first of
    them belongs to the first frame of the buffer. ``start``: index of the oldest frame, None if it is not known.
    """
    jump = None if angles is None or len(angles) != len(arrays[NUMBERS]) else _jump_of(angles)
    if jump is None:
        return start
    if start not in (None, jump):
        numbers = arrays[NUMBERS]
        raise RecordError(
            f"{path}: the angles begin anew at frame {numbers[jump]}, and the oldest frame is {numbers[start]}; name "
            "the frame with the first of the angles: `first_frame`"
        )
    return 0


def _jump_of(angles: np.ndarray) -> int | None:
    """Return the place at which a list that otherwise rises, or falls, all around starts again.

    None if it has no such place, as a list that rises or falls from its beginning to its end.
    """
    steps = np.sign(np.diff(angles, append=angles[:1]))
    for direction in (1, -1):
        back = np.flatnonzero(steps != direction)
        if back.size == 1 and back[0] < len(angles) - 1 and steps[back[0]] == -direction:
            return int(back[0]) + 1
    return None


def filled(path: Path, frames: np.ndarray, numbers: np.ndarray) -> Bool[np.ndarray, " frames"]:
    """Return which frames of a buffer hold anything but zeros; warns of the others.

    Where all hold zeros only, none is left out: the receiver received nothing.
    """
    held = _held(frames)
    if not held.any():
        return np.ones_like(held)
    if not held.all():
        names = [str(number) for number in np.sort(numbers[~held])]
        note(path, f"{len(names)} frames hold zeros only, and are left out: {first_of(names)}")
    return held


def _held(frames: np.ndarray) -> Bool[np.ndarray, " frames"]:
    """Return which frames hold anything but zeros."""
    return np.asarray(frames.any(axis=(1, 2)))


def _last_index(arrays: Mapping[str, np.ndarray]) -> int | None:
    """Return the index of the last frame; None if the file does not state it, or states another number."""
    last = arrays.get(LAST, np.array(0))
    found = np.flatnonzero(arrays[NUMBERS] == last)
    return int(found[0]) if found.size else None


def _start(empty: Bool[np.ndarray, " frames"], last: int | None) -> int | None:
    """Return the index of the oldest frame; None if nothing proves which one it is."""
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
