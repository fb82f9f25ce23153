"""Points for a registration: a CSV of their coordinates, and the markers of searches."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from markerseek.core import MarkerPosition, RecordError, SearchError
from markerseek.files import MIB, open_input, read_input
from markerseek.records import SearchResult
from markerseek.records.journal import is_journal, read_journal, result_of

COLUMNS: dict[str, tuple[str, ...]] = {
    "trus_m": ("trus_x_m", "trus_y_m", "trus_z_m"),
    "camera_m": ("camera_x_m", "camera_y_m", "camera_z_m"),
    "pixels": ("left_x_px", "left_y_px", "right_x_px", "right_y_px"),
    "trus_sigma_m": ("trus_sigma_x_m", "trus_sigma_y_m", "trus_sigma_z_m"),
    "camera_sigma_m": ("camera_sigma_x_m", "camera_sigma_y_m", "camera_sigma_z_m"),
    "spot_sigma_px": ("spot_sigma_px",),
}
"""Columns of a table of points by what they hold: all of a kind or none."""

_LARGEST_BYTES = 8 * MIB

_MOST = 1e6
"""Largest magnitude of a number in the table, in metres or pixels."""

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PointRow:
    """One row of a table of points; None where the table lacks those columns.

    Attributes
    ----------
    name
        From the column ``name``, or the number of the row.
    trus_m, camera_m
        The point in the two frames, in metres.
    pixels
        The spot in both cameras, (left x, left y, right x, right y), in pixels.
    trus_sigma_m, camera_sigma_m
        Standard deviations of the coordinates, in metres.
    spot_sigma_px
        Standard deviation of the pixels, that of the calibration apart.
    """

    name: str
    trus_m: tuple[float, ...] | None
    camera_m: tuple[float, ...] | None
    pixels: tuple[float, ...] | None
    trus_sigma_m: tuple[float, ...] | None
    camera_sigma_m: tuple[float, ...] | None
    spot_sigma_px: tuple[float, ...] | None


def read_points(path: Path) -> list[PointRow]:
    """Rows of a CSV with the columns of `COLUMNS` and ``name``; others are ignored, unless their name contains sigma.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordError
        If it cannot be read, or a number in it cannot be used; the message names the line and the cure.
    """
    try:
        with (
            open_input(path, most_bytes=_LARGEST_BYTES) as file,
            # Excel writes a byte order mark, which would become part of the first column's name.
            io.TextIOWrapper(file, newline="", encoding="utf-8-sig") as lines,
        ):
            return _rows(path, csv.reader(lines, strict=True))
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be read: {problem.strerror or problem}; check the name") from problem
    except (UnicodeDecodeError, csv.Error) as problem:
        raise RecordError(
            f"{path}: it cannot be read as a CSV of points: {problem}; its first line names the columns "
            f"{', '.join(COLUMNS['trus_m'] + COLUMNS['camera_m'])}"
        ) from problem


def _rows(path: Path, lines: Iterator[list[str]]) -> list[PointRow]:
    heading = [name.strip() for name in next(lines, [])]
    if not heading:
        raise RecordError(f"{path}: it is empty; its first line must name the columns, as in examples/points.csv")
    doubled = next((name for name in heading if heading.count(name) > 1), None)
    if doubled is not None:
        raise RecordError(f"{path}, line 1: the column {doubled} appears more than once; keep one of them")
    _require_known_sigmas(path, heading)
    present = {kind: names for kind, names in COLUMNS.items() if _present(path, heading, names)}
    rows: list[PointRow] = []
    for line, cells in enumerate(lines, start=2):
        # Spreadsheets append empty rows.
        if not any(cell.strip() for cell in cells):
            continue
        row = dict(zip(heading, cells, strict=False))
        numbers: dict[str, tuple[float, ...] | None] = dict.fromkeys(COLUMNS)
        for kind, names in present.items():
            numbers[kind] = tuple(
                _number(f"{path}, line {line}", name, row.get(name, "").strip(), positive="sigma" in kind)
                for name in names
            )
        rows.append(PointRow(name=row.get("name", "").strip() or str(len(rows) + 1), **numbers))
    return rows


def _require_known_sigmas(path: Path, heading: Sequence[str]) -> None:
    """Refuse a misspelt standard deviation: without it all points would count alike, and nobody would be told."""
    known = [name for names in COLUMNS.values() for name in names if "sigma" in name]
    unknown = next((name for name in heading if "sigma" in name.casefold() and name not in known), None)
    if unknown is not None:
        raise RecordError(
            f"{path}, line 1: the column {unknown} is unknown; name a standard deviation {', '.join(known[:-1])} or "
            f"{known[-1]}, or leave it out"
        )


def _present(path: Path, heading: Sequence[str], names: Sequence[str]) -> bool:
    """Whether the columns are there: all or none."""
    missing = [name for name in names if name not in heading]
    if missing and len(missing) < len(names):
        those = f"column {missing[0]} is" if len(missing) == 1 else f"columns {' and '.join(missing)} are"
        raise RecordError(f"{path}, line 1: the {those} missing beside the others of the same kind")
    return not missing


def _number(where: str, name: str, text: str, *, positive: bool) -> float:
    try:
        value = float(text)
    except ValueError:
        raise RecordError(f"{where}: {name} is {text!r}, it must be a number") from None
    if not math.isfinite(value):
        raise RecordError(f"{where}: {name} is {value}, it must be finite; leave that point out")
    # Squares of larger numbers overflow; millimetres for metres are refused later, with their own sentence.
    if not abs(value) <= _MOST:
        raise RecordError(f"{where}: {name} is {value}, it must lie within ± {_MOST:g}; check the unit")
    if positive and not value > 0:
        raise RecordError(f"{where}: {name} is {value}, a standard deviation must be above 0")
    return value


def read_marker(path: Path) -> MarkerPosition:
    """Position of the marker in the TRUS frame, from a search's result.

    Parameters
    ----------
    path
        Journal of the search, or its result as JSON.

    Raises
    ------
    RecordError
        If the file cannot be read, or its search gave no position; the message says why.
    """
    try:
        result = result_of(read_journal(path, frames=False))[1] if is_journal(path) else _json_result(path)
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be read: {problem.strerror}") from problem
    except SearchError as problem:
        raise RecordError(f"{path}: {problem}") from problem
    if not result.found:
        raise RecordError(
            f"{path}: its search found no marker ({result.answer}: {result.reason}); search again, or leave it out"
        )
    if result.marker_trus_m is None or result.marker_sigma_m is None:
        raise RecordError(
            f"{path}: the marker's position is not known, because the rig's face radius is not, or its data are "
            "intensities only; calibrate with 'markerseek bank scan point.hdf5 --rig RIG.toml' and 'markerseek "
            "calibrate point.hdf5', put face_radius_m into [probe] of the rig file, and search again"
        )
    return MarkerPosition(position_m=result.marker_trus_m, sigma_m=result.marker_sigma_m)


def _json_result(path: Path) -> SearchResult:
    try:
        return msgspec.json.decode(read_input(path, most_bytes=_LARGEST_BYTES), type=SearchResult)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as problem:
        raise RecordError(
            f"{path}: it is neither a journal nor the result of a search as JSON: {problem}; make one with 'markerseek "
            "search --json > result.json'"
        ) from problem
