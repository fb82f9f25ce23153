"""Banks for the offline analysis (section 2.5): simulated ones, made from channel data, and a user's own.

A bank is a fine scan of the whole range, kept as a CSV that `markerseek replay` reads as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from markerseek import rigs
from markerseek.records.banks import FrameBank, IntensityBank, read_bank
from markerseek.records.banks.table import write_bank
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.positions import PEAK_COUNTS, grid
from markerseek.studies.paper.reported import MATERIALS

TISSUES = dict(zip(MATERIALS, ("liver", "muscle", "chicken-breast", "plastisol-phantom", "muscle-icg"), strict=True))
"""The simulated stand-in for each material of Table 1."""

ONE_BANK = MATERIALS[-1]
"""The material of which the paper recorded a single position."""

STEP_DEG = 0.5
"""Step of the scan (section 2.5)."""

LEVELS_DB = (40.0, 60.0)
"""Peak SNR of the banks: the default of the physics notes, and the quiet end of what they sweep."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """A bank on disk, and where its marker is.

    Attributes
    ----------
    path
        CSV or folder.
    material, position
        Of what, and which of the nine places, counted from 1.
    peak_snr_db
        Noise under which it was recorded; None for a user's own.
    reference_deg
        Angle that counts as true, in degrees; None: the recording's own maximum.
    probe
        Preset of the imaging chain for a bank of channel data; None: the bank's own, or the first of all.
    """

    path: Path
    material: str
    position: int
    peak_snr_db: float | None
    reference_deg: float | None
    probe: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scan:
    """Banks of one place to be made, one for each noise."""

    recordings: tuple[Recording, ...]
    marker: MarkerSettings
    step_deg: float
    seed: int


def simulated_banks(folder: Path, effort: Effort, *, levels_db: Sequence[float] = LEVELS_DB) -> list[Recording]:
    """Banks of the five materials at nine places each (of the last at one), for each noise; written into the folder.

    The same places and the same spots are scanned under each noise. An effort of fewer markers than the paper's scans
    fewer places, in coarser steps.

    Parameters
    ----------
    folder
        Where the CSV files go.
    effort
        What may be used.
    levels_db
        Peak SNR of the banks, in dB.

    Raises
    ------
    RecordError
        If a file cannot be written.
    """
    step_deg = STEP_DEG if effort.share >= 0.5 else 5 * STEP_DEG
    scans = []
    for number, (material, tissue) in enumerate(TISSUES.items()):
        seeds = np.random.SeedSequence([effort.seed, number])
        places = grid(np.random.Generator(np.random.PCG64(seeds)))
        count = 1 if material == ONE_BANK else max(2, round(len(places) * effort.share))
        for position, marker in enumerate(places[:count], start=1):
            recordings = tuple(
                Recording(
                    path=folder / f"{tissue}-{level_db:g}dB-{position}.csv",
                    material=material,
                    position=position,
                    peak_snr_db=level_db,
                    reference_deg=marker.angle_deg,
                )
                for level_db in levels_db
            )
            seed = 1000 * effort.seed + 10 * number + position
            scans.append(_Scan(recordings=recordings, marker=marker, step_deg=step_deg, seed=seed))
    effort.each(_scan, scans, what="offline banks, from channel data")
    return [recording for scan in scans for recording in scan.recordings]


def _scan(scan: _Scan) -> None:
    settings = SimulatedSettings(
        tissue=TISSUES[scan.recordings[0].material],
        marker=scan.marker,
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
    )
    search = settings.limits.search
    settings = replace(settings, start_deg=search.low_deg)
    noises = [NoiseSettings(peak_snr_db=recording.peak_snr_db or 0.0) for recording in scan.recordings]
    scanners = [rigs.simulated(seed=scan.seed, settings=replace(settings, noise=noise)).scanner for noise in noises]
    asked = np.linspace(search.low_deg, search.high_deg, round(search.width_deg / scan.step_deg) + 1)
    # In turn at each angle, where all of them hear the same but for the noise: that is computed once.
    heard = [[scanner.measure(float(angle_deg)) for scanner in scanners] for angle_deg in asked]
    for recording, samples in zip(scan.recordings, zip(*heard, strict=True), strict=True):
        bank = IntensityBank(
            # The ends are kept as asked, so that a search over the whole range finds all of it recorded.
            angles_deg=(float(asked[0]), *(sample.angle_deg for sample in samples[1:-1]), float(asked[-1])),
            intensities=tuple(sample.reading.intensity for sample in samples),
        )
        write_bank(bank, recording.path)


def as_intensities(recording: Recording, folder: Path, effort: Effort) -> Recording:
    """A bank of one intensity for each angle: itself, or that of its channel data, each frame imaged once.

    Channel data is not interpolated between two angles, intensities are, as in section 2.5.

    Parameters
    ----------
    recording
        Any bank.
    folder
        Where the CSV of the intensities goes.
    effort
        What may be used.

    Raises
    ------
    RecordError
        If the bank cannot be read, or the CSV not be written.
    ConfigError
        If the preset is unknown.
    """
    bank = read_bank(recording.path)
    if not isinstance(bank, FrameBank):
        return recording
    rig = rigs.replayed(recording.path, probe=recording.probe)
    heard = []
    for number, angle_deg in enumerate(bank.angles_deg):
        effort.advance("frames of the bank", number, len(bank.angles_deg))
        heard.append(rig.scanner.measure(angle_deg).reading.intensity)
    effort.advance("frames of the bank", len(heard), len(heard))
    path = folder / f"{recording.path.stem}-intensities.csv"
    write_bank(IntensityBank(angles_deg=bank.angles_deg, intensities=tuple(heard)), path)
    known_deg = bank.facts.reference_angle_deg if recording.reference_deg is None else recording.reference_deg
    return replace(recording, path=path, reference_deg=known_deg)
