"""One-way delay-and-sum on columns that stand on the elements, or on and midway between them.

There the delay depends on the depth and on the lateral distance alone, so that one small table serves every column.
The sum is linear in the signals, with linear interpolation between samples, and is divided by the root of the number
of channels in it: white noise is then equally strong at every depth. No apodisation, no weighting by directivity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from markerseek.core import ConfigError, LinearArray
from markerseek.core.shapes import Float32, Float64, Int32
from markerseek.signals._kernel import PAD, aligned, beams, delay_and_sum
from markerseek.signals.filtering import padded_columns
from markerseek.signals.presets import ProbePreset


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DelayTable:
    """Delays for columns that stand ``offset`` pitches beside the elements.

    Attributes
    ----------
    offset
        0 or 0.5.
    first
        Sample before the delay, shape (distances, depths); -1 where the element is not used.
    weight
        Share of the sample after it, same shape.
    scale
        One over the root of the number of channels used, shape (depths, columns); 0 where there is none.
    """

    offset: float
    first: Int32[np.ndarray, "distances depths"]
    weight: Float32[np.ndarray, "distances depths"]
    scale: Float32[np.ndarray, "depths columns"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ImageGrid:
    """Where the pixels are, and the tables that lead there.

    Attributes
    ----------
    lateral_m
        Columns, along the array from its centre, in metres.
    depth_m
        Rows, from the array's face, in metres.
    samples
        Length of the records that the tables are made for.
    tables
        One for the columns on the elements, and one for those midway if there are any.
    """

    lateral_m: Float64[np.ndarray, " lateral"]
    depth_m: Float64[np.ndarray, " depth"]
    samples: int
    tables: tuple[DelayTable, ...]


def path_delay(preset: ProbePreset) -> tuple[float, float]:
    """Samples per metre of path, and the sample number (a fraction) of the laser's pulse."""
    return preset.sampling_hz / preset.sound_speed_m_s, preset.trigger_offset_s * preset.sampling_hz


def half_aperture_m(
    preset: ProbePreset, depth_m: Float64[np.ndarray, " depth"], *, at_least: float = 0.5
) -> Float64[np.ndarray, " depth"]:
    """Half the width of the receiving aperture in metres, and no less than so many pitches."""
    if preset.f_number == 0:
        return np.full(len(depth_m), np.inf)
    # A hair more, so that rounding does not decide about an element on the edge.
    return np.maximum(depth_m / (2 * preset.f_number), at_least * preset.array.pitch_m) * (1 + 1e-9)


def image_grid(
    preset: ProbePreset, *, samples: int, depth_m: Float64[np.ndarray, " depth"], columns_per_pitch: int = 1
) -> ImageGrid:
    """Grid and tables for records of that length.

    Parameters
    ----------
    preset
        Probe, sound speed, aperture and trigger offset.
    samples
        Length of the records.
    depth_m
        Rows in metres, positive and rising.
    columns_per_pitch
        1: columns on the elements; 2: also midway between them.
    """
    if columns_per_pitch not in (1, 2):
        raise ConfigError(f"columns_per_pitch is {columns_per_pitch}; 1 and 2 are possible")
    if len(depth_m) == 0 or not (np.all(np.diff(depth_m) > 0) and depth_m[0] > 0 and depth_m[-1] < np.inf):
        raise ConfigError("depth_m must hold at least one depth, all positive, finite and rising")
    array = preset.array
    tables = [_table(preset, samples=samples, depth_m=depth_m, offset=0.5 * half) for half in range(columns_per_pitch)]
    lateral = array.lateral_m[0] + np.arange(columns_per_pitch * (array.elements - 1) + 1) * (
        array.pitch_m / columns_per_pitch
    )
    return ImageGrid(lateral_m=lateral, depth_m=depth_m, samples=samples, tables=tuple(tables))


