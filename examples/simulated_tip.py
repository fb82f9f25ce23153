"""Write simulated B-mode images of a tool tip, a degree apart, as PNG: a folder for ``markerseek tooltip``.

Usage: python examples/simulated_tip.py FOLDER [TIP_DEG]
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from markerseek.acoustics import Probe
from markerseek.sim import BModeSettings, BModeWorld

folder = Path(sys.argv[1])
tip_deg = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
folder.mkdir(parents=True)
world = BModeWorld(
    settings=BModeSettings(),
    probe=Probe(),
    tip_deg=tip_deg,
    tip_radius_m=60e-3,
    tip_lateral_m=2e-3,
    present=True,
    start_deg=tip_deg,
    rng=np.random.default_rng(1),
)
for number in range(11):
    # Away from the tip, as in the paper: its middle lies in the plane of the first image.
    world.angle_deg = tip_deg + number
    cv2.imwrite(str(folder / f"simulated-{number:02d}.png"), world.pixels())
print(f"{folder}: 11 simulated images; the tip is at {tip_deg:g}°, and a pixel is 0.15 mm")
