"""Compiled kernels of the imaging chain, one thread each; samples first, channels contiguous.

With channels contiguous, the pixels of one depth that share a delay lie side by side, so that beamforming needs no
gather: row ``t`` of the signals, shifted by some channels, is added to a row of the image.
"""

from __future__ import annotations

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float32, Float64, Int32, Int64

PAD = 32
"""Zero columns on each side of the signals, so that every inner loop has a multiple of 32 steps."""

_TILE = 16
"""Depths that are summed together, so that the signals they share stay in the nearest cache."""


@compiled
def fir(
    padded: Float32[np.ndarray, "rows columns"],
    taps: Float32[np.ndarray, " taps"],
    out: Float32[np.ndarray, "samples wide"],
    first: int,
) -> None:
    """Write the symmetric filter of the rows of ``padded`` into columns from ``first`` on of ``out``.

    ``taps[0]`` is the middle tap; ``padded`` holds len(taps) - 1 rows more than ``out`` on either side. The number of
    taps on one side is a multiple of four.
    """
    # A symmetric filter: both samples of a pair are added before the product, which halves the products. Four taps at
    # once, so that each result is loaded and stored once for four; channels side by side, so that the
    # compiler uses vector instructions.
    rows = out.shape[0]
    columns = padded.shape[1]
    half = len(taps) - 1
    for t in range(rows):
        result = out[t, first : first + columns]
        middle = padded[t + half]
        for c in range(columns):
            result[c] = taps[0] * middle[c]
        for k in range(1, half + 1, 4):
            h0 = taps[k]
            h1 = taps[k + 1]
            h2 = taps[k + 2]
            h3 = taps[k + 3]
            a0 = padded[t + half - k]
            b0 = padded[t + half + k]
            a1 = padded[t + half - k - 1]
            b1 = padded[t + half + k + 1]
            a2 = padded[t + half - k - 2]
            b2 = padded[t + half + k + 2]
            a3 = padded[t + half - k - 3]
            b3 = padded[t + half + k + 3]
            for c in range(columns):
                result[c] += (h0 * (a0[c] + b0[c]) + h1 * (a1[c] + b1[c])) + (
                    h2 * (a2[c] + b2[c]) + h3 * (a3[c] + b3[c])
                )


@compiled
def magnitude(
    padded: Float32[np.ndarray, "rows columns"],
    taps: Float32[np.ndarray, " taps"],
    out: Float32[np.ndarray, "depth columns"],
) -> None:
    """Write the magnitude of the rows of ``padded`` and of their antisymmetric filter into ``out``.

    Tap k has the odd offset 2 k + 1; ``padded`` holds 2 len(taps) rows more than ``out`` on either side, and the
    number of taps is a multiple of four.
    """
    # Antisymmetric, and every second tap of a Hilbert transformer is 0: a quarter of the products of a plain filter.
    rows, columns = out.shape
    half = 2 * len(taps)
    for t in range(rows):
        result = out[t]
        result[:] = np.float32(0)
        for k in range(0, len(taps), 4):
            h0 = taps[k]
            h1 = taps[k + 1]
            h2 = taps[k + 2]
            h3 = taps[k + 3]
            low = t + half - 2 * k - 1
            high = t + half + 2 * k + 1
            a0 = padded[low]
            b0 = padded[high]
            a1 = padded[low - 2]
            b1 = padded[high + 2]
            a2 = padded[low - 4]
            b2 = padded[high + 4]
            a3 = padded[low - 6]
            b3 = padded[high + 6]
            for c in range(columns):
                result[c] += (h0 * (a0[c] - b0[c]) + h1 * (a1[c] - b1[c])) + (
                    h2 * (a2[c] - b2[c]) + h3 * (a3[c] - b3[c])
                )
        middle = padded[t + half]
        for c in range(columns):
            result[c] = np.sqrt(middle[c] * middle[c] + result[c] * result[c])


