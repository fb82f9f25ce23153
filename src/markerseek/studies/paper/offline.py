"""The offline analysis (section 2.5): Fig. 6, errors over the number of acquisitions, and Table 1, errors after 16.

The searches run on banks, that is fine scans of the whole range: simulated at nine positions of five materials, or a
user's own. Simulated ones are made from channel data and written as CSV files, which `markerseek replay` also reads.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from markerseek import rigs
from markerseek.core import Estimate
from markerseek.records.banks import FrameBank, IntensityBank, read_bank, write_bank
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.methods import (
    ALL_METHODS,
    AVERAGE_ACQUISITIONS,
    BRACKET_ACQUISITIONS,
    BRACKETS,
    PAPER_METHODS,
    PEAK_COUNTS,
    TABLE_ACQUISITIONS,
    AnyMethod,
    QuantisedPolicy,
    RunOptions,
    policy_of,
)
from markerseek.studies.paper.printed import MATERIALS, PaperNumber, printed_value
from markerseek.studies.paper.section import (
    Answer,
    Comparison,
    Errors,
    Panel,
    Section,
    Table,
    compared,
    errors_figure,
    errors_table,
    make_section,
    make_table,
    summary_of,
)
from markerseek.studies.trial import searched

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TISSUES = dict(zip(MATERIALS, ("liver", "muscle", "chicken-breast", "plastisol-phantom", "muscle-icg"), strict=True))
"""The simulated material in place of each material of Table 1."""

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
    """What was scanned."""
    position: int = 1
    """At which of the nine positions, counted from 1."""
    peak_snr_db: float | None = None
    """Noise of a simulated bank; None for a user's own."""
    reference_deg: float | None
    """Angle that counts as true; None: that of the bank's largest intensity."""
    probe: str | None = None
    """Preset of the imaging chain for a bank of channel data; None: the bank's own, or the first of all."""


class _Scan(NamedTuple):
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
            scans.append(_Scan(banks, marker, step_deg, 1000 * options.seed + 10 * number + position))
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


@dataclass(frozen=True, slots=True, kw_only=True)
class OfflineSearch:
    """One search on one bank."""

    bank: OfflineBank
    method: AnyMethod
    acquisitions: int
    estimate: Estimate
    reference_deg: float
    """Angle that counts as true."""
    maximum_deg: float
    """Angle of the bank's largest intensity."""

    @property
    def answer(self) -> Answer:
        """Its error from the reference, and whether it claims its angle."""
        return Answer.of(self.estimate, truth_deg=self.reference_deg)


def offline_searches(banks: Sequence[OfflineBank], options: RunOptions) -> list[OfflineSearch]:
    """Searches with every method and every number of acquisitions of Fig. 6 on each bank."""
    return [search for found in options.each(_searches, banks, stage="offline searches") for search in found]


def _searches(bank: OfflineBank) -> list[OfflineSearch]:
    rig = rigs.replayed(bank.path, reference_deg=bank.reference_deg, between="interpolated")
    limits = rig.limits.search
    recorded = [rig.scanner.measure(angle_deg) for angle_deg in read_bank(bank.path).angles_deg]
    maximum_deg = max(recorded, key=lambda sample: sample.reading.intensity).angle_deg
    # The angles of TS, GSS and the posterior do not depend on N; the steps of WA do, so that each N is its own search.
    runs: list[tuple[AnyMethod, tuple[int, ...]]] = [
        *((name, BRACKET_ACQUISITIONS) for name in BRACKETS),
        *(("WA", (count,)) for count in AVERAGE_ACQUISITIONS),
        ("posterior", BRACKET_ACQUISITIONS),
    ]
    searches = []
    for name, counts in runs:
        policy = policy_of(name, acquisitions=max(counts), limits=limits, start_deg=limits.low_deg)
        found = searched(QuantisedPolicy(policy=policy, limits=limits), rig.scanner, counts=counts)
        searches += [
            OfflineSearch(
                bank=bank,
                method=name,
                acquisitions=count,
                estimate=answer,
                reference_deg=maximum_deg if bank.reference_deg is None else bank.reference_deg,
                maximum_deg=maximum_deg,
            )
            for count, answer in found.answers.items()
        ]
    return searches


_Group: TypeAlias = tuple[str, float | None, AnyMethod, int]
"""Material, peak SNR, method, number of acquisitions."""

_COLUMNS = "material peak_snr_db method acquisitions"


