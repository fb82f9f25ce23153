"""The offline analysis (section 2.5): Fig. 6, errors over the number of acquisitions, and Table 1, errors after 16.

The searches run on banks, that is fine scans of the whole range: simulated at nine positions of five materials, or a
user's own. Simulated ones are made from channel data and written as CSV files, which `markerseek replay` also reads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from msgspec import structs

from markerseek import rigs
from markerseek.core import ConfigError
from markerseek.records.banks import FrameBank, IntensityBank, read_bank, write_bank
from markerseek.sim import MarkerSettings, NoiseSettings, ReceiverSettings, SimulatedSettings
from markerseek.studies.paper.methods import (
    BRACKETS,
    BUILT,
    PEAK_COUNTS,
    RUNS,
    TABLE_ACQUISITIONS,
    PaperMethod,
    PaperSearch,
    QuantisedPolicy,
    RunOptions,
    paper_search,
    policy_of,
)
from markerseek.studies.paper.section import (
    MATERIALS,
    Comparison,
    Errors,
    Group,
    Panel,
    Section,
    compared,
    errors_by_group,
    errors_figure,
    errors_table,
    make_section,
    make_table,
    printed_value,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TISSUES = dict(zip(MATERIALS, ("liver", "muscle", "chicken-breast", "plastisol-phantom", "muscle-icg"), strict=True))
"""The simulated material in place of each material of Table 1."""

ONE_BANK = MATERIALS[-1]
"""The material for which the paper recorded a single position."""

_STEP_DEG = 0.5
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
    """Return the positions 1 to 9, row by row along x, each a marker in the frame of the probe."""
    markers = []
    for y in (-1, 0, 1):
        for x in (-1, 0, 1):
            # x is across the axis of rotation and sets the angle; y is along the array.
            off_x_m, off_y_m = rng.normal(0.0, ROUGHNESS_M, 2)
            x_m = x * SPACING_M + off_x_m
            y_m = y * SPACING_M + off_y_m
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
    """A bank of intensities on disk, and where its marker is."""

    path: Path
    """Table of angles and intensities."""
    material: str
    """What was scanned."""
    position: int = 1
    """At which of the nine positions, counted from 1."""
    peak_snr_db: float | None = None
    """Noise of a simulated bank; None for a user's own."""
    reference_deg: float | None
    """Angle that counts as true; None: that of the bank's largest intensity."""


def own_bank(path: Path, *, reference_deg: float | None) -> OfflineBank:
    """Return a user's own bank.

    Raises `ConfigError` for channel data: the paper interpolates intensities between two angles (section 2.5), and
    frames cannot be interpolated.
    """
    if isinstance(read_bank(path), FrameBank):
        raise ConfigError(
            f"{path}: the bank holds frames, and intensities are needed; `write_bank({path}, NEW.csv)` makes them"
        )
    return OfflineBank(path=path, material=path.stem, reference_deg=reference_deg)


class _Scan(NamedTuple):
    """Banks of one position that are made together, one for each noise."""

    banks: tuple[OfflineBank, ...]
    marker: MarkerSettings
    step_deg: float
    seed: int


def simulated_banks(folder: Path, options: RunOptions) -> list[OfflineBank]:
    """Write and return the banks of the five materials at nine positions each (of the last at one), for each noise.

    The same positions and spots are scanned under each noise. With fewer markers than the paper's, fewer positions are
    scanned, in coarser steps.

    ``folder``: where the CSV files go.
    """
    step_deg = _STEP_DEG if options.share >= 0.5 else 5 * _STEP_DEG
    scans = []
    for number, (material, tissue) in enumerate(_TISSUES.items()):
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
        tissue=_TISSUES[scan.banks[0].material],
        marker=scan.marker,
        receiver=ReceiverSettings(peak_counts=PEAK_COUNTS),
    )
    search = settings.limits.search
    # Upwards from the lower end: the stage then needs no second approach from below.
    settings = structs.replace(settings, start_deg=search.low_deg)
    noises = [NoiseSettings(peak_snr_db=bank.peak_snr_db or 0.0) for bank in scan.banks]
    scanners = [
        rigs.simulated(seed=scan.seed, settings=structs.replace(settings, noise=noise)).scanner for noise in noises
    ]
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


def offline_searches(banks: Sequence[OfflineBank], options: RunOptions) -> list[PaperSearch]:
    """Return the searches with every method and every number of acquisitions of Fig. 6 on each bank."""
    return [search for found in options.each(_searches, banks, stage="offline searches") for search in found]