@compiled
def _samples(first: int, weight: np.float32, instead: int) -> tuple[int, np.float32, np.float32]:
    """Return the sample before the delay and its weight and that of the next.

    Both weights of an unused element are 0.
    """
    if first < 0:
        return instead, np.float32(0), np.float32(0)
    return first, np.float32(1) - weight, weight


@compiled
def _add_four(
    image: Float32[np.ndarray, " pixels"],
    signals: Float32[np.ndarray, " values"],
    to: int,
    count: int,
    next_sample: int,
    starts: tuple[int, int, int, int],
    early: tuple[np.float32, np.float32, np.float32, np.float32],
    late: tuple[np.float32, np.float32, np.float32, np.float32],
) -> None:
    """Add ``count`` neighbouring values of four rows of signals, and of the rows after them, to a row of the image."""
    # indices without sign: Numba then leaves out its test for negative ones, which costs as much as the sum
    p = np.uint64(to)
    step = np.uint64(next_sample)
    a = np.uint64(starts[0])
    b = np.uint64(starts[1])
    c = np.uint64(starts[2])
    d = np.uint64(starts[3])
    u0, u1, u2, u3 = early
    w0, w1, w2, w3 = late
    for j in range(np.uint64(count)):
        image[p + j] += (
            (u0 * signals[a + j] + w0 * signals[a + step + j]) + (u1 * signals[b + j] + w1 * signals[b + step + j])
        ) + ((u2 * signals[c + j] + w2 * signals[c + step + j]) + (u3 * signals[d + j] + w3 * signals[d + step + j]))


@compiled
def delay_and_sum(
    signals: Float32[np.ndarray, "samples wide"],
    first: Int32[np.ndarray, "distances depths"],
    weight: Float32[np.ndarray, "distances depths"],
    scale: Float32[np.ndarray, "depths columns"],
    out: Float32[np.ndarray, "depths columns"],
) -> None:
    """Write the sum of the delayed signals of every column, times ``scale``, into ``out``, shape (depths, columns).

    Row m of the tables belongs to the elements m columns to the right and to the left. ``first`` is the sample before
    the delay, or -1 where the element is not used; ``weight`` is the share of the sample after it. ``out`` has
    a multiple of 32 columns, ``signals`` `PAD` zero columns more on either side, the tables a multiple of four rows;
    all are contiguous.
    """
    # Columns at the elements share one table of delays, because a delay depends on the depth and the lateral
    # distance alone. So the sum runs over distances, and adds whole rows of the signals to whole rows of the image.
    depths, columns = out.shape
    wide = signals.shape[1]
    image = out.ravel()
    values = signals.ravel()
    for start in range(0, depths, _TILE):
        stop = min(depths, start + _TILE)
        out[start:stop] = np.float32(0)
        for m in range(0, first.shape[0], 4):
            # Only columns that have an element m to the right, filled up to whole vectors by zero columns.
            span = (columns - m + 31) // 32 * 32
            from_right = PAD + m
            from_left = PAD - m + columns - span
            for z in range(start, stop):
                t0 = first[m, z]
                if t0 < 0:
                    continue
                t0, u0, w0 = _samples(first[m, z], weight[m, z], t0)
                t1, u1, w1 = _samples(first[m + 1, z], weight[m + 1, z], t0)
                t2, u2, w2 = _samples(first[m + 2, z], weight[m + 2, z], t0)
                t3, u3, w3 = _samples(first[m + 3, z], weight[m + 3, z], t0)
                r0 = t0 * wide
                r1 = t1 * wide
                r2 = t2 * wide
                r3 = t3 * wide
                s = from_right
                starts = (r0 + s, r1 + s + 1, r2 + s + 2, r3 + s + 3)
                _add_four(image, values, z * columns, span, wide, starts, (u0, u1, u2, u3), (w0, w1, w2, w3))
                if m == 0:
                    # The element straight above a column is in the sum once only.
                    u0 = np.float32(0)
                    w0 = np.float32(0)
                s = from_left
                starts = (r0 + s, r1 + s - 1, r2 + s - 2, r3 + s - 3)
                to = (z + 1) * columns - span
                _add_four(image, values, to, span, wide, starts, (u0, u1, u2, u3), (w0, w1, w2, w3))
        for z in range(start, stop):
            for c in range(columns):
                out[z, c] *= scale[z, c]


