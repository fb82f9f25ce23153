"""Data for the tests of exports: three images with angles, times and facts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from markerseek.core import PaImage
from markerseek.records.banks import BankFacts, Series

ANGLES = (-30.0, 0.25, 12.5)
TIMES = (35.25, 46.5, 1000.0)
LATERAL = np.linspace(-4e-3, 4e-3, 9)
DEPTH = np.linspace(5e-3, 8e-3, 13)
FACTS = BankFacts(
    description="a phantom", probe="BPL9-5/55", face_radius_m=10e-3, reference_angle_deg=1.5, simulated=True
)
SERIES = Series(angles_deg=ANGLES, times_s=TIMES, clock="rig", order=(0, 1, 2), facts=FACTS)
UNPLACED = replace(SERIES, facts=BankFacts())


def images():
    rng = np.random.default_rng(5)
    return [PaImage(envelope=rng.random((13, 9)).astype(np.float32), lateral_m=LATERAL, depth_m=DEPTH) for _ in ANGLES]


def place_mm(number, column, row):
    """The position of a pixel by conventions.md: (ρ sin θ, y, ρ cos θ)."""
    radius_mm = 10.0 + 1e3 * DEPTH[row]
    angle = math.radians(ANGLES[number])
    return radius_mm * math.sin(angle), 1e3 * LATERAL[column], radius_mm * math.cos(angle)
