"""Peaks of an image: the highest local maxima, and the position of a peak between the pixels."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from markerseek.core import Float32, Float64
from markerseek.signals._kernel import local_maxima
from markerseek.signals.beamform import ImageGrid
from markerseek.signals.envelope import ENVELOPE_MARGIN, envelope
from markerseek.signals.presets import ProbePreset

_FINE = np.arange(-3, 4) * 0.25


def strongest_peaks(
    envelope: Float32[np.ndarray, "depth lateral"], *, level: float, limit: int
) -> list[tuple[int, int]]:
    """Row and column of the highest local maxima above ``level``, highest first."""
    places = local_maxima(envelope, np.float32(level))
    heights = envelope[places[:, 0], places[:, 1]]
    order = np.argsort(-heights, kind="stable")[:limit]
    return [(int(places[k, 0]), int(places[k, 1])) for k in order]


def parabola_peak(left: float, middle: float, right: float) -> tuple[float, float]:
    """Offset (in steps, -0.5 to 0.5) and height of the parabola's top through three values, the middle one highest."""
    bend = left - 2 * middle + right
    if not bend < 0:
        return 0.0, middle
    offset = min(0.5, max(-0.5, 0.5 * (left - right) / bend))
    return offset, middle - 0.25 * (left - right) * offset


@runtime_checkable
class ImageAt(Protocol):
    """Image on any columns and rows, before its envelope."""

    def __call__(
        self, *, lateral_m: Float64[np.ndarray, " lateral"], depth_m: Float64[np.ndarray, " depth"]
    ) -> Float32[np.ndarray, "depth lateral"]:
        """Beamformed signal there."""


def refine_peak(
    image_at: ImageAt, preset: ProbePreset, grid: ImageGrid, *, place: tuple[int, int]
) -> tuple[float, float, float]:
    """Lateral position and depth in metres, and height, of the peak at a pixel (row, column) of the image.

    The pixel's surroundings are beamformed again on columns a quarter of a pitch apart: a beam is about as wide as the
    pitch, so that a source midway between two columns is up to 4 dB too weak in the image. The new columns reach beyond
    midway: the number of channels changes from column to column, and the nearest column is not always the highest.
    """
    row, column = place
    first = max(0, row - ENVELOPE_MARGIN - 1)
    depth = grid.depth_m[first : row + ENVELOPE_MARGIN + 2]
    fine = _FINE * preset.array.pitch_m
    lateral = grid.lateral_m[column] + fine
    patch = envelope(image_at(lateral_m=lateral, depth_m=depth)).astype(np.float64)
    low, high = max(0, row - first - 1), min(len(depth), row - first + 2)
    best = np.unravel_index(int(np.argmax(patch[low:high])), patch[low:high].shape)
    i, j = int(best[0]) + low, int(best[1])
    down, height = _top(patch[:, j], i)
    side, across = _top(patch[i], j)
    # The two parabolas share their middle value, which is counted once.
    return (
        float(lateral[j] + side * (fine[1] - fine[0])),
        float(depth[i] + down * preset.depth_step_m),
        height + across - float(patch[i, j]),
    )


def _top(values: Float64[np.ndarray, " n"], place: int) -> tuple[float, float]:
    """`parabola_peak` at a place in a row of values; at its ends the value itself."""
    if not 0 < place < len(values) - 1:
        return 0.0, float(values[place])
    return parabola_peak(float(values[place - 1]), float(values[place]), float(values[place + 1]))
