"""Compiled kernel of the local maxima, with the peaks interpolated between the columns."""

from __future__ import annotations

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float32


@compiled
def block_maxima(
    image: Float32[np.ndarray, "depth lateral"],
    envelope: Float32[np.ndarray, "depth lateral"],
    first_row: int,
    end_row: int,
    rows: int,
    columns: int,
    quadrature: Float32[np.ndarray, " taps"],
    shifted: Float32[np.ndarray, "shifts reach"],
    out: Float32[np.ndarray, "blocks_deep blocks_wide"],
) -> None:
    """Write the largest envelope of each block of ``rows`` × ``columns`` pixels into ``out``.

    The blocks begin with ``first_row`` and end before ``end_row``. The largest pixel of a block is interpolated to
    places between the columns, and the larger of pixel and places is written. ``shifted`` has the weights of the
    columns on either side of the pixel, a row for each place. ``quadrature`` is one side of the Hilbert transformer of
    which ``envelope`` is the magnitude (see `magnitude`).
    """
    real, imaginary = np.empty(shifted.shape[1], np.float32), np.empty(shifted.shape[1], np.float32)
    for i in range(out.shape[0]):
        low, high = first_row + i * rows, min(first_row + (i + 1) * rows, end_row)
        for j in range(out.shape[1]):
            z, x, largest = low, j * columns, np.float32(-1)
            for a in range(low, high):
                for b in range(j * columns, min((j + 1) * columns, envelope.shape[1])):
                    if envelope[a, b] > largest:
                        z, x, largest = a, b, envelope[a, b]
            _analytic(image, z, x, quadrature, real, imaginary)
            for s in range(shifted.shape[0]):
                along, across = np.float32(0), np.float32(0)
                for k in range(shifted.shape[1]):
                    along += shifted[s, k] * real[k]
                    across += shifted[s, k] * imaginary[k]
                largest = max(largest, np.sqrt(along * along + across * across))
            out[i, j] = largest


@compiled
def _analytic(
    image: Float32[np.ndarray, "depth lateral"],
    row: int,
    column: int,
    quadrature: Float32[np.ndarray, " taps"],
    real: Float32[np.ndarray, " reach"],
    imaginary: Float32[np.ndarray, " reach"],
) -> None:
    """Write the analytic signal of a row of the image about a column into its two parts; outside, it is 0."""
    depths, columns = image.shape
    real[:], imaginary[:] = np.float32(0), np.float32(0)
    first = column - len(real) // 2
    low, high = max(0, -first), min(len(real), columns - first)
    for k in range(low, high):
        real[k] = image[row, first + k]
    for m in range(len(quadrature)):
        above, below = row - 2 * m - 1, row + 2 * m + 1
        for k in range(low, high):
            if above >= 0:
                imaginary[k] += quadrature[m] * image[above, first + k]
            if below < depths:
                imaginary[k] -= quadrature[m] * image[below, first + k]
