"""Reads and writes banks of intensities as CSV tables; a `TableFormat` says what a recording does not say itself."""

from __future__ import annotations

import csv
import math
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from markerseek.core import MAX_INTENSITY, ConfigError, Float64, RecordError, counted
from markerseek.files import DECIMAL_COMMA, MIB, CsvRows, csv_rows, is_number, may_be_number, read_text, replace_file
from markerseek.records.banks.bank import (
    AXES,
    MAX_DEG,
    MIN_STEP_DEG,
    IntensityBank,
    first_of,
    require_angles,
    unwrapped,
    warn,
)

COLUMNS = ("angle_deg", "intensity")
"""Columns of the tables that we write."""

AngleUnit: TypeAlias = Literal["deg", "mrad", "rad"]
"""Unit of an angle in a table."""

_DEG_OF: dict[AngleUnit, float] = {"deg": 1.0, "mrad": math.degrees(1e-3), "rad": math.degrees(1.0)}
"""Degrees of one unit."""

_UNIT_OF_WORD: dict[str, AngleUnit] = {
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("mrad", "milliradian", "milliradians"), "mrad"),
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
}

_DECIBELS = re.compile(r"(?:(?<![A-Za-z])(?i:db)|(?<=[a-z])dB)(?i:[mµμu]?[vw]|m|fs|u|c|pa)?(?![A-Za-z])|(?i:decibels?)")
"""A unit of decibels in the name of a column: ``intensity_db``, ``amplitude [dB]``, ``level_dBV``."""

_LINEAR = re.compile(r"(?<![A-Za-z])(?:[munkMµμ]?(?:V|W|J|Pa)|(?i:counts?|adc|lsb|linear))(?![A-Za-z])")
"""A unit other than decibels in the name of a column."""

_FEW = 2.0
"""Range of angles below which their unit may be radians: 2 rad are 115 degrees."""

_DEG_DIGITS = 4
"""Decimals of an angle in degrees that was written in another unit."""

_ENERGY = re.compile(r"(?:pulse|laser)?_?energy(?:_[munµμ]?j)?")
"""Name of a column with the energy of the pulses at each angle, in plain form."""

_LARGEST_BYTES = 64 * MIB


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFormat:
    """What a recording does not say itself: its columns or variables, units, angles, axes, channels to be left out."""

    columns: tuple[str, str] | None = None
    """Names of the columns of angle and intensity, or their numbers, counted from 1; None: ``angle_deg`` (or
    ``angle_mrad``, ``angle_rad``) and ``intensity`` (or ``intensity_db``), or the two columns of a table without
    names."""
    unit: AngleUnit | None = None
    """None: as the name of the column says, else degrees."""
    db: bool = False
    """Whether the intensities are decibels, 20·log10 of the amplitude that a search needs; False: as the name of the
    column says, such as ``intensity_db``."""
    skip_invalid: bool = False
    """Whether a row is left out whose angle or intensity is no finite number, instead of refusing the table."""
    first_and_step_deg: tuple[float, float] | None = None
    """Angle of the first frame and step to the next, in degrees, of a recording without angles."""
    angles_deg: tuple[float, ...] | None = None
    """Angle of each frame in degrees, of such a recording."""
    axes: tuple[str, ...] | None = None
    """Order of the axes of the frames, a permutation of `AXES`; None: that of `AXES`, refused where axes of equal
    length leave it open."""
    first_frame: int | None = None
    """Number in the receive buffer of a Vantage of the frame with the first angle; None: as the file shows."""
    without_channels: tuple[int, ...] = ()
    """Channels that are left out, counted from 1."""
    angle_field: str | None = None
    """Field, or transform, of a sequence with the angle of each frame."""

    def __post_init__(self) -> None:
        if self.columns is not None and (not all(self.columns) or self.columns[0] == self.columns[1]):
            raise ConfigError(
                f"columns is {','.join(self.columns)}, two different names or numbers are needed: ANGLE,INTENSITY"
            )
        if self.first_and_step_deg is not None and self.angles_deg is not None:
            raise ConfigError("--angles and --first-deg with --step-deg both give the angles; leave one out")
        if self.first_and_step_deg is not None:
            first_deg, step_deg = self.first_and_step_deg
            if not (math.isfinite(first_deg) and 0 < abs(step_deg) < math.inf):
                raise ConfigError(
                    f"--first-deg {first_deg:g}, --step-deg {step_deg:g}: finite numbers are needed, a step not 0"
                )
        if self.axes is not None and sorted(self.axes) != sorted(AXES):
            raise ConfigError(f"--axes is {','.join(self.axes)!r}; write the three in their order: {','.join(AXES)}")


DEFAULT_FORMAT = TableFormat()
"""The format of the tables that we write."""


