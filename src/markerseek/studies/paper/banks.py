"""Banks for the offline analysis (section 2.5): simulated at nine positions of five materials, or a user's own.

A bank is a fine scan of the whole range. Simulated ones are made from channel data and written as CSV files, which
`markerseek replay` also reads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from markerseek import rigs
from markerseek.records.banks import FrameBank, IntensityBank, read_bank, write_bank
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.printed import MATERIALS

TISSUES = dict(zip(MATERIALS, ("liver", "muscle", "chicken-breast", "plastisol-phantom", "muscle-icg"), strict=True))
"""The simulated stand-in for each material of Table 1."""

ONE_BANK = MATERIALS[-1]
"""The material of which the paper recorded a single position."""

STEP_DEG = 0.5
"""Step of the scan (section 2.5)."""

LEVELS_DB = (40.0, 60.0)
"""Peak SNR: the default of the physics notes, and the low-noise end of the range that they give."""

SPACING_M = 20e-3
"""Spacing of the 3 × 3 grid of positions along x and y, in metres (sections 2.5 A to C, Fig. 3 b)."""

HEIGHT_M = 60e-3
"""Distance of the grid's plane from the axis of rotation in metres: 5 cm of gel pad, and the probe's radius."""

ROUGHNESS_M = 2e-3
"""Standard deviation of a spot's place in the plane, in metres: the paper's grid is roughly spaced, without a figure.
On an exact grid there would be three different angles only."""

PEAK_COUNTS = 1500.0
"""Height of the marker's signal in a channel, in counts of a full scale of 2047: high enough that the noise at 60 dB is
larger than the steps of the converter."""


def grid(rng: np.random.Generator) -> list[MarkerSettings]:
    """Positions 1 to 9, row by row along x, each a marker in the frame of the probe."""
    markers = []
    for y in (-1, 0, 1):
        for x in (-1, 0, 1):
            # x is across the axis of rotation and sets the angle; y is along the array.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class OfflineBank:
    """A bank on disk, and where its marker is."""

    path: Path
    """CSV, HDF5 file or folder."""
    material: str
    position: int
    """``material`` and ``position``: what was scanned, and at which of the nine positions, counted from 1."""
    peak_snr_db: float | None
    """Noise of a simulated bank; None for a user's own."""
    reference_deg: float | None
    """Angle that counts as true; None: that of the bank's largest intensity."""
    probe: str | None = None
    """Preset of the imaging chain for a bank of channel data; None: the bank's own, or the first of all."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scan:
    """Banks of one position that are made together, one for each noise."""

    banks: tuple[OfflineBank, ...]
    marker: MarkerSettings
    step_deg: float
    seed: int


def simulated_banks(folder: Path, options: RunOptions) -> list[OfflineBank]:
    """Banks of the five materials at nine positions each (of the last at one), for each noise; written into the folder.

    The same positions and spots are scanned under each noise. With fewer markers than the paper's, fewer positions are
    scanned, in coarser steps.

    ``folder``: where the CSV files go.
    """
    step_deg = STEP_DEG if options.share >= 0.5 else 5 * STEP_DEG
    scans = []
    for number, (material, tissue) in enumerate(TISSUES.items()):
        # Seeded by the material: its positions do not depend on the other materials.
        markers = grid(np.random.Generator(np.random.PCG64([options.seed, number])))
        count = 1 if material == ONE_BANK else max(2, round(len(markers) * options.share))
        for position, marker in enumerate(markers[:count], start=1):
            banks = tuple(
                OfflineBank(
                    path=folder / f"{tissue}-{level_db:g}dB-{position}.csv",
                    material=material,
                    position=position,
                    peak_snr_db=level_db,
                    reference_deg=marker.angle_deg,
                )
                for level_db in LEVELS_DB
            )
            seed = 1000 * options.seed + 10 * number + position
            scans.append(_Scan(banks=banks, marker=marker, step_deg=step_deg, seed=seed))
    options.each(_scan, scans, stage="offline banks, from channel data")
    return [bank for scan in scans for bank in scan.banks]


def _scan(scan: _Scan) -> None:
    settings = SimulatedSettings(
        tissue=TISSUES[scan.banks[0].material],
        marker=scan.marker,
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
    )
    search = settings.limits.search
    # Upwards from the lower end: the stage then needs no second approach from below.
    settings = replace(settings, start_deg=search.low_deg)
    noises = [NoiseSettings(peak_snr_db=bank.peak_snr_db or 0.0) for bank in scan.banks]
    scanners = [rigs.simulated(seed=scan.seed, settings=replace(settings, noise=noise)).scanner for noise in noises]
    asked = np.linspace(search.low_deg, search.high_deg, round(search.width_deg / scan.step_deg) + 1)
    # Angle by angle over all noises: the noise-free channel data of an angle are the same, and computed once.
    by_angle = [[scanner.measure(float(angle_deg)) for scanner in scanners] for angle_deg in asked]
    for bank, samples in zip(scan.banks, zip(*by_angle, strict=True), strict=True):
        intensities = IntensityBank(
            # The ends are kept as requested, so that a search of the whole range finds all of it in the bank.
            angles_deg=(float(asked[0]), *(sample.angle_deg for sample in samples[1:-1]), float(asked[-1])),
            intensities=tuple(sample.reading.intensity for sample in samples),
        )
        write_bank(intensities, bank.path)


def as_intensities(bank: OfflineBank, folder: Path, options: RunOptions) -> OfflineBank:
    """Return the bank itself if it holds intensities; otherwise image each frame once, and write the intensities.

    Intensities are interpolated between two angles, as in section 2.5; channel data cannot be.

    ``folder``: where the CSV of the intensities goes.
    """
    frames = read_bank(bank.path)
    if not isinstance(frames, FrameBank):
        return bank
    # Measured by the scanner, whose guard refuses frames that a search would not get either.
    rig = rigs.replayed(bank.path, probe=bank.probe)
    intensities = []
    for number, angle_deg in enumerate(frames.angles_deg):
        options.progress("frames of the bank", number, len(frames.angles_deg))
        intensities.append(rig.scanner.measure(angle_deg).reading.intensity)
    options.progress("frames of the bank", len(intensities), len(intensities))
    path = folder / f"{bank.path.stem}-intensities.csv"
    write_bank(IntensityBank(angles_deg=frames.angles_deg, intensities=tuple(intensities)), path)
    known_deg = frames.facts.reference_angle_deg if bank.reference_deg is None else bank.reference_deg
    return replace(bank, path=path, reference_deg=known_deg)
