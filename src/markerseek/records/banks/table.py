"""Reads and writes banks of intensities as CSV tables; a `TableFormat` names the columns and their units."""

from __future__ import annotations

import csv
import math
import shlex
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from markerseek.core import MAX_INTENSITY, ConfigError, Float64, RecordError
from markerseek.files import MIB, CsvRows, csv_rows, new_file, quoted, replace_file
from markerseek.records.banks.bank import MIN_STEP_DEG, IntensityBank, require_angles
from markerseek.records.untrusted_arrays import ARRAY_SUFFIXES

COLUMNS = ("angle_deg", "intensity")
"""Columns of the tables that we write."""

AngleUnit: TypeAlias = Literal["deg", "mrad", "rad"]
"""Unit of an angle in a table."""

_DEG_OF: dict[AngleUnit, float] = {"deg": 1.0, "mrad": math.degrees(1e-3), "rad": math.degrees(1.0)}
"""Degrees of one unit."""

_UNIT_OF_COLUMN: dict[str, AngleUnit] = {"angle_deg": "deg", "angle_mrad": "mrad", "angle_rad": "rad"}

_FEW = 2.0
"""Range below which angles may be radians: it is more than half a turn of a probe in radians."""

_DEG_DIGITS = 4
"""Digits behind the point of an angle in degrees that was written in another unit."""

_LARGEST_BYTES = 64 * MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFormat:
    """Which columns of a CSV, or variables of an array file, hold angle and intensity, and in which units."""

    columns: tuple[str, str] | None = None
    """Names of the columns of angle and intensity, or their numbers, counted from 1; None: ``angle_deg`` (or
    ``angle_mrad``, ``angle_rad``) and ``intensity``, or the two columns of a table without names."""
    unit: AngleUnit | None = None
    """None: as the name of the column says, else degrees."""
    db: bool = False
    """Whether the intensities are decibels, 20·log10 of the amplitude that a search needs."""
    skip_invalid: bool = False
    """Whether a row is left out whose angle or intensity is no finite number, instead of refusing the table."""

    def __post_init__(self) -> None:
        if self.columns is not None and (not all(self.columns) or self.columns[0] == self.columns[1]):
            raise ConfigError(
                f"columns is {','.join(self.columns)}, two different names or numbers are needed: ANGLE,INTENSITY"
            )


DEFAULT_FORMAT = TableFormat()
"""The format of the tables that we write."""