def _searches(bank: OfflineBank) -> list[PaperSearch]:
    rig = rigs.replayed(bank.path, reference_deg=bank.reference_deg, between="interpolated")
    limits = rig.limits.search
    recorded = [rig.scanner.measure(angle_deg) for angle_deg in read_bank(bank.path).angles_deg]
    maximum_deg = max(recorded, key=lambda sample: sample.reading.intensity).angle_deg
    searches = []
    for name, counts in RUNS:
        policy = policy_of(name, acquisitions=max(counts), limits=limits)
        searches.append(
            paper_search(
                QuantisedPolicy(policy=policy, limits=limits),
                rig,
                truth_deg=maximum_deg if bank.reference_deg is None else bank.reference_deg,
                counts=counts,
                place=bank.material,
                peak_snr_db=bank.peak_snr_db,
                method=name,
                position=bank.position,
            )
        )
    return searches


def fig6(searches: Sequence[PaperSearch], own: OfflineBank | None = None) -> Section:
    """Return Fig. 6: mean error over the number of acquisitions, one panel for each material.

    ``own``: the user's own bank that was searched; None for the simulated ones.
    """
    errors = errors_by_group(searches)
    rows = (
        (
            each.place, each.peak_snr_db, each.position, each.method, count, angle_deg, each.truth_deg,
            each.error_deg(count),
        )
        for each in searches
        for count, angle_deg in each.answers_deg.items()
    )  # fmt: skip
    columns = "bank peak_snr_db position method acquisitions angle_deg reference_deg error_deg"
    return _section(
        "fig6",
        own,
        comparisons=_worst_after_28(errors) if own is None else _of_own_bank(errors),
        tables=(
            errors_table("fig6", "Errors of the offline searches", "material", errors),
            make_table("fig6_searches", "Every offline search", columns, rows, shown=False),
        ),
        draw=partial(_draw, errors, is_simulated=own is None),
    )


def table1(searches: Sequence[PaperSearch], own: OfflineBank | None = None) -> Section:
    """Return Table 1: errors after 16 acquisitions; ``own`` as in `fig6`."""
    errors = {group: each for group, each in errors_by_group(searches).items() if group[3] == TABLE_ACQUISITIONS}
    comparisons = _of_own_bank(errors)
    if own is None:
        comparisons = tuple(
            compared(
                f"table1/{name}/{material}",
                errors[material, level_db, name, TABLE_ACQUISITIONS],
                condition=f"{level_db:g} dB",
            )
            # Of each material by method, then by noise.
            for material in MATERIALS
            for name in BUILT
            for level_db in LEVELS_DB
        )
    table = errors_table("table1", "Errors of the offline searches", "material", errors, shown=True)
    return _section("table1", own, comparisons=comparisons, tables=(table,))


def _section(name: str, own: OfflineBank | None, **parts: Any) -> Section:
    """Return the section with the text on the banks."""
    results: dict[str, object] = {"acquisitions": TABLE_ACQUISITIONS}
    if own is not None:
        given = own.reference_deg is not None
        results |= {"bank": own.path, "reference": "given" if given else "the angle of the bank's largest intensity"}
    banks = "offline, simulated" if own is None else "offline, own"
    return make_section(name, method=(banks, "offline"), results=results, **parts)


def _of_own_bank(errors: Mapping[Group, Errors]) -> tuple[Comparison, ...]:
    """Return the errors of the searches on a user's own bank, to which none of the paper's numbers belongs."""
    return tuple(
        compared(f"{name} after {count} acquisitions, error", each, of_paper=False)
        for (_, _, name, count), each in errors.items()
    )


def _worst_after_28(errors: Mapping[Group, Errors]) -> tuple[Comparison, ...]:
    """Return the conclusion's "below 0.5° on all materials": the largest mean error of TS and of GSS."""
    worst = {
        (level_db, name): max((errors[material, level_db, name, 28] for material in MATERIALS), key=_mean_deg)
        for level_db in LEVELS_DB
        for name in BRACKETS
    }
    return tuple(
        compared("fig6/28", each, condition=f"{name}, the worst material, {level_db:g} dB")
        for (level_db, name), each in worst.items()
    )


def _mean_deg(errors: Errors) -> float:
    return errors.error_deg.mean or 0.0


def _draw(errors: Mapping[Group, Errors], *, is_simulated: bool) -> Figure:
    places = list(dict.fromkeys((level_db, material) for material, level_db, _, _ in errors))
    # By noise first: each noise has a row of panels, one for each material.
    places.sort(key=lambda place: place[0] or 0.0)

    def printed_deg(material: str) -> dict[tuple[PaperMethod, int], float]:
        if not is_simulated:
            return {}
        return {(name, TABLE_ACQUISITIONS): printed_value(f"table1/{name}/{material}") for name in BUILT}

    return errors_figure(
        errors,
        [
            Panel(material, level_db, material + (f", {level_db:g} dB" if is_simulated else ""), printed_deg(material))
            for level_db, material in places
        ],
        heading="Offline searches" + (" on simulated materials" if is_simulated else ""),
        columns=5,
        # A panel alone must be wide enough for the legend.
        panel_in=(2.9, 3.0) if len(places) > 1 else (6.0, 4.0),
        printed="paper (Table 1)",
    )
