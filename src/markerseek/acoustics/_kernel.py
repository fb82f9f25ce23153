"""Compiled sum of delayed pulses over the face of every element."""

from __future__ import annotations

import math

import numpy as np

from markerseek._compiled import compiled
from markerseek.core import Float32, Float64

MIXED_BELOW_NP = 0.02
"""Change of the attenuation from the middle of a face to its edge, up to which one table serves a whole element."""

MIXED_FROM_NODES = 40
"""Nodes from which on mixing that table costs less than it saves."""


@compiled
def nodes_needed(phase: float, steepness: float) -> int:
    """Return the Gauss–Legendre nodes for a phase that changes by this number of radians per half extent.

    An n-point rule integrates exp(i k x) over [−1, 1] once 2n exceeds k by a margin that grows as k^(1/3) (the decay
    of Bessel functions of order 2n above their argument k). ``steepness`` is half the extent over the distance, which
    measures how near the singularity of 1/r is.
    """
    return int(0.5 * phase + 1.0 * phase ** (1 / 3) + 1.5 + 3.0 * steepness)


@compiled
def _add_element(
    row: Float32[np.ndarray, " samples"],
    lines: Float32[np.ndarray, "ranges phases length"],
    across: Float64[np.ndarray, " width"],
    across_weight: Float64[np.ndarray, " width"],
    along: Float64[np.ndarray, " height"],
    along_weight: Float64[np.ndarray, " height"],
    lens: Float64[np.ndarray, " height"],
    axial: float,
    strength: float,
    loss: float,
    middle: float,
    step_m: float,
    samples_per_metre: float,
    offset: float,
) -> None:
    """Add the response of one element to one absorber, whose offsets from the nodes are ``across`` and ``along``.

    With one table, it is that of the path ``middle``, from which others differ by ``loss`` (Np/m) times the difference.
    """
    ranges, phases, length = lines.shape
    flat = lines.ravel()
    steps_per_metre = 1.0 / step_m
    # indices without sign: Numba then leaves out its test for negative ones, and the sums run in vector registers
    next_phase = np.uint64(length)
    next_range = np.uint64(phases * length)
    for u in range(across.size):
        squared = across[u] * across[u] + axial * axial
        for v in range(along.size):
            path = math.sqrt(squared + along[v] * along[v])
            amplitude = strength * across_weight[u] * along_weight[v] / path
            # Between two phases the pulse is interpolated: PHASES lines per sample keep that to 3e-4 (`pulse`).
            arrival = (path - lens[v]) * samples_per_metre + offset
            sample = math.floor(arrival)
            fraction = (arrival - sample) * (phases - 1)
            phase = int(fraction)
            late = fraction - phase
            start = int(sample)
            low = max(0, -start)
            high = min(length, row.size - start)
            if high <= low:
                continue
            count = np.uint64(high - low)
            to = np.uint64(start + low)
            if ranges == 1:
                # exp(−loss·d) to first order: the paths of one face differ by little (`MIXED_BELOW_NP`).
                amplitude *= 1.0 - loss * (path - middle)
                a = np.float32(amplitude * (1.0 - late))
                b = np.float32(amplitude * late)
                early = np.uint64(phase * length + low)
                for j in range(count):
                    row[to + j] += a * flat[early + j] + b * flat[early + next_phase + j]
            else:
                steps = path * steps_per_metre
                k = min(int(steps), ranges - 2)
                far = steps - k
                a = np.float32(amplitude * (1.0 - late) * (1.0 - far))
                b = np.float32(amplitude * late * (1.0 - far))
                c = np.float32(amplitude * (1.0 - late) * far)
                d = np.float32(amplitude * late * far)
                early = np.uint64((k * phases + phase) * length + low)
                lossy = early + next_range
                for j in range(count):
                    row[to + j] += (
                        a * flat[early + j]
                        + b * flat[early + next_phase + j]
                        + c * flat[lossy + j]
                        + d * flat[lossy + next_phase + j]
                    )


