"""Brings the frames of other programs into our form: the order of their axes, channels left out, int16 counts.

Whole numbers stay as they are, less the middle of an offset binary code. What is no count, does not fit or has glitches
is scaled: by the loudest sound of all but a twentieth of the channels, outside of the blanked samples, so that neither
the laser's pick-up nor a glitch in one channel sets the scale.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np

from markerseek.core import Bool, Float64, Int16, RecordError
from markerseek.records.banks.bank import chosen_channels, silenced
from markerseek.records.banks.table_format import AXES
from markerseek.records.notes import note


def turned(path: Path, frames: np.ndarray, stated: tuple[str, ...] | None, *, angles: int | None) -> np.ndarray:
    """Return the frames with their axes in our order; a message names the orders that would fit.

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
        offer = f"; state their order: `axes={_choice(orders)}`" if orders and 0 not in frames.shape else ""
        given = "" if angles is None else f" for {angles} angles"
        raise RecordError(f"{path}: frames has the shape {frames.shape}{given}; {expected}{offer}")
    if stated is None and axes not in orders:
        raise RecordError(
            f"{path}: frames has the shape {frames.shape}, so that {by_axis['channels']} channels would have "
            f"{by_axis['samples']} samples each: if the record is so short, state it, `axes={','.join(axes)}`"
            + (f"; else state the order of the axes, `axes={_choice(orders)}`" if orders else "")
        )
    alike = [order for order in orders if dict(zip(order, frames.shape, strict=True)) == by_axis]
    if stated is None and len(alike) > 1:
        raise RecordError(
            f"{path}: frames has the shape {frames.shape}, and axes of equal length do not show which is which; state "
            f"their order: `axes={_choice(alike)}`"
        )
    return np.transpose(frames, [axes.index(each) for each in AXES])


def _choice(orders: Sequence[tuple[str, ...]]) -> str:
    return " or ".join(",".join(order) for order in orders)


def _fits(shape: tuple[int, ...], axes: tuple[str, ...], angles: int | None) -> bool:
    """Return whether the axes may have this order: a frame has more samples than channels."""
    by_axis = dict(zip(axes, shape, strict=True))
    return angles in (None, by_axis["angles"]) and 0 < by_axis["channels"] <= by_axis["samples"]


def unpadded(frames: np.ndarray) -> tuple[np.ndarray, str]:
    """Return the frames without the NaN that other programs write behind the end of a record, and what was done.

    Padding is NaN in all channels. What is padding in all frames is cut off. In a frame that is shorter than others,
    each channel's median stands there.
    """
    if frames.dtype.kind not in "fc":
        return frames, ""
    lengths = np.array([_length(each) for each in frames])
    longest = int(lengths.max(initial=0))
    # A frame without a single number is no matter of its end.
    short = np.flatnonzero((lengths < longest) & (lengths > 0))
    if longest == 0 or (longest == frames.shape[2] and not short.size):
        return frames, ""
    said = f"its records end with NaN in all channels: {longest} of {frames.shape[2]} samples are read"
    if short.size:
        said += f", and {short.size} shorter records are filled with the median of each channel"
    cut = frames[:, :, :longest].copy()
    with warnings.catch_warnings():
        # Of a channel of NaN alone.
        warnings.simplefilter("ignore", RuntimeWarning)
        for index in short.tolist():
            length = lengths[index]
            cut[index, :, length:] = _median(cut[index, :, :length])
    return cut, said


def _median(frame: np.ndarray) -> np.ndarray:
    """Return the median of each channel, NaN aside.

    Of IQ data it is that of I and that of Q, which NumPy would order by I alone.
    """
    if frame.dtype.kind == "c":
        return np.asarray(_median(frame.real) + 1j * _median(frame.imag))
    return np.asarray(np.nanmedian(frame, axis=1, keepdims=True))


def _length(frame: np.ndarray) -> int:
    """Return the number of samples up to the last at which any channel has a number."""
    held = np.flatnonzero(~np.isnan(frame).all(axis=0))
    return int(held[-1]) + 1 if held.size else 0


