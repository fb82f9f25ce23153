"""One-way delay-and-sum, on columns at the elements or at any lateral position.

At the elements the delay depends on the depth and on the lateral distance alone: one small table serves every column.
The sum is linear in the signals, with linear interpolation between samples, and is divided by the root of the number
of channels in it, so that white noise is equally strong at every depth. No apodisation, no weighting by directivity.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from markerseek.core import ConfigError, Float32, Float64, Int32, LinearArray
from markerseek.signals._kernel import PAD, beams, delay_and_sum
from markerseek.signals.filtering import ENVELOPE_MARGIN, padded_columns
from markerseek.signals.presets import ProbePreset


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DelayTable:
    """Delays for columns at the elements."""

    first: Int32[np.ndarray, "distances depths"]
    """Sample before the delay; -1 where the element is not used."""
    weight: Float32[np.ndarray, "distances depths"]
    """Weight of the sample after the delay, same shape."""
    scale: Float32[np.ndarray, "depths columns"]
    """One over the root of the number of channels used; 0 where no channel is used."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageGrid:
    """Positions of the pixels, and their table of delays."""

    lateral_m: Float64[np.ndarray, " lateral"]
    """Columns, along the array from its centre."""
    depth_m: Float64[np.ndarray, " depth"]
    """Rows, from the array's face."""
    samples: int
    """Length of the records that the table is made for."""
    table: DelayTable


def path_delay(preset: ProbePreset) -> tuple[float, float]:
    """Return the samples per metre of path, and the sample number (a fraction) of the laser's pulse."""
    return preset.sampling_hz / preset.sound_speed_m_s, preset.trigger_offset_s * preset.sampling_hz


@lru_cache(maxsize=8)
def elements_m(array: LinearArray) -> Float64[np.ndarray, " elements"]:
    """Return the centre of each element along the array, made once, because every frame asks for it ten times."""
    return array.lateral_m


def half_aperture_m(
    preset: ProbePreset, depth_m: Float64[np.ndarray, " depth"], *, at_least: float = 0.5
) -> Float64[np.ndarray, " depth"]:
    """Return half the width of the receiving aperture in metres, at least ``at_least`` pitches."""
    if preset.f_number == 0:
        return np.full(len(depth_m), np.inf)
    # Wider by 1e-9, so that rounding does not decide about an element on the edge.
    return np.maximum(depth_m / (2 * preset.f_number), at_least * preset.array.pitch_m) * (1 + 1e-9)


def image_grid(preset: ProbePreset, *, samples: int, depth_m: Float64[np.ndarray, " depth"]) -> ImageGrid:
    """Return the grid and table for records of that length, with a column on each element.

    ``preset``: probe, sound speed, aperture and trigger offset. ``samples``: length of the records. ``depth_m``: rows,
    positive and ascending.
    """
    if len(depth_m) == 0 or not (np.all(np.diff(depth_m) > 0) and depth_m[0] > 0 and depth_m[-1] < np.inf):
        raise ConfigError("depth_m must hold at least one depth, all positive, finite and rising")
    array = preset.array
    lateral = elements_m(array)[0] + np.arange(array.elements) * array.pitch_m
    per_metre, origin = path_delay(preset)
    table = delay_table(
        array,
        place=lambda offset_m: np.hypot(offset_m, depth_m) * per_metre + origin,
        reach_m=half_aperture_m(preset, depth_m),
        samples=samples,
    )
    return ImageGrid(lateral_m=lateral, depth_m=depth_m, samples=samples, table=table)


def beamform(signals: Float32[np.ndarray, "samples columns"], grid: ImageGrid) -> Float32[np.ndarray, "depth lateral"]:
    """Return the image of filtered channels (from `filtering.band_pass`), in the unit of the signals."""
    if signals.shape[0] != grid.samples:
        raise ConfigError(f"beamform: the records have {signals.shape[0]} samples, the table is for {grid.samples}")
    table = grid.table
    sums = np.empty((len(grid.depth_m), signals.shape[1] - 2 * PAD), np.float32)
    delay_and_sum(signals, table.first, table.weight, table.scale, sums)
    return np.ascontiguousarray(sums[:, : len(grid.lateral_m)])


