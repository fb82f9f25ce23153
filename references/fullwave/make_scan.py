# ruff: noqa: INP001 -- programs in a folder, no package
"""A scan of one element over one absorber by k-Wave, as a table that ``markerseek replay`` reads.

    python references/fullwave/make_scan.py examples/full_wave_scan.csv

Runs in the environment of ``make.py``. No code of markerseek takes part: k-Wave propagates the sound in the plane of
elevation and depth, SciPy filters and takes the envelope, and the noise is 1 % of the highest peak, from a fixed seed.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from kwave_offline import VERSION
from make import PLANE, simulate
from scipy.signal import butter, hilbert, sosfilt

MARKER_DEG = 6.4
ANGLES_DEG = np.arange(-20.0, 30.5, 1.0)
BAND_HZ = (5e6, 9e6)
NOISE = 0.01
SEED = 1


def main() -> None:
    """Simulate, and write the table."""
    offsets_deg = tuple(float(angle) for angle in ANGLES_DEG - MARKER_DEG)
    case = replace(
        PLANE, angles_deg=offsets_deg, radius_m=25e-3, across_points=400, step_m=50e-6, sample_s=12.5e-9, pml=20
    )
    heard, grid = simulate(case)
    band = butter(3, BAND_HZ, btype="bandpass", fs=1 / case.sample_s, output="sos")
    traces = sosfilt(band, heard["with_lens"].astype(float), axis=1)
    # The noise passes the same band; its standard deviation afterwards is the one that is stated.
    noise = sosfilt(band, np.random.Generator(np.random.PCG64(SEED)).standard_normal(traces.shape), axis=1)
    noise *= NOISE * np.abs(hilbert(traces, axis=1)).max() / noise.std()
    peaks = np.abs(hilbert(traces + noise, axis=1)).max(axis=1)
    element = f"{1e3 * case.height_m:g} mm high with a lens of {1e3 * case.focus_m:g} mm"
    where = f"{1e3 * case.face_radius_m:g} mm from the axis, one absorber at {1e3 * case.radius_m:g} mm"
    band_mhz = " to ".join(f"{edge / 1e6:g}" for edge in BAND_HZ)
    rows = zip(ANGLES_DEG, 1000 * peaks / peaks.max(), strict=True)
    lines = [
        f"# Simulated by k-Wave (k-wave-python {VERSION}, lossless, in the plane of elevation and depth): one element",
        f"# {element}, {where} and {MARKER_DEG} degrees.",
        f"# Band {band_mhz} MHz, noise {NOISE:.0%} of the highest peak (seed {SEED}).",
        "# Made by references/fullwave/make_scan.py.",
        "angle_deg,intensity",
        *(f"{angle:.1f},{peak:.2f}" for angle, peak in rows),
    ]
    Path(sys.argv[1]).write_text("\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write(f"{sys.argv[1]}: {grid}\n")


if __name__ == "__main__":
    main()