@compiled
def _mix_tables(
    mixed: Float32[np.ndarray, "1 phases length"], lines: Float32[np.ndarray, "ranges phases length"], steps: float
) -> None:
    """Write the table of a path, given in steps of path length, interpolated between its neighbours."""
    k = min(int(steps), lines.shape[0] - 2)
    near = np.float32(1.0 - (steps - k))
    far = np.float32(steps - k)
    for p in range(lines.shape[1]):
        for j in range(lines.shape[2]):
            mixed[0, p, j] = near * lines[k, p, j] + far * lines[k + 1, p, j]


@compiled
def add_absorbers(
    data: Float32[np.ndarray, "elements samples"],
    positions: Float64[np.ndarray, "absorbers 3"],
    strengths: Float64[np.ndarray, " absorbers"],
    element_m: Float64[np.ndarray, " elements"],
    half_width: float,
    half_height: float,
    focus: float,
    nodes: Float64[np.ndarray, "rules points"],
    weights: Float64[np.ndarray, "rules points"],
    lines: Float32[np.ndarray, "ranges phases length"],
    loss: float,
    step_m: float,
    wavenumber: float,
    samples_per_metre: float,
    offset: float,
) -> None:
    """Add the response of every channel to every absorber.

    The response is the mean over the element's face of strength · g(t − (path − lens)/c) / path, by a product of
    Gauss–Legendre rules (``nodes[n]``, ``weights[n]``: n points on [−1, 1], weights summing to 1) whose numbers of
    points follow the steepest change of phase over the face. Positions are lateral, elevation, axial; ``focus`` is
    0 without a lens; ``first`` is part of ``offset``. Where the attenuation (``loss``, Np/m) changes by little over
    the face, the element has one table for all of its nodes: half the reading of memory.
    """
    most = nodes.shape[0] - 1
    # As many nodes as the phase needs and no more: near the plane the sound arrives almost at once over the face, and a
    # few nodes are exact; off the plane several dozens are needed.
    mixed = np.empty((1, lines.shape[1], lines.shape[2]), dtype=np.float32)
    for n in range(data.shape[0]):
        row = data[n]
        for s in range(strengths.size):
            lateral = positions[s, 0] - element_m[n]
            off = positions[s, 1]
            axial = positions[s, 2]
            # steepest change of the path over the face, along and across, at its nearest and farthest edges
            steep = 0.0
            for side in (-half_height, half_height):
                slope = (side - off) / math.sqrt((off - side) ** 2 + lateral**2 + axial**2)
                if focus > 0.0:
                    slope -= side / math.sqrt(focus**2 + side**2)
                steep = max(steep, abs(slope))
            tall = min(nodes_needed(wavenumber * half_height * steep, half_height / axial), most)
            reach = abs(lateral) + half_width
            sideways = reach / math.sqrt(reach**2 + off**2 + axial**2)
            wide = min(nodes_needed(wavenumber * half_width * sideways, half_width / axial), most)
            points = half_height * nodes[tall, :tall]
            lens = np.zeros(tall)
            if focus > 0.0:
                lens = np.sqrt(focus**2 + points**2) - focus
            middle = math.sqrt(lateral**2 + off**2 + axial**2)
            table = lines
            change = loss * (abs(off) * half_height + reach * half_width) / middle
            if lines.shape[0] > 1 and change < MIXED_BELOW_NP and tall * wide > MIXED_FROM_NODES:
                _mix_tables(mixed, lines, middle / step_m)
                table = mixed
            _add_element(
                row,
                table,
                lateral - half_width * nodes[wide, :wide],
                weights[wide, :wide],
                off - points,
                weights[tall, :tall],
                lens,
                axial,
                strengths[s],
                loss,
                middle,
                step_m,
                samples_per_metre,
                offset,
            )