def beamform(signals: Float32[np.ndarray, "samples columns"], grid: ImageGrid) -> Float32[np.ndarray, "depth lateral"]:
    """Image of filtered channels (from `filtering.band_pass`), shape (depth, lateral), in the unit of the signals."""
    if signals.shape[0] != grid.samples:
        raise ConfigError(f"beamform: records of {signals.shape[0]} samples, and tables for {grid.samples}")
    image = np.empty((len(grid.depth_m), len(grid.lateral_m)), np.float32)
    for number, table in enumerate(grid.tables):
        right = 0 if table.offset == 0 else 1
        sums = np.empty((len(grid.depth_m), signals.shape[1] - 2 * PAD), np.float32)
        delay_and_sum(signals, table.first, table.weight, table.scale, right, 0, sums)
        if len(grid.tables) == 1 and sums.shape[1] == len(grid.lateral_m):
            return sums
        part = image[:, number :: len(grid.tables)]
        part[:] = sums[:, : part.shape[1]]
    return image


def beamform_at(
    signals: Float32[np.ndarray, "samples columns"],
    preset: ProbePreset,
    *,
    lateral_m: Float64[np.ndarray, " lateral"],
    depth_m: Float64[np.ndarray, " depth"],
) -> Float32[np.ndarray, "depth lateral"]:
    """Image on any columns, slower by the pixel than `beamform`, otherwise the same."""
    image = np.empty((len(depth_m), len(lateral_m)), np.float32)
    aperture = half_aperture_m(preset, depth_m)
    beams(signals, preset.array.lateral_m, lateral_m, depth_m, path_delay(preset), aperture, image)
    return image


def aligned_signals(
    signals: Float32[np.ndarray, "samples columns"],
    preset: ProbePreset,
    *,
    lateral_m: float,
    depth_m: Float64[np.ndarray, " depth"],
    half_width_m: Float64[np.ndarray, " depth"],
) -> tuple[Float32[np.ndarray, "depth elements"], Float64[np.ndarray, " depth"]]:
    """Each element's signal delayed to the points of one column, anywhere; and how many elements are used at each.

    Parameters
    ----------
    signals
        From `filtering.band_pass`.
    preset
        The probe.
    lateral_m, depth_m
        The column, and its points, in metres.
    half_width_m
        Half the aperture at each point in metres.
    """
    elements = preset.array.lateral_m
    out = np.empty((len(depth_m), len(elements)), np.float32)
    used = aligned(signals, elements, lateral_m, depth_m, path_delay(preset), half_width_m, out)
    return out, used.astype(np.float64)


def _table(preset: ProbePreset, *, samples: int, depth_m: Float64[np.ndarray, " depth"], offset: float) -> DelayTable:
    array: LinearArray = preset.array
    per_metre, origin = path_delay(preset)
    distance = (np.arange(array.elements) + offset) * array.pitch_m
    half = half_aperture_m(preset, depth_m)
    rows = int(np.searchsorted(distance, half.max(), side="right")) if np.isfinite(half.max()) else array.elements
    # Four more rows at most: the kernel takes four distances at a time.
    distance = (np.arange(-(-min(rows, array.elements) // 4) * 4) + offset) * array.pitch_m
    place = np.hypot(distance[:, None], depth_m) * per_metre + origin
    first = np.floor(place)
    usable = (distance[:, None] <= half) & (first >= 0) & (first < samples - 1)
    usable &= (np.arange(len(distance)) < array.elements)[:, None]
    # Sound reaches far elements later: what is out of reach at one distance is so at all larger ones, unless the
    # trigger's offset hides the start; then the kernel, which stops at the first gap, leaves the pixel out.
    usable &= np.cumsum(~usable, axis=0) == 0
    count = usable.sum(axis=0)[:, None]
    column = np.arange(padded_columns(array.elements))
    if offset == 0:
        used = np.minimum(column, count - 1) + np.minimum(array.elements - 1 - column, count - 1) + 1
    else:
        used = np.minimum(column + 1, count) + np.minimum(array.elements - 1 - column, count)
    used = np.where((count > 0) & (column < array.elements), used, 0)
    return DelayTable(
        offset=offset,
        first=np.where(usable, first, -1).astype(np.int32),
        weight=np.where(usable, place - first, 0).astype(np.float32),
        scale=np.where(used > 0, 1 / np.sqrt(np.maximum(used, 1)), 0).astype(np.float32),
    )