def loudness(frame: np.ndarray, blanked: int) -> float:
    """Return the mean over the channels of their largest magnitudes; ``blanked``: samples that do not count."""
    imaged = frame[:, blanked:] if blanked < frame.shape[1] else frame
    return float(np.abs(_without_offset(imaged.astype(np.float64))).max(axis=1).mean())


_FEW_CHANNELS = 0.05
_NOISE_RATIO = 5.0
_LOOKED_AT = 16
"""Largest share of channels that are left out unasked; noise of one over the usual; frames that are looked at."""


def without_channels_of(path: Path, frames: np.ndarray, stated: tuple[int, ...]) -> np.ndarray:
    """Return the frames with zeros in the channels that are stated, or that hold NaN or nothing but noise."""
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
    note(path, "; ".join(said))
    return silenced(frames, np.flatnonzero(left_out).tolist())


def broken_channels(frames: Iterable[np.ndarray], left_out: Bool[np.ndarray, " channels"]) -> np.ndarray:
    """Return which channels hold NaN or infinity in any frame of (channels, samples), where they are few.

    ``left_out``: channels that are left out anyway, and not looked at.
    """
    broken = [~np.isfinite(each).all(axis=1) for each in frames if len(each) == len(left_out)]
    # A frame without a single number is no matter of its channels.
    somewhere = np.any([each for each in broken if not each.all()] or [np.zeros_like(left_out)], axis=0) & ~left_out
    return somewhere if somewhere.sum() <= _few(len(left_out)) else np.zeros_like(left_out)


def said_of_broken(broken: Bool[np.ndarray, " channels"]) -> list[str]:
    """Return what a warning says of `broken_channels`."""
    return [f"channel {number} holds NaN or infinity, and is left out" for number in _numbers_of(broken)]


def _few(channels: int) -> int:
    return max(1, int(_FEW_CHANNELS * channels))


def _numbers_of(chosen: Bool[np.ndarray, " channels"]) -> list[int]:
    return [index + 1 for index in np.flatnonzero(chosen).tolist()]


SCALED_TO = 16384.0
"""Count of the largest sound in scaled data: half of int16, since the channels that are passed over may be louder."""

_PASSED_OVER = 0.05
"""Share of a frame's channels that may hold glitches: as many as may be dead or saturated in a search."""

_SIGMA_OF_MEDIAN = 1.4826
"""Standard deviation of Gaussian noise over the median of its magnitude."""

_COUNTS = np.iinfo(np.int16)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scaling:
    """How numbers become counts, alike at all angles of a scan."""

    factor: float = 1.0
    """Counts of one unit."""
    zero: float | None = 0.0
    """Number of no sound; None: the median of each channel, and what then lies beyond int16 is clipped."""


EXACT = Scaling()
"""Of data that are counts already."""


def scaling_of(path: Path, frames: Iterable[np.ndarray], *, blanked: int = 0) -> Scaling:
    """Return how the numbers of a recording become counts; warns where they are scaled or clipped.

    ``path``: where they are from, for the messages. ``frames``: all of them, (channels, samples) each; each is looked
    at once. ``blanked``: samples at the start that are not imaged, and so have no say.
    """
    seen = [_seen(path, frame, blanked) for frame in frames]
    kinds = sorted({each.kind for each in seen})
    whole = all(each.whole for each in seen)
    if "int16" in kinds and not whole:
        raise RecordError(f"{path}: {' and '.join(kinds)} found side by side; save all frames of a scan alike")
    low = min(each.low for each in seen)
    high = max(each.high for each in seen)
    zero = 0.0 if low < 0 else _middle(float(np.median([each.median for each in seen])), high)
    loudest = max(each.loud for each in seen)
    # Neighbours of an element hear a source nearly as loud as it does: what a few channels alone have is no sound.
    room = 2 * loudest or math.inf
    exact = whole and max(each.largest for each in seen) <= room
    if exact and low - zero >= _COUNTS.min and high - zero <= _COUNTS.max:
        return Scaling(zero=zero)
    factor = 1.0 if (exact and room <= _COUNTS.max) or loudest == 0 else SCALED_TO / loudest
    beyond = sum(int((each.glitches * factor > _COUNTS.max).sum()) for each in seen)
    said = [f"the median of each channel is taken off {' and '.join(kinds)}"]
    if factor != 1:
        said.append(f"it is scaled by {factor:.4g}, its loudest sound to {SCALED_TO:g} counts")
    if beyond:
        share = beyond / sum(each.size for each in seen)
        said.append(f"{beyond} samples ({100 * share:.2g} %) lie beyond int16 and are clipped")
    sigma = factor * float(np.median([each.sigma for each in seen]))
    if 0 < sigma < 1:
        said.append(
            f"its noise is {sigma:.2g} counts only, and what is weaker than a count is lost: leave out what is "
            "loud and no sound, or blank it (pickup_samples of `probe=FILE.toml`)"
        )
    note(path, "; ".join(said))
    return Scaling(factor=factor, zero=None)


