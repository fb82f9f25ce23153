"""Peaks of an image: the highest local maxima, a peak between the pixels, and the largest envelope of each block.

A beam is about as wide as the pitch: a source midway between two columns is up to 4 dB too weak in the image's pixels.
"""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import numpy as np

from markerseek.core import Float32, Float64, LocalMaxima
from markerseek.signals._kernel import block_maxima, local_maxima
from markerseek.signals.beamform import ImageGrid
from markerseek.signals.filtering import ENVELOPE_MARGIN, envelope, quadrature_taps
from markerseek.signals.noise_gain import noise_peaks
from markerseek.signals.presets import ProbePreset

_FINE_COLUMNS = np.arange(-3, 4) * 0.25


def strongest_peaks(
    envelope: Float32[np.ndarray, "depth lateral"], *, level: float, limit: int
) -> list[tuple[int, int]]:
    """Return the row and column of the highest local maxima above ``level``, highest first."""
    places = local_maxima(envelope, np.float32(level))
    heights = envelope[places[:, 0], places[:, 1]]
    order = np.argsort(-heights, kind="stable")[:limit]
    return [(int(places[k, 0]), int(places[k, 1])) for k in order]


def parabola_peak(left: float, middle: float, right: float) -> tuple[float, float]:
    """Return the offset, from -0.5 to 0.5 steps, and the height of the top of a parabola through three values."""
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
    """Return the lateral position and depth in metres, and height, of the peak at a pixel (row, column) of the image.

    The pixel's surroundings are beamformed again on columns a quarter of a pitch apart: a beam is about as wide as the
    pitch, so that a source midway between two columns is up to 4 dB too weak in the image. The new columns reach beyond
    midway: the number of channels changes from column to column, and the nearest column is not always the highest.
    """
    row, column = place
    first = max(0, row - ENVELOPE_MARGIN - 1)
    depth = grid.depth_m[first : row + ENVELOPE_MARGIN + 2]
    fine = _FINE_COLUMNS * preset.array.pitch_m
    lateral = grid.lateral_m[column] + fine
    patch = envelope(image_at(lateral_m=lateral, depth_m=depth)).astype(np.float64)
    low = max(0, row - first - 1)
    high = min(len(depth), row - first + 2)
    best = np.unravel_index(int(np.argmax(patch[low:high])), patch[low:high].shape)
    i = int(best[0]) + low
    j = int(best[1])
    down, height = _interpolated_peak(patch[:, j], i)
    side, across = _interpolated_peak(patch[i], j)
    # The two parabolas share their middle value, which is counted once.
    return (
        float(lateral[j] + side * (fine[1] - fine[0])),
        float(depth[i] + down * preset.depth_step_m),
        height + across - float(patch[i, j]),
    )


def _interpolated_peak(values: Float64[np.ndarray, " n"], place: int) -> tuple[float, float]:
    """`parabola_peak` at a place in a row of values; at its ends the value itself."""
    if not 0 < place < len(values) - 1:
        return 0.0, float(values[place])
    return parabola_peak(float(values[place - 1]), float(values[place]), float(values[place + 1]))


BLOCK_M = 2e-3
"""Approximate width and depth of a block in metres."""

_NEIGHBOURS = 3
"""Columns on each side of a peak from which it is interpolated."""

_BETWEEN_COLUMNS = np.array([-0.5, -0.25, 0.25, 0.5])
"""Places between the columns, in pitches from the peak's."""


class BlockGrid:
    """Division of the images of one grid into blocks.

    ``lateral_m``, ``depth_m``: columns and rows of the image.
    """

    def __init__(
        self, preset: ProbePreset, *, lateral_m: Float64[np.ndarray, " lateral"], depth_m: Float64[np.ndarray, " depth"]
    ) -> None:
        pitch_m = preset.array.pitch_m
        step_m = preset.depth_step_m
        self._columns = max(1, round(BLOCK_M / pitch_m))
        self._rows = max(1, round(BLOCK_M / step_m))
        self._shape = (-(-len(depth_m) // self._rows), -(-len(lateral_m) // self._columns))
        self._first_m = (
            float(lateral_m[0] + (self._columns - 1) / 2 * pitch_m),
            float(depth_m[0] + (self._rows - 1) / 2 * step_m),
        )
        self._step_m = (self._columns * pitch_m, self._rows * step_m)
        self._weights = _interpolation_weights(preset)
        share = self._rows * self._columns / (len(depth_m) * len(lateral_m))
        self._noise_peaks = share * noise_peaks(preset, depth_m=depth_m)

    def maxima(
        self,
        image: Float32[np.ndarray, "depth lateral"],
        envelope: Float32[np.ndarray, "depth lateral"],
        *,
        rows: slice,
    ) -> LocalMaxima:
        """Return the largest envelope of each block.

        ``image``, ``envelope``: beamformed signals and their envelope, with the rows above and below that the envelope
        needs.
        """
        out = np.empty(self._shape, np.float32)
        place = rows.start, rows.stop, self._rows, self._columns
        block_maxima(image, envelope, *place, quadrature_taps(), self._weights, out)
        return LocalMaxima(
            first_lateral_m=self._first_m[0],
            first_depth_m=self._first_m[1],
            lateral_step_m=self._step_m[0],
            depth_step_m=self._step_m[1],
            columns=self._shape[1],
            noise_peaks=self._noise_peaks,
            intensities=out.astype("<f4").tobytes(),
        )


def _interpolation_weights(preset: ProbePreset) -> Float32[np.ndarray, "shifts columns"]:
    """Return the weights of the columns about a peak for places a quarter and a half of a pitch to either side of it.

    They are those of least mean square error (Wiener) for the image's autocorrelation r along the array, which is also
    the shape of a point's image: w = R⁻¹r. Midway they give a point 86 % or more of its height with the presets, and
    noise no more than it has in the pixels.
    """
    sine = math.sin(math.atan(0.5 / preset.f_number)) if preset.f_number else 1.0
    frequency_hz = np.linspace(preset.low_hz, preset.high_hz, 65)
    # Waves from the aperture's edges differ by 2·sine along the array: the mean of their cosines is a sinc.
    per_pitch = 2 * sine * frequency_hz / preset.sound_speed_m_s * preset.array.pitch_m

    def correlation(pitches: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        return np.asarray(np.sinc(np.multiply.outer(pitches, per_pitch)).mean(axis=-1))

    away = np.arange(-_NEIGHBOURS, _NEIGHBOURS + 1.0)
    shape = correlation(away - _BETWEEN_COLUMNS[:, None])
    return np.linalg.solve(correlation(away[:, None] - away), shape.T).T.astype(np.float32)
