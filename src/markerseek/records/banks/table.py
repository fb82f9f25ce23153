"""Reads and writes banks of intensities as CSV tables."""

from __future__ import annotations

import csv
import math
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from markerseek.core import MAX_INTENSITY, ConfigError, Float64, RecordError, counted
from markerseek.files import DECIMAL_COMMA, MIB, CsvRows, csv_rows, may_be_number, replace_file, unit_in
from markerseek.records.banks.bank import IntensityBank, first_of
from markerseek.records.banks.repeats import merged
from markerseek.records.banks.table_angles import angles_in_degrees, largest_angle, stated_deg
from markerseek.records.banks.table_format import DEFAULT_FORMAT, TableFormat
from markerseek.records.notes import note

_COLUMNS = ("angle_deg", "intensity")
"""Columns of the tables that we write."""

_DECIBELS = re.compile(r"(?:(?<![A-Za-z])(?i:db)|(?<=[a-z])dB)(?i:[mµμu]?[vw]|m|fs|u|c|pa)?(?![A-Za-z])|(?i:decibels?)")
"""A unit of decibels in the name of a column: ``intensity_db``, ``amplitude [dB]``, ``level_dBV``."""

_LINEAR = re.compile(r"(?<![A-Za-z])(?:[munkMµμ]?(?:V|W|J|Pa)|(?i:counts?|adc|lsb|linear|arb|a\.\s?u\.?))(?![A-Za-z])")
"""A unit other than decibels in the name of a column."""

_INTENSITY_WORDS = re.compile(
    r"(?i)(?<![a-z])(?:intensit(?:y|ies|ät)|amplitudes?|magnitude|envelope|signal|peak|pegel)"
)
"""A word for the intensity in the name of a column."""

_ENERGY = re.compile(r"(?:pulse|laser)?_?energy(?:_[munµμ]?j)?")
"""Name of a column with the energy of the pulses at each angle, in plain form."""

_LARGEST_BYTES = 64 * MIB


