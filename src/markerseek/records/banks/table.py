"""Reads and writes banks of intensities as CSV tables with the columns ``angle_deg,intensity``."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

from markerseek.core import MOST_INTENSITY, RecordError
from markerseek.files import MIB, new_file, open_input, replace_file
from markerseek.records.banks.bank import IntensityBank, require_angles
from markerseek.records.untrusted_arrays import ARRAY_SUFFIXES

COLUMNS = ("angle_deg", "intensity")
"""Columns that a table of intensities must have, named in its first line."""

_LARGEST_BYTES = 64 * MIB


def write_bank(bank: IntensityBank, path: Path) -> None:
    """Write a bank as a CSV that `read_bank` reads, with every digit; its folder is made if missing.

    Raises
    ------
    RecordError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replace_file(path) as part, part.open("w", newline="", encoding="utf-8") as lines:
            # Python's csv ends lines with CR LF by default, also on Linux.
            writer = csv.writer(lines, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(zip(bank.angles_deg, bank.intensities, strict=True))
    except OSError as problem:
        raise RecordError(f"{path}: the bank cannot be written: {problem.strerror}; name another place") from problem


def write_intensities(path: Path, *, angles_deg: Sequence[float], intensities: Sequence[float]) -> None:
    """Write intensities over angles in degrees as a new CSV; `RecordError` if it cannot be written."""
    with new_file(path) as part:
        write_bank(IntensityBank(angles_deg=tuple(angles_deg), intensities=tuple(intensities)), part)


def read_table(path: Path) -> IntensityBank:
    """Bank in a CSV of ``angle_deg,intensity``; other columns are ignored.

    Raises
    ------
    RecordError
        If it cannot be read; the message names the line and the cure.
    """
    if path.suffix.lower() in ARRAY_SUFFIXES:
        raise RecordError(
            f"{path}: a scan that NumPy or MATLAB saved becomes a bank by 'markerseek bank import {path} scan.hdf5'"
        )
    try:
        with (
            open_input(path, most_bytes=_LARGEST_BYTES) as file,
            # Excel writes a byte order mark, which would become part of the first column's name.
            io.TextIOWrapper(file, newline="", encoding="utf-8-sig") as lines,
        ):
            return _bank_of(path, csv.reader(lines, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise RecordError(
            f"{path}: it cannot be read as a CSV of {','.join(COLUMNS)}: {problem}; a bank is such a table, an IPASC "
            "HDF5 file (.hdf5, .h5), or a folder with one frame per angle"
        ) from problem


def _bank_of(path: Path, rows: Iterator[list[str]]) -> IntensityBank:
    places = _columns(path, [name.strip() for name in next(rows, [])])
    angles: list[float] = []
    intensities: list[float] = []
    lines_of: list[int] = []
    for line, row in enumerate(rows, start=2):
        # Spreadsheets append empty rows.
        if not any(cell.strip() for cell in row):
            continue
        angle, intensity = (_cell(path, line, row, name, place) for name, place in zip(COLUMNS, places, strict=True))
        if intensity < 0:
            raise RecordError(f"{path}, line {line}: intensity is {intensity}, it must not be negative")
        # Larger numbers overflow when the methods square them.
        if intensity > MOST_INTENSITY:
            raise RecordError(
                f"{path}, line {line}: intensity is {intensity}, it must be at most "
                f"{MOST_INTENSITY:g}; scale the column"
            )
        angles.append(angle)
        intensities.append(intensity)
        lines_of.append(line)
    if angles and angles[-1] < angles[0]:  # a scan from high to low
        angles, intensities, lines_of = angles[::-1], intensities[::-1], lines_of[::-1]
    for (low, high), line in zip(pairwise(angles), lines_of[1:], strict=True):
        if not low < high:
            raise RecordError(
                f"{path}, line {line}: the angle {high:g} deg is out of order beside {low:g} deg; "
                "sort the rows by angle_deg, and average repeated angles"
            )
    require_angles(path, angles)
    return IntensityBank(angles_deg=tuple(angles), intensities=tuple(intensities))


def _columns(path: Path, names: list[str]) -> list[int]:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise RecordError(
            f"{path}, line 1: the column {' and '.join(missing)} is missing, it has {', '.join(names) or 'nothing'}; "
            f"the first line must read {','.join(COLUMNS)}, with commas"
        )
    doubled = [name for name in COLUMNS if names.count(name) > 1]
    if doubled:
        raise RecordError(f"{path}, line 1: the column {doubled[0]} appears more than once; keep one of them")
    return [names.index(name) for name in COLUMNS]


def _cell(path: Path, line: int, row: list[str], name: str, place: int) -> float:
    if place >= len(row):
        raise RecordError(f"{path}, line {line}: it has {len(row)} columns, {name} is column {place + 1}")
    try:
        value = float(row[place])
    except ValueError:
        raise RecordError(f"{path}, line {line}: {name} is {row[place]!r}, it must be a number") from None
    if not math.isfinite(value):
        raise RecordError(f"{path}, line {line}: {name} is {value}, it must be finite; leave that row out")
    return value