def fig6(searches: Sequence[OfflineSearch]) -> Section:
    """Fig. 6: mean error over the number of acquisitions, one panel for each material."""
    errors = _errors(searches)
    rows = (
        (
            each.bank.path.name, each.bank.position, each.method, each.acquisitions, each.estimate.mean_deg,
            each.reference_deg, each.maximum_deg, each.answer.error_deg, "yes" if each.answer.claimed else "no",
        )
        for each in searches
    )  # fmt: skip
    return _section(
        "fig6",
        searches,
        comparisons=_of_own_bank(errors) or _worst_after_28(errors),
        tables=(
            errors_table("fig6", "Errors of the offline searches", _COLUMNS, errors),
            make_table(
                "fig6_searches",
                "Every offline search",
                "bank position method acquisitions angle_deg reference_deg bank_maximum_deg error_deg claimed",
                rows,
                shown=False,
            ),
        ),
        draw=partial(_draw, errors),
    )


def table1(searches: Sequence[OfflineSearch]) -> Section:
    """Table 1: errors after 16 acquisitions."""
    errors = {group: each for group, each in _errors(searches).items() if group[3] == TABLE_ACQUISITIONS}
    after = f"after {TABLE_ACQUISITIONS} acquisitions, mean error"
    comparisons = (
        compared(
            PaperNumber(quantity=f"posterior (ours) on {material} {after}")
            if name == "posterior"
            else f"table1/{name}/{material}",
            each,
            condition=f"{level_db:g} dB",
        )
        # Of each material by method, then by noise.
        for material in MATERIALS
        for name in ALL_METHODS
        for level_db in LEVELS_DB
        if (each := errors.get((material, level_db, name, TABLE_ACQUISITIONS))) is not None
    )
    return _section(
        "table1",
        searches,
        comparisons=(
            *_of_own_bank(errors),
            *comparisons,
        ),
        tables=(errors_table("table1", "Errors of the offline searches", _COLUMNS, errors, shown=True),),
    )


def _section(
    name: str,
    searches: Sequence[OfflineSearch],
    *,
    comparisons: tuple[Comparison, ...],
    tables: tuple[Table, ...],
    draw: Callable[[], Figure] | None = None,
) -> Section:
    """Section with the text on the banks."""
    bank = searches[0].bank
    own = bank.peak_snr_db is None
    return make_section(
        name,
        method=("offline, own" if own else "offline, simulated", "offline"),
        comparisons=comparisons,
        tables=tables,
        draw=draw,
        bank=bank.path,
        reference="given" if bank.reference_deg is not None else "the angle of the bank's largest intensity",
        acquisitions=TABLE_ACQUISITIONS,
    )


def _errors(searches: Sequence[OfflineSearch]) -> dict[_Group, Errors]:
    groups: dict[_Group, list[Answer]] = {}
    for each in searches:
        group = (each.bank.material, each.bank.peak_snr_db, each.method, each.acquisitions)
        groups.setdefault(group, []).append(each.answer)
    return {group: summary_of(found) for group, found in groups.items()}


def _of_own_bank(errors: dict[_Group, Errors]) -> tuple[Comparison, ...]:
    """Errors of the searches on a user's own bank, to which none of the paper's numbers belongs; else nothing."""
    return tuple(
        compared(PaperNumber(quantity=f"{name} after {count} acquisitions, error"), each)
        for (_, level_db, name, count), each in errors.items()
        if level_db is None
    )


def _worst_after_28(errors: dict[_Group, Errors]) -> tuple[Comparison, ...]:
    """The conclusion's "below 0.5° on all materials": the largest mean error of TS, of GSS, and of the posterior."""
    ours = PaperNumber(quantity="posterior (ours) on every material after 28 acquisitions, mean error: at most")
    comparisons = []
    for level_db in dict.fromkeys(level_db for _, level_db, _, _ in errors if level_db is not None):
        for name in (*BRACKETS, "posterior"):
            found = [each for (_, *group), each in errors.items() if group == [level_db, name, 28]]
            worst = max(found, key=lambda each: each.mean_deg)
            number = ours if name == "posterior" else "fig6/28"
            comparisons.append(compared(number, worst, condition=f"{name}, the worst material, {level_db:g} dB"))
    return tuple(comparisons)


def _draw(errors: dict[_Group, Errors]) -> Figure:
    places = list(dict.fromkeys((level_db, material) for material, level_db, _, _ in errors))
    # By noise first: each noise has a row of panels, one for each material.
    places.sort(key=lambda place: place[0] or 0.0)
    is_simulated = places[0][0] is not None
    return errors_figure(
        [
            Panel(
                material if level_db is None else f"{material}, {level_db:g} dB",
                {group[2:]: each for group, each in errors.items() if group[:2] == (material, level_db)},
                {
                    (name, TABLE_ACQUISITIONS): printed_value(f"table1/{name}/{material}")
                    for name in PAPER_METHODS
                    if is_simulated
                },
            )
            for level_db, material in places
        ],
        heading="Offline searches" + (" on simulated materials" if is_simulated else ""),
        columns=5,
        # A panel alone must be wide enough for the legend.
        panel_in=(2.9, 3.0) if len(places) > 1 else (6.0, 4.0),
        printed="paper (Table 1)",
    )