def write_bank(bank: IntensityBank, path: Path) -> None:
    """Write a bank as a CSV that `read_bank` reads, with every digit; its folder is made if missing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part:
            _write_rows(part, bank.angles_deg, bank.intensities)
    except OSError as problem:
        raise RecordError(
            f"{path}: the bank cannot be written: {problem.strerror or problem}; name another place"
        ) from problem


def write_intensities(path: Path, *, angles_deg: Sequence[float], intensities: Sequence[float]) -> None:
    """Write intensities over angles in degrees as a new CSV; `RecordError` if it cannot be written."""
    with new_file(path) as part:
        _write_rows(part, angles_deg, intensities)


def _write_rows(path: Path, angles_deg: Sequence[float], intensities: Sequence[float]) -> None:
    with path.open("w", newline="", encoding="utf-8") as lines:
        # Python's csv ends lines with CR LF by default, also on Linux.
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(zip(angles_deg, intensities, strict=True))


def read_table(path: Path, table: TableFormat = DEFAULT_FORMAT) -> IntensityBank:
    """Bank in a CSV; the rows may be in any order, and the intensities of a repeated angle are averaged.

    Columns are separated by commas, semicolons, tabs or spaces. Where it is not the comma that separates them, a comma
    in a number is a decimal one. A warning says what was averaged, left out or assumed.

    ``table``: which columns are read, their units, and what becomes of rows without numbers.
    """
    if path.suffix.lower() in ARRAY_SUFFIXES:
        raise RecordError(
            f"{path}: a scan that NumPy or MATLAB saved becomes a bank by "
            f"'markerseek bank import {quoted(path)} scan.hdf5'"
        )
    rows = csv_rows(
        path,
        most_bytes=_LARGEST_BYTES,
        what="a bank",
        cure=f"give a CSV of {','.join(COLUMNS)}, an IPASC HDF5 file (.hdf5, .h5), or a folder of frames",
    )
    columns = _columns(path, rows, table)
    angle_name = rows.names[columns[0]] if rows.names else ""
    cells = {line: [_cell(path, rows, line, column, table) for column in columns] for line in rows.cells}
    kept = [line for line, row in cells.items() if None not in row]
    warn_skipped(path, "line", [str(line) for line in cells if line not in set(kept)])
    values = np.array([cells[line] for line in kept], dtype=np.float64).reshape(-1, 2)
    read = amplitudes(values[:, 1], db=table.db, where=lambda index: f"{path}, line {kept[index]}")
    unit = unit_of(path, table.unit, angle_name, values[:, 0])
    angles_deg, intensities = averaged(path, in_degrees(values[:, 0], unit), read[:, None])
    require_angles(path, angles_deg.tolist())
    return IntensityBank(angles_deg=tuple(angles_deg.tolist()), intensities=tuple(intensities[:, 0].tolist()))


def _columns(path: Path, rows: CsvRows, table: TableFormat) -> tuple[int, int]:
    """Indices of the columns of angle and intensity."""
    names = rows.names
    if table.columns is not None:
        first, second = (_column_index(path, rows, column) for column in table.columns)
        return first, second
    if not names and rows.width == 2:
        warnings.warn(
            f"{path}: its columns have no names; the first is taken as the angle, the second as the intensity",
            stacklevel=3,
        )
        return 0, 1
    angle = next((name for name in names if name.lower() in _UNIT_OF_COLUMN), None)
    intensity = next((name for name in names if name.lower() == "intensity"), None)
    if angle is None or intensity is None:
        lacking = [name for name, found in zip(COLUMNS, (angle, intensity), strict=True) if found is None]
        missing = f"column {lacking[0]} is" if len(lacking) == 1 else f"columns {' and '.join(lacking)} are"
        # Quoted for the shell, because names have spaces. Only a person knows which of the two is the angle.
        proposed = len(names) == 2 and sum(map(len, names)) < _MOST_QUOTED
        perhaps = f", here perhaps {shlex.quote(','.join(names))}" if proposed else ""
        raise RecordError(
            f"{path}, line 1: the {missing} missing, it has {_head(rows)}; name the columns of angle and intensity: "
            f"--columns ANGLE,INTENSITY{perhaps}" + _if_transposed(rows)
        )
    return _column_index(path, rows, angle), _column_index(path, rows, intensity)


def _if_transposed(rows: CsvRows) -> str:
    """A question, where a table has the form of two long rows."""
    long = rows.width > 2 and len(rows.cells) + bool(rows.names) == 2
    return (
        f"; or are its two rows angles and intensities? Then write one row for each of the {rows.width}" if long else ""
    )


def _column_index(path: Path, rows: CsvRows, column: str) -> int:
    """Index of one column by its name, or by its number if none has that name."""
    found = [index for index, name in enumerate(rows.names) if name == column]
    if len(found) > 1:
        raise RecordError(f"{path}, line 1: the column {column} appears more than once; keep one of them")
    if found:
        return found[0]
    if column.isdecimal() and 1 <= int(column) <= rows.width:
        return int(column) - 1
    raise RecordError(f"{path}, line 1: there is no column {column}, it has {_head(rows)}")


_MOST_QUOTED = 60
"""Most characters of the first line in a message: of a text it is a sentence, and names nothing."""


def _head(rows: CsvRows) -> str:
    """What a table's first line holds, for a message."""
    names = ", ".join(rows.names) or f"{rows.width} columns without names, which are numbered from 1"
    return names if len(names) <= _MOST_QUOTED else f"{names[:_MOST_QUOTED]}…"


def in_degrees(angles: Float64[np.ndarray, " n"], unit: AngleUnit) -> Float64[np.ndarray, " n"]:
    """Angles in degrees, without the rounding of another unit: the same scan in degrees is searched in the same way."""
    return angles if unit == "deg" else np.round(angles * _DEG_OF[unit], _DEG_DIGITS)


