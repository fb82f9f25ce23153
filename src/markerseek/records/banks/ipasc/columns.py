"""Reads our bank in IPASC HDF5 but for its frames: columns (one number per measurement), metadata, element positions.

The elements must be the straight, equally spaced row that the imaging needs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.core import MAX_INTENSITY, Float64, RecordError
from markerseek.records.banks.bank import BankFacts, rising
from markerseek.records.banks.ipasc import fields
from markerseek.records.hdf5 import CheckedHdf5

TOLERANCE = 0.01
"""Largest distance of an element from its place in the row, in pitches."""

_MAX_ANGLES = 1_000_000
# In digits: int() of a longer text takes time with the square of its length.
_LONGEST_SEED = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class Columns:
    """Columns of the measurements that were taken, in the order of the angles."""

    rows: tuple[int, ...]
    """Row in the file of each measurement."""
    angles_deg: tuple[float, ...]
    intensities: tuple[float, ...]
    """Intensities; NaN where one is missing."""
    pulses: tuple[int, ...]
    """Pulses averaged; 1 where they are missing."""
    started_s: tuple[float, ...]
    """Times on the clock of the rig; NaN where one is missing."""
    energies: tuple[float, ...]
    """Energy of the pulses over the usual one; NaN where it was not measured."""


def read_columns(path: Path, file: CheckedHdf5) -> Columns:
    """Columns of a bank that has ``trus_angle_deg``.

    Raises `ValueError` if a field does not hold what it should.
    """
    angles = file.numbers(fields.ANGLES)
    if angles.size > _MAX_ANGLES:
        raise RecordError(f"{path}: it holds {angles.size} angles, at most {_MAX_ANGLES} are expected")
    missing = int(np.count_nonzero(np.isnan(angles)))
    if missing:
        raise RecordError(
            f"{path}: {missing} of {angles.size} angles were never measured: a version under development wrote this "
            "bank, and its scan was killed; scan again"
        )
    angles_deg, order = rising(path, angles)
    pulses = one_each(file, fields.PULSES, angles.size, otherwise=1.0)[order]
    return Columns(
        rows=tuple(order.tolist()),
        angles_deg=angles_deg,
        intensities=tuple(_intensities(path, file, angles.size)[order].tolist()),
        pulses=tuple(int(each) for each in np.where(pulses >= 0, pulses, 1)),
        started_s=tuple(one_each(file, fields.RIG_CLOCK, angles.size)[order].tolist()),
        energies=tuple(one_each(file, fields.ENERGY, angles.size)[order].tolist()),
    )


def _intensities(path: Path, file: CheckedHdf5, count: int) -> Float64[np.ndarray, " angles"]:
    if not file.has(fields.INTENSITIES):
        return np.full(count, np.nan)
    values = file.numbers(fields.INTENSITIES)
    if values.size != count:
        raise RecordError(f"{path}: {values.size} intensities for {count} angles; the file is damaged: scan again")
    # NaN is allowed: a frame can be stored before its intensity is known.
    if not (values[np.isfinite(values)] >= 0).all():
        raise RecordError(f"{path}: an intensity is negative; the file is damaged: scan again")
    if (values[np.isfinite(values)] > MAX_INTENSITY).any():
        raise RecordError(f"{path}: an intensity is above {MAX_INTENSITY:g}; the file is damaged: scan again")
    return np.where(np.isfinite(values), values, np.nan)


def one_each(
    file: CheckedHdf5, name: str, count: int, *, otherwise: float = math.nan
) -> Float64[np.ndarray, " angles"]:
    """One number for each measurement, missing ones replaced by `otherwise`."""
    values = numbers_of(file, name)
    if values.size not in (0, count):
        raise ValueError(f"{name} holds {values.size} numbers for {count} angles")
    values = values if values.size else np.full(count, otherwise)
    return np.where(np.isfinite(values), values, otherwise)


def read_facts(file: CheckedHdf5, *, pitch_m: float | None) -> BankFacts:
    """Metadata of a bank.

    Raises `ValueError` if a field does not hold what it should.
    """
    return BankFacts(
        description=file.text(fields.DESCRIPTION) or "",
        probe=file.text(fields.PROBE),
        probe_settings=file.text(fields.PROBE_SETTINGS),
        sampling_hz=_between(file, fields.SAMPLING, 1e5, 1e9),
        first_sample_s=_between(file, fields.FIRST_SAMPLE, 0.0, 1e-3),
        sound_speed_m_s=_between(file, fields.SOUND_SPEED, 300.0, 7000.0),
        pitch_m=pitch_m,
        wavelength_m=_wavelength_m(file),
        pulse_energy_j=_usual_energy_j(file),
        face_radius_m=_between(file, fields.FACE_RADIUS, 0.0, 1.0),
        reference_angle_deg=file.number(fields.REFERENCE),
        clock_zero_unix_s=file.number(fields.CLOCK_ZERO),
        simulated=_truth(file.number(fields.SIMULATED)),
        configuration=file.text(fields.CONFIGURATION),
        seed=_seed(file.text(fields.SEED)),
        made_with=file.text(fields.MADE_WITH),
    )


def _wavelength_m(file: CheckedHdf5) -> float | None:
    """The first wavelength in metres; some programs write nanometres."""
    written = _first(file, fields.WAVELENGTH)
    return None if written is None else written * 1e-9 if written >= 1.0 else written


def _truth(number: float | None) -> bool | None:
    return None if number is None else number != 0


def _seed(text: str | None) -> int | None:
    return int(text) if text is not None and text.isdecimal() and len(text) <= _LONGEST_SEED else None


def _between(file: CheckedHdf5, name: str, low: float, high: float) -> float | None:
    """A number in SI units within its physical range; None if it is missing."""
    value = file.number(name)
    if value is not None and not low <= value <= high:
        # A value far out is a flipped bit or a wrong unit, such as km/s.
        raise ValueError(f"{name} is {value:g}, it must lie between {low:g} and {high:g}")
    return value


def _usual_energy_j(file: CheckedHdf5) -> float | None:
    """Energy of a usual pulse in joules: the first, without what it had more or less than a usual one."""
    joules = _first(file, fields.PULSE_ENERGY)
    if joules is None or not joules > 0:
        return None
    # Where the energy over the usual one was not measured, that of a usual pulse is written.
    return joules / (_first(file, fields.ENERGY) or 1.0)


def numbers_of(file: CheckedHdf5, name: str) -> Float64[np.ndarray, " values"]:
    """Numbers of a dataset; none if it is missing, or the text ``None`` that pacfish writes."""
    return file.numbers(name) if file.has(name) and file.text(name) is None else np.empty(0)


def _first(file: CheckedHdf5, name: str) -> float | None:
    """The first number of a dataset; None if it has none, or no finite one."""
    values = numbers_of(file, name)
    return float(values[0]) if values.size and math.isfinite(values[0]) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ElementRow:
    """A straight row of equally spaced elements."""

    pitch_m: float | None
    """Distance from one element to the next; None if the file does not say where they are."""
    falling: bool
    """Whether the x1 coordinate falls from the first element in the file to the last."""


def element_row(path: Path, file: CheckedHdf5, *, elements: int) -> ElementRow:
    """Pitch and direction of the array, from the positions of all its elements."""
    names = [f"{fields.DETECTORS}/{each}/detector_position" for each in file.names(fields.DETECTORS)]
    present = [file.has(name) for name in names]
    if not any(present):
        return ElementRow(pitch_m=None, falling=False)
    if not all(present) or len(names) != elements:
        raise RecordError(
            f"{path}: {fields.DETECTORS} holds positions of {sum(present)} elements for {elements} channels; "
            "each channel must have one"
        )
    positions = [file.numbers(name) for name in names]
    for name, position in zip(names, positions, strict=True):
        if position.size != 3 or not np.isfinite(position).all():
            raise RecordError(f"{path}: {name} is {position.tolist()}, three finite coordinates in metres are expected")
    return row_of(path, np.array(positions))


def row_of(path: Path, positions_m: Float64[np.ndarray, "elements 3"]) -> ElementRow:
    """The row that elements at these positions make along the first axis; `RecordError` where they make none."""
    elements = len(positions_m)
    if elements == 1:
        return ElementRow(pitch_m=None, falling=False)
    along_m = positions_m[:, 0]
    numbers = np.arange(elements)
    # The sign of the regression slope: robust against positions that are out of order by rounding.
    falling = bool(np.dot(numbers - numbers.mean(), along_m) < 0)
    pitch_m = float(np.ptp(along_m)) / (elements - 1)
    if pitch_m == 0:
        raise RecordError(
            f"{path}: all elements have the same coordinate along x1, {along_m[0]:g} m; "
            "only a straight row of elements along x1 can be imaged"
        )
    # The median, so that one wrong element is reported itself and does not shift the row.
    row_m = np.tile(np.median(positions_m, axis=0), (elements, 1))
    row_m[:, 0] = along_m.max() - pitch_m * numbers if falling else along_m.min() + pitch_m * numbers
    off_m = np.linalg.norm(positions_m - row_m, axis=1)
    worst = int(off_m.argmax())
    if not off_m[worst] <= TOLERANCE * pitch_m:
        x1_mm, x2_mm, x3_mm = 1e3 * positions_m[worst]
        raise RecordError(
            f"{path}: element {worst + 1} of {elements} is at ({x1_mm:.4g}, {x2_mm:.4g}, {x3_mm:.4g}) mm, "
            f"{off_m[worst] * 1e3:.3g} mm from its place in a straight row of pitch {pitch_m * 1e3:.4g} mm along "
            f"x1; at most {TOLERANCE:g} of the pitch is allowed: only such rows can be imaged"
        )
    return ElementRow(pitch_m=pitch_m, falling=falling)