@compiled
def coherent_energies(
    signals: Float32[np.ndarray, "samples wide"],
    element_m: Float64[np.ndarray, " elements"],
    lateral_m: Float64[np.ndarray, " points"],
    depth_m: Float64[np.ndarray, "points depths"],
    delay: tuple[float, float],
    half_aperture: Float64[np.ndarray, "points depths"],
    energy: Float64[np.ndarray, " points"],
    used: Int64[np.ndarray, " points"],
) -> None:
    """Write the energy of the sums of delayed signals over that of the signals into ``energy``, one for each point.

    ``delay`` is (samples per metre of path, sample number of the laser's pulse). Elements outside of the aperture or of
    the record are left out; ``used`` is the largest number of those used at one depth. Without any signal it is 0.
    """
    per_metre, origin = delay
    last = signals.shape[0] - 1
    pitch = element_m[1] - element_m[0]
    for p in range(len(lateral_m)):
        coherent = 0.0
        single = 0.0
        most = 0
        for z in range(depth_m.shape[1]):
            total = 0.0
            count = 0
            low = max(0, int(np.ceil(max(-1e9, (lateral_m[p] - half_aperture[p, z] - element_m[0]) / pitch))))
            high = int(np.floor(min(1e9, (lateral_m[p] + half_aperture[p, z] - element_m[0]) / pitch)))
            for e in range(low, min(high + 1, len(element_m))):
                offset = element_m[e] - lateral_m[p]
                place = np.sqrt(depth_m[p, z] * depth_m[p, z] + offset * offset) * per_metre + origin
                t = int(place)
                if place >= 0 and t < last:
                    w = np.float32(place - t)
                    value = (np.float32(1) - w) * signals[t, PAD + e] + w * signals[t + 1, PAD + e]
                    total += value
                    single += value * value
                    count += 1
            coherent += total * total
            most = max(most, count)
        energy[p] = coherent / single if single > 0 else 0.0
        used[p] = most


@compiled
def aligned_energies(
    signals: Float32[np.ndarray, "samples wide"],
    element_m: Float64[np.ndarray, " elements"],
    place_m: Float64[np.ndarray, " points"],
    per_metre: Float64[np.ndarray, " points"],
    arrival: tuple[float, float],
    half_samples: int,
    half_aperture: float,
    of_sum: Float64[np.ndarray, " points"],
    of_channels: Float64[np.ndarray, " points"],
    used: Int64[np.ndarray, " points"],
) -> None:
    """Write the energy of the sum of the channels over their number, that of the channels, and their number.

    Each is of one wave: p comes from the place ``place_m[p]`` along the array, with ``per_metre[p]`` samples per metre
    of path, and arrives there at the sample ``arrival[0]``, counted from the laser's pulse at the sample
    ``arrival[1]``. Every second of the ``half_samples`` samples to either side counts, an even number; elements outside
    of the aperture or of the record are left out.
    """
    since, origin = arrival
    total = np.empty(half_samples + 1)
    for p in range(len(place_m)):
        total[:] = 0.0
        single = 0.0
        count = 0
        depth = since / per_metre[p]
        for e in range(len(element_m)):
            offset = element_m[e] - place_m[p]
            # The whole pulse of a point comes with the delays of its depth, however long it is.
            start = np.sqrt(depth * depth + offset * offset) * per_metre[p] + origin - half_samples
            t = int(start)
            if abs(offset) > half_aperture or start < 0 or t + 2 * half_samples + 1 >= signals.shape[0]:
                continue
            w = np.float32(start - t)
            for k in range(half_samples + 1):
                value = (np.float32(1) - w) * signals[t + 2 * k, PAD + e] + w * signals[t + 2 * k + 1, PAD + e]
                total[k] += value
                single += value * value
            count += 1
        energy = 0.0
        for k in range(half_samples + 1):
            energy += total[k] * total[k]
        of_sum[p] = energy / max(1, count)
        of_channels[p] = single
        used[p] = count