def as_counts(path: Path, values: np.ndarray, scaling: Scaling) -> Int16[np.ndarray, "channels samples"]:
    """Return one frame as counts, rounded to the nearest."""
    if values.dtype.newbyteorder("=") == np.int16 and scaling == EXACT:
        return np.ascontiguousarray(values, dtype=np.int16)
    numbers = values.astype(np.float64)
    if scaling.zero is None:
        return np.rint(_without_offset(numbers) * scaling.factor).clip(_COUNTS.min, _COUNTS.max).astype(np.int16)
    counts = numbers - scaling.zero
    if not ((counts == np.rint(counts)) & (counts >= _COUNTS.min) & (counts <= _COUNTS.max)).all():
        raise RecordError(f"{path}: {values.dtype} found beside counts of int16; save all frames of a scan alike")
    return counts.astype(np.int16)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Seen:
    """What one frame says about the scale."""

    kind: str
    whole: bool
    """Whether all numbers are whole ones."""
    size: int
    low: float
    high: float
    median: float
    loud: float
    """Largest magnitude in the channels that are not passed over, outside of the blanked samples."""
    largest: float
    """Largest magnitude in all channels, outside of the blanked samples."""
    glitches: Float64[np.ndarray, " samples"]
    """Magnitudes beyond ``loud``."""
    sigma: float
    """Standard deviation of the noise."""


def _seen(path: Path, frame: np.ndarray, blanked: int) -> _Seen:
    if frame.dtype.kind not in "iuf":
        raise RecordError(f"{path}: {frame.dtype} found, real numbers are expected; convert them")
    if not np.isfinite(frame).all():
        raise RecordError(f"{path}: a sample is not finite; replace it, or leave its angle out")
    numbers = frame.astype(np.float64)
    magnitude = np.abs(_without_offset(numbers))
    imaged = magnitude[:, blanked:] if blanked < frame.shape[1] else magnitude
    channels = np.sort(imaged.max(axis=1))
    loud = float(channels[len(channels) - 1 - min(len(channels) - 1, math.ceil(_PASSED_OVER * len(channels)))])
    return _Seen(
        kind=str(frame.dtype.newbyteorder("=")),
        whole=frame.dtype.kind != "f" or bool((numbers == np.rint(numbers)).all()),
        size=frame.size,
        low=float(numbers.min()),
        high=float(numbers.max()),
        median=float(np.median(numbers)),
        loud=loud,
        largest=float(imaged.max()),
        glitches=magnitude[magnitude > loud],
        sigma=_SIGMA_OF_MEDIAN * float(np.median(imaged)),
    )


def _without_offset(numbers: Float64[np.ndarray, "channels samples"]) -> Float64[np.ndarray, "channels samples"]:
    """Return the numbers less the median of their channel."""
    return np.asarray(numbers - np.median(numbers, axis=1, keepdims=True))


def _middle(median: float, high: float) -> float:
    """Return the middle of an offset binary code, about which numbers that are never negative lie.

    0 where they lie about none.
    """
    for bits in range(8, 17):
        middle = 2.0 ** (bits - 1)
        # A converter's own offset is a few per cent of its range at most.
        if abs(median - middle) <= middle / 16 and high < 2 * middle:
            return middle
    return 0.0