def write_bank(bank: IntensityBank, path: Path) -> None:
    """Write a bank as a CSV that `read_bank` reads, with every digit; its folder is made if missing."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part, part.open("w", newline="", encoding="utf-8") as lines:
            # Python's csv ends lines with CR LF by default, also on Linux.
            writer = csv.writer(lines, lineterminator="\n")
            writer.writerow(_COLUMNS)
            writer.writerows(zip(bank.angles_deg, bank.intensities, strict=True))
    except OSError as problem:
        raise RecordError(
            f"{path}: the bank cannot be written: {problem.strerror or problem}; name another place"
        ) from problem


def read_table(path: Path, table: TableFormat) -> IntensityBank:
    """Return the bank in a CSV; the rows may be in any order, and the intensities of a repeated angle are averaged.

    Columns are separated by commas, semicolons, tabs or spaces. The numbers themselves tell which sign separates
    decimals and which thousands. Intensities are divided by a column ``energy`` over its mean. A warning says what was
    averaged, left out, unwrapped or assumed.

    ``table``: which columns are read, their units, and what becomes of rows without numbers.
    """
    rows = csv_rows(
        path,
        most_bytes=_LARGEST_BYTES,
        what="a bank",
        cure=f"give a CSV of {','.join(_COLUMNS)}, an IPASC HDF5 file (.hdf5, .h5), or a folder of frames",
    )
    rows, names = _with_units(rows)
    columns = _columns(path, rows, names, table)
    energies = [names.index(name) for plain, name in _plain(names).items() if _ENERGY.fullmatch(plain)]
    columns = replace(columns, energy=next((each for each in energies if each not in columns.indices), None))
    db = decibels(table.db, names[columns.intensity] if names else "")
    cells = _numbers(path, rows, names, columns, table, db=db)
    kept = [line for line, row in cells.items() if None not in row]
    warn_skipped(path, "line", [str(line) for line in cells if line not in set(kept)])
    values = np.array([cells[line] for line in kept], dtype=np.float64).reshape(-1, len(columns.indices))
    column = dict(zip(columns.indices, values.T, strict=True))
    intensities = amplitudes(column[columns.intensity], db=db, where=lambda index: f"{path}, line {kept[index]}")
    if columns.energy is not None:
        energy = column[columns.energy]
        name = rows.names[columns.energy]
        for index in np.flatnonzero(energy <= 0)[:1]:
            raise RecordError(f"{path}, line {kept[index]}: {name} is {energy[index]:g}, it must be positive")
        note(path, f"the intensities are divided by {name} over its mean")
        intensities = intensities * energy.mean() / energy
    if columns.angle is None:
        # A row that is left out has its place in the scan.
        degrees = stated_deg(table, path, len(cells), what="rows")[np.isin(list(cells), kept)]
    else:
        degrees = angles_in_degrees(table, path, names[columns.angle] if names else "", column[columns.angle])
        if not names and table == DEFAULT_FORMAT and _counts(column[columns.angle]):
            note(
                path,
                "its first column counts in steps of 1, and is taken as degrees; if it only counts, state the angles: "
                "`columns=2` `first_and_step_deg=(-35, 0.5)`",
            )
    scan = merged(path, degrees, lambda: intensities)
    return IntensityBank(angles_deg=scan.angles_deg, intensities=tuple(scan.mean(intensities).tolist()))


def _numbers(
    path: Path, rows: CsvRows, names: Sequence[str], columns: _Columns, table: TableFormat, *, db: bool
) -> dict[int, list[float | None]]:
    """Return the numbers of each line in the columns that are read, as `_row`."""
    # A factor of 1000 is harmless in amplitudes, but not in decibels, which are below 1000.
    largest = {columns.intensity: 999.0 if db else None}
    if columns.angle is not None:
        largest[columns.angle] = largest_angle(table, path, names[columns.angle] if names else "")
    texts = rows.numbers(path, columns.indices, most=[largest.get(each) for each in columns.indices])
    return {line: _row(path, rows, line, columns, texts[line], table) for line in rows.cells}


@dataclass(frozen=True, slots=True, kw_only=True)
class _Columns:
    """Indices of the columns that are read; None: there is none."""

    angle: int | None
    intensity: int
    energy: int | None = None

    @property
    def indices(self) -> list[int]:
        """The columns that the table has."""
        return [each for each in (self.angle, self.intensity, self.energy) if each is not None]


def _counts(values: Float64[np.ndarray, " n"]) -> bool:
    """Return whether numbers count from 0 or 1."""
    return values.size > 0 and values[0] in (0, 1) and bool((np.diff(values) == 1).all())


def _with_units(rows: CsvRows) -> tuple[CsvRows, tuple[str, ...]]:
    """Return the rows of data, and the names of the columns with the units that a second line of the head holds."""
    line, cells = next(iter(rows.cells.items()), (0, []))
    units = [cell.strip().strip("[]()") for cell in cells]
    is_head = len(rows.names) == len(units) and not any(map(may_be_number, units)) and any(map(_is_unit, units))
    if not is_head:
        return rows, rows.names
    data = {number: row for number, row in rows.cells.items() if number != line}
    names = (f"{name} [{unit}]" if unit else name for name, unit in zip(rows.names, units, strict=True))
    return replace(rows, cells=data), tuple(names)


def _is_unit(cell: str) -> bool:
    """Return whether a whole cell is the unit of an angle or of an intensity."""
    unit = unit_in(f"[{cell}]").unit
    return unit is not None or any(each.fullmatch(cell) is not None for each in (_DECIBELS, _LINEAR))


def _plain(names: Sequence[str]) -> dict[str, str]:
    """Return the names of columns by their plain form: ``angle [mrad]`` is ``angle_mrad``."""
    return {"_".join(re.findall(r"[^\W_]+|°", name.lower())): name for name in reversed(names)}


def _columns(path: Path, rows: CsvRows, names: Sequence[str], table: TableFormat) -> _Columns:
    """Return the columns of angle and intensity; ``names``: with their units."""
    if table.columns is not None:
        angle_name, intensity_name = table.columns
        return _Columns(
            angle=_column_index(path, rows, angle_name) if angle_name else None,
            intensity=_column_index(path, rows, intensity_name),
        )
    if not names and rows.width == 2 and table.states_angles:
        raise ConfigError(
            f"{path}: its columns have no names, and the first may hold the angles; leave `first_and_step_deg` and "
            "`angles_deg` out, or name the intensities alone, `columns=2`"
        )
    if not names and rows.width == 1 and table.states_angles:
        return _Columns(angle=None, intensity=0)
    if not names and rows.width == 2:
        note(path, "its columns have no names; the first is taken as the angle, the second as the intensity")
        return _Columns(angle=0, intensity=1)
    angle = _angle_column(names)
    intensity = _intensity_column(names, angle, table)
    if angle is None and intensity is not None and table.states_angles:
        return _Columns(angle=None, intensity=intensity)
    if angle is not None and table.states_angles:
        raise ConfigError(
            f"{path}: its column {rows.names[angle]} has the angles; leave `first_and_step_deg` and `angles_deg` out"
        )
    if angle is None or intensity is None:
        lacking = [name for name, found in zip(_COLUMNS, (angle, intensity), strict=True) if found is None]
        missing = f"column {lacking[0]} is" if len(lacking) == 1 else f"columns {' and '.join(lacking)} are"
        raise RecordError(
            f"{path}, line 1: the {missing} missing, it has {_head(rows)}; name the columns of angle and intensity: "
            f"`columns=ANGLE,INTENSITY`{_perhaps(names, rows.names)}{_if_transposed(rows)}"
        )
    for index in (angle, intensity):
        _require_once(path, rows, rows.names[index])
    return _Columns(angle=angle, intensity=intensity)


def _angle_column(names: Sequence[str]) -> int | None:
    """Return the column of the angles: ``angle_deg`` and its like, else the only one that has a unit of angle."""
    named = [unit_in(name) for name in names]
    plain = _plain(names)
    usual = [
        names.index(name) for each, name in plain.items() if re.fullmatch(r"angle_[^_]+", each) and unit_in(name).unit
    ]
    found = usual or [index for index, each in enumerate(named) if each.unit or (each.is_angle and each.other)]
    return found[0] if usual or len(found) == 1 else None


def _intensity_column(names: Sequence[str], angle: int | None, table: TableFormat) -> int | None:
    """Return the column of the intensities: ``intensity`` and its like, else that beside the only other column."""
    plain = _plain(names)
    usual = ("intensity_db", "intensity") if table.db else ("intensity", "intensity_db")
    for each in usual:
        if each in plain:
            return names.index(plain[each])
    found = [index for index, name in enumerate(names) if re.match(r"intensity(?![a-z])", name.lower())]
    if len(found) == 1:
        return found[0]
    others = [
        index
        for plain_name, name in plain.items()
        # Programs write the numbers of the rows below no name.
        if plain_name and (index := names.index(name)) != angle and not _ENERGY.fullmatch(plain_name)
    ]
    says_so = any(each.search(names[others[0]]) for each in (_INTENSITY_WORDS, _DECIBELS, _LINEAR)) if others else False
    return others[0] if len(others) == 1 and (angle is not None or table.states_angles) and says_so else None


def _perhaps(names: Sequence[str], written: Sequence[str]) -> str:
    """Return a proposal for `columns` where the table has two columns, of which one may be the angle."""
    if len(names) != 2 or sum(map(len, written)) >= _MOST_QUOTED:
        return ""
    named = [unit_in(name) for name in names]
    # Only a person knows which of the two is the angle, unless a name says so.
    first = 1 if named[1].is_angle and not named[0].is_angle else 0
    scale = " with `deg_per_unit`" if named[first].other and not named[first].unit else ""
    # Quoted for the shell, because names have spaces.
    return f", here perhaps {shlex.quote(','.join((written[first], written[1 - first])))}{scale}"


def _if_transposed(rows: CsvRows) -> str:
    """Return a question for the message, if the table has two long rows."""
    long = rows.width > 2 and len(rows.cells) + bool(rows.names) == 2
    return (
        f"; or are its two rows angles and intensities? Then write one row for each of the {rows.width}" if long else ""
    )


def _column_index(path: Path, rows: CsvRows, column: str) -> int:
    """Return the index of one column by its name, or by its number if none has that name."""
    if column in rows.names:
        _require_once(path, rows, column)
        return rows.names.index(column)
    if column.isdecimal() and 1 <= int(column) <= rows.width:
        return int(column) - 1
    raise RecordError(f"{path}, line 1: there is no column {column}, it has {_head(rows)}")


def _require_once(path: Path, rows: CsvRows, column: str) -> None:
    if rows.names.count(column) > 1:
        raise RecordError(f"{path}, line 1: the column {column} appears more than once; keep one of them")


_MOST_QUOTED = 60
"""Most characters of the first line in a message: of a text it is a sentence, and names nothing."""


def _head(rows: CsvRows) -> str:
    """Return what a table's first line holds, for a message."""
    names = ", ".join(rows.names) or f"{rows.width} columns without names, which are numbered from 1"
    return names if len(names) <= _MOST_QUOTED else f"{names[:_MOST_QUOTED]}…"