@compiled
def beams(
    signals: Float32[np.ndarray, "samples wide"],
    element_m: Float64[np.ndarray, " elements"],
    lateral_m: Float64[np.ndarray, " lateral"],
    depth_m: Float64[np.ndarray, " depths"],
    delay: tuple[float, float],
    half_aperture: Float64[np.ndarray, " depths"],
    out: Float32[np.ndarray, "depths lateral"],
) -> None:
    """Write the delayed sums over the root of the number of elements into ``out``, for pixels anywhere.

    ``delay`` is (samples per metre of path, sample number of the laser's pulse). Elements outside of the aperture or of
    the record are left out.
    """
    per_metre, origin = delay
    last = signals.shape[0] - 1
    pitch = element_m[1] - element_m[0]
    for z in range(len(depth_m)):
        for x in range(len(lateral_m)):
            total = np.float32(0)
            used = 0
            low = max(0, int(np.ceil(max(-1e9, (lateral_m[x] - half_aperture[z] - element_m[0]) / pitch))))
            high = int(np.floor(min(1e9, (lateral_m[x] + half_aperture[z] - element_m[0]) / pitch)))
            for e in range(low, min(high + 1, len(element_m))):
                offset = element_m[e] - lateral_m[x]
                place = np.sqrt(depth_m[z] * depth_m[z] + offset * offset) * per_metre + origin
                # int() rounds towards 0: for positive numbers that is the floor, and faster.
                t = int(place)
                if place >= 0 and t < last:
                    w = np.float32(place - t)
                    total += (np.float32(1) - w) * signals[t, PAD + e] + w * signals[t + 1, PAD + e]
                    used += 1
            out[z, x] = total / np.sqrt(np.float32(max(used, 1)))


@compiled
def local_maxima(envelope: Float32[np.ndarray, "depth lateral"], level: np.float32) -> Int64[np.ndarray, "found 2"]:
    """Return the rows and columns of the pixels above ``level`` that no neighbour exceeds; none on the edge."""
    rows, columns = envelope.shape
    found = []
    for z in range(1, rows - 1):
        for x in range(1, columns - 1):
            here = envelope[z, x]
            if here <= level or here < envelope[z, x - 1] or here <= envelope[z, x + 1]:
                continue
            if here < envelope[z - 1, x] or here <= envelope[z + 1, x]:
                continue
            found.append((z, x))
    places = np.empty((len(found), 2), np.int64)
    for k in range(len(found)):
        places[k, 0], places[k, 1] = found[k]
    return places


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
    real = np.empty(shifted.shape[1], np.float32)
    imaginary = np.empty(shifted.shape[1], np.float32)
    for i in range(out.shape[0]):
        low = first_row + i * rows
        high = min(first_row + (i + 1) * rows, end_row)
        for j in range(out.shape[1]):
            z = low
            x = j * columns
            largest = np.float32(-1)
            for a in range(low, high):
                for b in range(j * columns, min((j + 1) * columns, envelope.shape[1])):
                    if envelope[a, b] > largest:
                        z = a
                        x = b
                        largest = envelope[a, b]
            _analytic(image, z, x, quadrature, real, imaginary)
            for s in range(shifted.shape[0]):
                along = np.float32(0)
                across = np.float32(0)
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
    real[:] = np.float32(0)
    imaginary[:] = np.float32(0)
    first = column - len(real) // 2
    low = max(0, -first)
    high = min(len(real), columns - first)
    for k in range(low, high):
        real[k] = image[row, first + k]
    for m in range(len(quadrature)):
        above = row - 2 * m - 1
        below = row + 2 * m + 1
        for k in range(low, high):
            if above >= 0:
                imaginary[k] += quadrature[m] * image[above, first + k]
            if below < depths:
                imaginary[k] -= quadrature[m] * image[below, first + k]