def angles_in(path: Path) -> tuple[float, ...]:
    """Angles in degrees of a text file with one on each line, below a name or not; `RecordError` if it is none."""
    cure = "write one angle in degrees on each line"
    text = read_text(path, most_bytes=MIB, what="a list of angles", cure=cure, also=("cp1252",))
    # A comma can only be the sign of the decimals.
    texts = [line.strip().replace(",", ".").replace("\u2212", "-") for line in text.split("\n") if line.strip()]
    try:
        return tuple(float(text) for text in texts[1 if texts and not is_number(texts[0]) else 0 :])
    except ValueError as problem:
        raise RecordError(f"{path}: {problem}; {cure}") from problem


def write_bank(bank: IntensityBank, path: Path) -> None:
    """Write a bank as a CSV that `read_bank` reads, with every digit; its folder is made if missing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part, part.open("w", newline="", encoding="utf-8") as lines:
            # Python's csv ends lines with CR LF by default, also on Linux.
            writer = csv.writer(lines, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(zip(bank.angles_deg, bank.intensities, strict=True))
    except OSError as problem:
        raise RecordError(
            f"{path}: the bank cannot be written: {problem.strerror or problem}; name another place"
        ) from problem


def read_table(path: Path, table: TableFormat) -> IntensityBank:
    """Bank in a CSV; the rows may be in any order, and the intensities of a repeated angle are averaged.

    Columns are separated by commas, semicolons, tabs or spaces. The numbers themselves tell which sign separates
    decimals and which thousands. Intensities are divided by a column ``energy`` over its mean. A warning says what was
    averaged, left out, unwrapped or assumed.

    ``table``: which columns are read, their units, and what becomes of rows without numbers.
    """
    rows = csv_rows(
        path,
        most_bytes=_LARGEST_BYTES,
        what="a bank",
        cure=f"give a CSV of {','.join(COLUMNS)}, an IPASC HDF5 file (.hdf5, .h5), or a folder of frames",
    )
    columns = _columns(path, rows, table)
    angle_name, intensity_name = (rows.names[column] if rows.names else "" for column in columns)
    energies = [rows.names.index(name) for plain, name in _plain(rows.names).items() if _ENERGY.fullmatch(plain)]
    columns += tuple(each for each in energies[:1] if each not in columns)
    db = decibels(table.db, intensity_name)
    largest = MAX_DEG / _DEG_OF[table.unit or unit_named(angle_name) or "deg"]
    # A factor of 1000 is harmless in amplitudes, but not in decibels, which are below 1000.
    texts = rows.numbers(path, columns, most=(largest, 999.0 if db else None, None)[: len(columns)])
    cells = {line: _row(path, rows, line, columns, texts[line], table) for line in rows.cells}
    kept = [line for line, row in cells.items() if None not in row]
    warn_skipped(path, "line", [str(line) for line in cells if line not in set(kept)])
    values = np.array([cells[line] for line in kept], dtype=np.float64).reshape(-1, len(columns))
    read = amplitudes(values[:, 1], db=db, where=lambda index: f"{path}, line {kept[index]}")
    if len(columns) > 2:
        energy, name = values[:, 2], rows.names[columns[2]]
        for index in np.flatnonzero(energy <= 0)[:1]:
            raise RecordError(f"{path}, line {kept[index]}: {name} is {energy[index]:g}, it must be positive")
        warn(path, f"the intensities are divided by {name} over its mean")
        read = read * energy.mean() / energy
    unit = unit_of(path, table.unit, angle_name, values[:, 0])
    turned = unwrapped(path, in_degrees(values[:, 0], unit))
    angles_deg, intensities = averaged(path, turned, read[:, None])
    return IntensityBank(angles_deg=tuple(angles_deg.tolist()), intensities=tuple(intensities[:, 0].tolist()))


def _plain(names: Sequence[str]) -> dict[str, str]:
    """Names of columns by their plain form: ``angle [mrad]`` is ``angle_mrad``."""
    return {"_".join(re.findall(r"[^\W_]+|°", name.lower())): name for name in reversed(names)}


def _columns(path: Path, rows: CsvRows, table: TableFormat) -> tuple[int, ...]:
    """Indices of the columns of angle and intensity."""
    names = rows.names
    if table.columns is not None:
        first, second = (_column_index(path, rows, column) for column in table.columns)
        return first, second
    if not names and rows.width == 2:
        warn(path, "its columns have no names; the first is taken as the angle, the second as the intensity")
        return 0, 1
    plain = _plain(names)
    angle = next((plain[each] for each in (f"angle_{unit}" for unit in _UNIT_OF_WORD) if each in plain), None)
    usual = ("intensity_db", "intensity") if table.db else ("intensity", "intensity_db")
    intensity = next((plain[each] for each in usual if each in plain), None)
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
    """A question for the message, if the table has two long rows."""
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
    _refuse_overloads(values, where)
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


OVERLOADS = (9.9e37, 9.91e37, float(np.finfo(np.float32).max))
"""Numbers by which an instrument says that its range was exceeded: SCPI-99's infinity and no number, and the largest of
single precision."""

_INFINITE = re.compile(r"\+?(?:inf|infinity)", re.IGNORECASE)

_OVERLOADED = (
    "by which an instrument says that its range was exceeded, most probably on the marker; reduce gain or light and "
    "scan again, or take these rows out of the file: an answer is then that of the flanks"
)


def _refuse_overloads(values: Float64[np.ndarray, " n"], where: Callable[[int], str]) -> None:
    """Refuse intensities that are no measurement but the sign of an overload, single precision or not."""
    marked = np.isclose(values[:, None], OVERLOADS, rtol=1e-6, atol=0.0).any(axis=1)
    for index in np.flatnonzero(marked)[:1]:
        rows = counted(int(marked.sum()), "row has", "rows have")
        raise RecordError(f"{where(index)}: intensity is {values[index]:g} ({rows} such a number), {_OVERLOADED}")


def warn_skipped(path: Path, what: str, names: Sequence[str]) -> None:
    """Say which rows were left out; ``what``: line, or number of an angle."""
    if names:
        warn(path, f"{len(names)} without a finite number left out (--skip-invalid): {what} {first_of(names)}")


def _row(
    path: Path, rows: CsvRows, line: int, columns: Sequence[int], texts: Sequence[str], table: TableFormat
) -> list[float | None]:
    """The finite numbers of a row; None for a cell without one, if such rows are left out."""
    # A comma inside a number, in a table that commas separate, shifts all columns behind it.
    if len(rows.cells[line]) != rows.width:
        raise RecordError(
            f"{path}, line {line}: it has {len(rows.cells[line])} columns, {rows.width} are expected; {DECIMAL_COMMA}"
        )
    if not table.skip_invalid and _INFINITE.fullmatch(texts[1].strip()):
        raise RecordError(f"{path}, line {line}: intensity is {texts[1].strip()}, {_OVERLOADED}")
    return [_value(path, rows, line, column, text, table) for column, text in zip(columns, texts, strict=True)]


def _value(path: Path, rows: CsvRows, line: int, column: int, text: str, table: TableFormat) -> float | None:
    """The finite number in a cell; None if there is none and such rows are left out."""
    name = rows.names[column] if rows.names else f"column {column + 1}"
    cure = "; leave that row out, or all such rows: --skip-invalid"
    try:
        value = float(text)
    except ValueError:
        cell = rows.cells[line][column]
        if may_be_number(cell):
            # The rows that cannot be read may be those of the peak.
            raise RecordError(
                f"{path}, line {line}: {name} is {cell!r}, which looks like a number and cannot be read; write it "
                "without a unit and without thousands separators"
                + (" (--skip-invalid leaves out only rows without a number)" if table.skip_invalid else "")
            ) from None
        if table.skip_invalid:
            return None
        raise RecordError(f"{path}, line {line}: {name} is {cell!r}, it must be a number{cure}") from None
    if math.isfinite(value):
        return value
    if table.skip_invalid:
        return None
    raise RecordError(f"{path}, line {line}: {name} is {value}, it must be finite{cure}")


def decibels(db: bool, column: str) -> bool:
    """Whether intensities are decibels, by the option or the name of their column; refused if the two disagree."""
    if _DECIBELS.search(column):
        return True
    if db and _LINEAR.search(column):
        raise ConfigError(f"--db is given, and the column {column} names another unit; leave --db out, or rename it")
    return db


def unit_named(column: str) -> AngleUnit | None:
    """Unit in the name of a column, such as ``angle_mrad`` or ``Winkel [mrad]``; None if it names none, or two."""
    units = {_UNIT_OF_WORD[word] for word in re.findall(r"[^\W\d_]+|°", column.lower()) if word in _UNIT_OF_WORD}
    return units.pop() if len(units) == 1 else None


def unit_of(path: Path, unit: AngleUnit | None, column: str, angles: np.ndarray) -> AngleUnit:
    """Unit of the angles; if only their range can tell, a small range is not taken for degrees."""
    if unit is not None:
        return unit
    named = unit_named(column)
    small = angles.size > 2 and float(np.ptp(angles)) < _FEW
    question = f"the angles run from {angles.min():g} to {angles.max():g}: are these radians?" if small else ""
    if small and named is None:
        raise RecordError(f"{path}: {question} Say so: --unit rad, or --unit deg if they are degrees")
    if small and named == "deg":
        warn(path, f"{question} They are taken as degrees (--unit rad, --unit deg)")
    return named or "deg"


def averaged(
    path: Path, angles_deg: Float64[np.ndarray, " n"], values: Float64[np.ndarray, "n columns"]
) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, "angles columns"]]:
    """Angles in rising order without repeats, and the means of their rows; a warning says what was averaged.

    Refused where a search cannot use the angles.
    """
    order = np.argsort(angles_deg, kind="stable")
    angles_deg, values = angles_deg[order], values[order]
    first = np.flatnonzero(np.diff(angles_deg, prepend=-np.inf) >= MIN_STEP_DEG)
    require_angles(path, angles_deg[first].tolist())
    if first.size == angles_deg.size:
        return angles_deg, values
    counts = np.diff(first, append=angles_deg.size)
    warn(path, f"{counted(int((counts > 1).sum()), 'repeated angle')}; the intensities of each are averaged")
    return angles_deg[first], np.add.reduceat(values, first, axis=0) / counts[:, None]