def amplitudes(
    values: Float64[np.ndarray, " n"], *, db: bool, where: Callable[[int], str]
) -> Float64[np.ndarray, " n"]:
    """Finite intensities as amplitudes, or refused.

    ``db``: whether they are in dB. ``where``: file and line of each, for the messages.
    """
    if db:
        with np.errstate(over="ignore"):
            values = 10 ** (values / 20)
    for index in np.flatnonzero(values < 0)[:1]:
        raise RecordError(
            f"{where(index)}: intensity is {values[index]}, it must not be negative; are these dB, 20·log10 of the "
            "amplitude? Say so: --db. Or was a background subtracted? Then leave it in"
        )
    # Larger numbers overflow when the methods square them.
    for index in np.flatnonzero(values > MAX_INTENSITY)[:1]:
        raise RecordError(
            f"{where(index)}: intensity is {values[index]}, it must be at most {MAX_INTENSITY:g}; scale the intensities"
        )
    return values


def warn_skipped(path: Path, what: str, names: Sequence[str]) -> None:
    """Say which rows were left out; ``what``: line, or number of an angle."""
    if names:
        first = ", ".join(names[:5]) + (" …" if len(names) > 5 else "")
        warnings.warn(
            f"{path}: {len(names)} without a finite number left out (--skip-invalid): {what} {first}", stacklevel=3
        )


def _cell(path: Path, rows: CsvRows, line: int, column: int, table: TableFormat) -> float | None:
    """The finite number in a cell; None where there is none, and such rows are left out."""
    row = rows.cells[line]
    name = rows.names[column] if rows.names else f"column {column + 1}"
    # A comma inside a number, in a table that commas separate, shifts all columns behind it.
    if len(row) != rows.width:
        raise RecordError(
            f"{path}, line {line}: it has {len(row)} columns, {rows.width} are expected; a number with a decimal comma "
            "needs columns that a semicolon or a tab separates"
        )
    cure = "; leave that row out, or all such rows: --skip-invalid"
    try:
        value = float(rows.with_point(row[column]))
    except ValueError:
        if table.skip_invalid:
            return None
        raise RecordError(f"{path}, line {line}: {name} is {row[column]!r}, it must be a number{cure}") from None
    if math.isfinite(value):
        return value
    if table.skip_invalid:
        return None
    raise RecordError(f"{path}, line {line}: {name} is {value}, it must be finite{cure}")


def unit_of(path: Path, unit: AngleUnit | None, column: str, angles: np.ndarray) -> AngleUnit:
    """Unit of the angles; where only their range speaks, a small one is not guessed to be degrees."""
    if unit is not None:
        return unit
    named = _UNIT_OF_COLUMN.get(column.lower())
    small = angles.size > 2 and float(np.ptp(angles)) < _FEW
    question = f"the angles run from {angles.min():g} to {angles.max():g}: are these radians?" if small else ""
    if small and named is None:
        raise RecordError(f"{path}: {question} Say so: --unit rad, or --unit deg if they are degrees")
    if small and named == "deg":
        warnings.warn(f"{path}: {question} They are taken as degrees (--unit rad, --unit deg)", stacklevel=3)
    return named or "deg"


def averaged(
    path: Path, angles_deg: Float64[np.ndarray, " n"], values: Float64[np.ndarray, "n columns"]
) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, "angles columns"]]:
    """Angles in rising order, each once, with the mean of its rows, intensities first; a warning says it."""
    order = np.argsort(angles_deg, kind="stable")
    angles_deg, values = angles_deg[order], values[order]
    first = np.flatnonzero(np.diff(angles_deg, prepend=-np.inf) >= MIN_STEP_DEG)
    if first.size == angles_deg.size:
        return angles_deg, values
    counts = np.diff(first, append=angles_deg.size)
    warnings.warn(
        f"{path}: {int((counts > 1).sum())} angles appear more than once; the intensities of each are averaged",
        stacklevel=3,
    )
    return angles_deg[first], np.add.reduceat(values, first, axis=0) / counts[:, None]
