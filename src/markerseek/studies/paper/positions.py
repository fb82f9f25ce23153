"""The nine places of the laser spot: a 3 × 3 grid of about 20 mm (sections 2.5 A to C, Fig. 3 b)."""

from __future__ import annotations

import math

import numpy as np

from markerseek.sim import MarkerSettings

SPACING_M = 20e-3
"""Spacing of the grid along x and y, in metres."""

HEIGHT_M = 60e-3
"""Distance of the grid's plane from the axis of rotation in metres: 5 cm of gel pad, and the probe's radius."""

PEAK_COUNTS = 1500.0
"""Height of the marker's signal in a channel, in counts of a full scale of 2047: high enough that the noise of a quiet
rig (60 dB) is still more than the steps of the converter."""

ROUGHNESS_M = 2e-3
"""Standard deviation of a spot's place in the plane: the paper's grid is roughly spaced, and by how much it does not
say. On an exact grid there would be three different angles only."""


def grid(rng: np.random.Generator) -> list[MarkerSettings]:
    """Positions 1 to 9, row by row along x, each a marker in the frame of the probe.

    Parameters
    ----------
    rng
        Source of the roughness.
    """
    markers = []
    for y in (-1, 0, 1):
        for x in (-1, 0, 1):
            off_x_m, off_y_m = rng.normal(0.0, ROUGHNESS_M, 2)
            x_m, y_m = x * SPACING_M + off_x_m, y * SPACING_M + off_y_m
            markers.append(
                MarkerSettings(
                    angle_deg=math.degrees(math.atan2(x_m, HEIGHT_M)),
                    radius_m=math.hypot(x_m, HEIGHT_M),
                    lateral_m=float(y_m),
                )
            )
    return markers
