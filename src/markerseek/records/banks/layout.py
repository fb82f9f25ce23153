"""How the frames of a recording are arranged: their angles, the order of their axes, the channels that are left out."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from itertools import permutations
from pathlib import Path

import numpy as np

from markerseek.core import Bool, RecordError
from markerseek.files import MIB, is_number, read_text
from markerseek.records.banks.bank import chosen_channels, silenced

AXES = ("angles", "channels", "samples")
"""Axes of frames, in their order."""


def angles_in(path: Path) -> tuple[float, ...]:
    """Angles in degrees of a text file with one on each line, below a name or not; `RecordError` if it is none."""
    cure = "write one angle in degrees on each line"
    text = read_text(path, most_bytes=MIB, what="a list of angles", cure=cure, also=("cp1252",))
    # A comma can only be the sign of the decimals.
    texts = [line.strip().replace(",", ".").replace("\u2212", "-") for line in text.split("\n") if line.strip()]
    try:
        return tuple(float(text) for text in texts[1 if texts and not is_number(texts[0]) else 0 :])
    except ValueError as problem:
        raise RecordError(f"{path}: {problem}; {cure}") from problem


def turned(path: Path, frames: np.ndarray, stated: tuple[str, ...] | None, *, angles: int | None) -> np.ndarray:
    """Frames with their axes in our order; a message names the orders that would fit.

    ``stated``: their order, where a person or the format states it. ``angles``: how many there are; None if the file
    does not say.
    """
    axes = AXES if stated is None else stated
    expected = f"({', '.join(axes)}) expected"
    if frames.ndim != len(AXES):
        raise RecordError(f"{path}: frames is {frames.dtype} of shape {frames.shape}, {expected}")
    orders = [order for order in permutations(AXES) if _fits(frames.shape, order, angles)]
    by_axis = dict(zip(axes, frames.shape, strict=True))
    if angles not in (None, by_axis["angles"]) or 0 in frames.shape:
        offer = f"; state their order: --axes {_choice(orders)}" if orders and 0 not in frames.shape else ""
        given = "" if angles is None else f" for {angles} angles"
        raise RecordError(f"{path}: frames has the shape {frames.shape}{given}; {expected}{offer}")
    if stated is None and axes not in orders:
        raise RecordError(
            f"{path}: frames has the shape {frames.shape}, so that {by_axis['channels']} channels would have "
            f"{by_axis['samples']} samples each: if the record is so short, state it, --axes {','.join(axes)}"
            + (f"; else state the order of the axes, --axes {_choice(orders)}" if orders else "")
        )
    alike = [order for order in orders if dict(zip(order, frames.shape, strict=True)) == by_axis]
    if stated is None and len(alike) > 1:
        raise RecordError(
            f"{path}: frames has the shape {frames.shape}, and axes of equal length do not show which is which; state "
            f"their order: --axes {_choice(alike)}"
        )
    return np.transpose(frames, [axes.index(each) for each in AXES])


def _choice(orders: Sequence[tuple[str, ...]]) -> str:
    return " or ".join(",".join(order) for order in orders)


def _fits(shape: tuple[int, ...], axes: tuple[str, ...], angles: int | None) -> bool:
    """Whether the axes may have this order: a frame has more samples than channels."""
    by_axis = dict(zip(axes, shape, strict=True))
    return angles in (None, by_axis["angles"]) and 0 < by_axis["channels"] <= by_axis["samples"]


_FEW_CHANNELS, _NOISE_RATIO, _LOOKED_AT = 0.05, 5.0, 16
"""Largest share of channels that are left out unasked; noise of one over the usual; frames that are looked at."""


def without_channels_of(path: Path, frames: np.ndarray, stated: tuple[int, ...]) -> np.ndarray:
    """The frames with zeros in the channels that are stated, or that hold NaN or nothing but noise."""
    channels = frames.shape[1]
    left_out = chosen_channels(path, stated, count=channels)
    said = [f"channel {number} is left out, as asked" for number in sorted(set(stated))]
    few = _few(channels)
    broken = broken_channels(frames, left_out)
    left_out |= broken
    said += said_of_broken(broken)
    looked_at = frames[:: max(1, len(frames) // _LOOKED_AT)]
    looked_at = (looked_at.real if looked_at.dtype.kind == "c" else looked_at).astype(np.float64)
    with warnings.catch_warnings():
        # Of a channel, or frame, of NaN alone.
        warnings.simplefilter("ignore", RuntimeWarning)
        centred = np.abs(looked_at - np.nanmedian(looked_at, axis=2, keepdims=True))
        noise = np.nanmedian(np.nanmedian(centred, axis=2), axis=0)
        noisy = (noise > _NOISE_RATIO * np.nanmedian(noise)) & (np.nanmedian(noise) > 0) & ~left_out
    if 0 < noisy.sum() <= few:
        left_out |= noisy
        ratio = noise / np.nanmedian(noise)
        said += [
            f"channel {number} has {ratio[number - 1]:.3g} times the noise of the others, and is left out"
            for number in _numbers_of(noisy)
        ]
    if not left_out.any():
        return frames
    warnings.warn(f"{path}: {'; '.join(said)}", stacklevel=3)
    return silenced(frames, np.flatnonzero(left_out).tolist())


def broken_channels(frames: Iterable[np.ndarray], left_out: Bool[np.ndarray, " channels"]) -> np.ndarray:
    """Which channels hold NaN or infinity in any frame of (channels, samples), where they are few.

    ``left_out``: channels that are left out anyway, and not looked at.
    """
    broken = [~np.isfinite(each).all(axis=1) for each in frames if len(each) == len(left_out)]
    # A frame without a single number is no matter of its channels.
    somewhere = np.any([each for each in broken if not each.all()] or [np.zeros_like(left_out)], axis=0) & ~left_out
    return somewhere if somewhere.sum() <= _few(len(left_out)) else np.zeros_like(left_out)


def said_of_broken(broken: Bool[np.ndarray, " channels"]) -> list[str]:
    """What a warning says of `broken_channels`."""
    return [f"channel {number} holds NaN or infinity, and is left out" for number in _numbers_of(broken)]


def _few(channels: int) -> int:
    return max(1, int(_FEW_CHANNELS * channels))


def _numbers_of(chosen: Bool[np.ndarray, " channels"]) -> list[int]:
    return [index + 1 for index in np.flatnonzero(chosen).tolist()]