def amplitudes(
    values: Float64[np.ndarray, " n"], *, db: bool, where: Callable[[int], str]
) -> Float64[np.ndarray, " n"]:
    """Return the finite intensities as amplitudes; others are refused.

    ``db``: whether they are in dB. ``where``: file and line of each, for the messages.
    """
    _refuse_overloads(values, where)
    if db:
        with np.errstate(over="ignore"):
            values = 10 ** (values / 20)
    for index in np.flatnonzero(values < 0)[:1]:
        raise RecordError(
            f"{where(index)}: intensity is {values[index]}, it must not be negative; are these dB, 20·log10 of the "
            "amplitude? Say so: `db`. Or was a background subtracted? Then leave it in"
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
        note(path, f"{len(names)} without a finite number left out (`skip_invalid`): {what} {first_of(names)}")


def _row(
    path: Path, rows: CsvRows, line: int, columns: _Columns, texts: Sequence[str], table: TableFormat
) -> list[float | None]:
    """Return the finite numbers of a row; None for a cell without one, if such rows are left out."""
    # A comma inside a number, in a table that commas separate, shifts all columns behind it.
    if len(rows.cells[line]) != rows.width:
        raise RecordError(
            f"{path}, line {line}: it has {len(rows.cells[line])} columns, {rows.width} are expected; {DECIMAL_COMMA}"
        )
    intensity = texts[columns.indices.index(columns.intensity)].strip()
    if not table.skip_invalid and _INFINITE.fullmatch(intensity):
        raise RecordError(f"{path}, line {line}: intensity is {intensity}, {_OVERLOADED}")
    return [_value(path, rows, line, column, text, table) for column, text in zip(columns.indices, texts, strict=True)]


def _value(path: Path, rows: CsvRows, line: int, column: int, text: str, table: TableFormat) -> float | None:
    """Return the finite number in a cell; None if there is none and such rows are left out."""
    name = rows.names[column] if rows.names else f"column {column + 1}"
    cure = "; leave that row out, or all such rows: `skip_invalid`"
    try:
        value = float(text)
    except ValueError:
        cell = rows.cells[line][column]
        if may_be_number(cell):
            # The rows that cannot be read may be those of the peak.
            raise RecordError(
                f"{path}, line {line}: {name} is {cell!r}, which looks like a number and cannot be read; write it "
                "without a unit and without thousands separators"
                + (" (`skip_invalid` leaves out only rows without a number)" if table.skip_invalid else "")
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
    """Return whether intensities are decibels, by the option or the name of their column.

    Refused if the two disagree.
    """
    if _DECIBELS.search(column):
        return True
    if db and _LINEAR.search(column):
        raise ConfigError(f"`db` is given, and the column {column} names another unit; leave `db` out, or rename it")
    return db