def beamform_at(
    signals: Float32[np.ndarray, "samples columns"],
    preset: ProbePreset,
    *,
    lateral_m: Float64[np.ndarray, " lateral"],
    depth_m: Float64[np.ndarray, " depth"],
) -> Float32[np.ndarray, "depth lateral"]:
    """Return the image on any columns, otherwise as `beamform`, which takes less time per pixel."""
    image = np.empty((len(depth_m), len(lateral_m)), np.float32)
    aperture = half_aperture_m(preset, depth_m)
    beams(signals, elements_m(preset.array), lateral_m, depth_m, path_delay(preset), aperture, image)
    return image


def image_rows(preset: ProbePreset, *, samples: int) -> tuple[Float64[np.ndarray, " depth"], slice]:
    """Return the depths of an image with the rows that the envelope needs beyond it, and the slice without these.

    ``preset``: its pick-up and trigger offset limit the depths. ``samples``: length of the records.
    """
    metres = preset.sound_speed_m_s / preset.sampling_hz
    origin = preset.trigger_offset_s * preset.sampling_hz
    step = preset.depth_step_m
    near = max((preset.pickup_samples - origin) * metres, step)
    far = (samples - 1 - origin) * metres
    if not far - near >= 3 * step:
        raise ConfigError(
            f"the record of {samples} samples ends at a depth of {1e3 * far:.4g} mm, and the image would begin at "
            f"{1e3 * near:.4g} mm; check trigger_offset_s and pickup_samples of the probe"
        )
    above = min(ENVELOPE_MARGIN, math.floor((near - step / 2) / step))
    count = math.floor((far - near) / step) + 1
    return near + step * np.arange(-above, count), slice(above, above + count)


def delay_table(
    array: LinearArray,
    *,
    place: Callable[[Float64[np.ndarray, "distances 1"]], Float64[np.ndarray, "distances depths"]],
    reach_m: Float64[np.ndarray, " depths"],
    samples: int,
) -> DelayTable:
    """Return the table of any delay that depends on the depth and on the lateral distance alone.

    ``place``: delay in samples at lateral distances in metres. ``reach_m``: how far the aperture reaches at each depth;
    infinity for the whole array. ``samples``: length of the records.
    """
    reached = np.searchsorted(np.arange(array.elements) * array.pitch_m, reach_m.max(), side="right")
    # Up to three more rows: the kernel takes four distances at a time.
    number = np.arange(-(-int(reached) // 4) * 4)[:, None]
    distance_m = number * array.pitch_m
    delay = place(distance_m)
    # Linear interpolation between samples: weight 1 − w before the delay and w after it.
    first = np.floor(delay)
    usable = (distance_m <= reach_m) & (number < array.elements) & (first >= 0) & (first < samples - 1)
    # Sound reaches far elements later, so that no element beyond the first unusable one is usable. Only a trigger
    # offset that hides the start breaks this rule; the kernel stops at the first gap and leaves such a pixel out.
    usable &= np.cumsum(~usable, axis=0) == 0
    count = usable.sum(axis=0)[:, None]
    column = np.arange(padded_columns(array.elements))
    # Elements to the left and to the right within the aperture, and the one on the column.
    used = np.minimum(column, count - 1) + np.minimum(array.elements - 1 - column, count - 1) + 1
    used = np.where((count > 0) & (column < array.elements), used, 0)
    return DelayTable(
        first=np.where(usable, first, -1).astype(np.int32),
        weight=np.where(usable, delay - first, 0).astype(np.float32),
        scale=np.where(used > 0, 1 / np.sqrt(np.maximum(used, 1)), 0).astype(np.float32),
    )
