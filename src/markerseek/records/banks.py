"""Scans of many angles, read from disk: a table of intensities, or a folder of acquisitions."""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from markerseek.core import Interval, RecordError

COLUMNS = ("angle_deg", "intensity")
"""Columns that a table of intensities must have, named in its first line."""

_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class Bank:
    """A scan of many angles.

    Attributes
    ----------
    angles_deg
        Angles in degrees, rising; at least 3.
    """

    angles_deg: tuple[float, ...]

    @property
    def range(self) -> Interval:
        """From the first angle to the last."""
        return Interval(low_deg=self.angles_deg[0], high_deg=self.angles_deg[-1])


@dataclass(frozen=True, slots=True, kw_only=True)
class IntensityBank(Bank):
    """One intensity for each angle.

    Attributes
    ----------
    intensities
        Peak of the photoacoustic image at each angle.
    """

    intensities: tuple[float, ...] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameBank(Bank):
    """One acquisition for each angle, left on disk until it is asked for.

    Attributes
    ----------
    folders
        Where the channel files of each are.
    """

    folders: tuple[Path, ...] = field(repr=False)


def read_bank(path: Path) -> IntensityBank | FrameBank:
    """Bank at a path: a CSV of ``angle_deg,intensity``, or a folder with one sub-folder of channel files per angle.

    Parameters
    ----------
    path
        File or folder. The name of a sub-folder holds its angle as its only number: ``-12.5``, ``angle_-12.5deg``.

    Raises
    ------
    RecordError
        If it is not there, or not as described; the message says where and what to do.
    """
    if path.is_dir():
        return _read_folders(path)
    if not path.exists():
        raise RecordError(f"{path}: there is no such file or folder")
    return _read_csv(path)


def write_bank(bank: IntensityBank, path: Path) -> None:
    """Write a bank as the CSV that `read_bank` reads, making its folder if need be; every digit is kept.

    Raises
    ------
    RecordError
        If the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("w", newline="", encoding="utf-8") as lines:
            writer = csv.writer(lines, lineterminator="\n")
            writer.writerow(COLUMNS)
            writer.writerows(zip(bank.angles_deg, bank.intensities, strict=True))
    except OSError as problem:
        raise RecordError(f"{path}: the bank cannot be written: {problem.strerror}; name another place") from problem


def _read_csv(path: Path) -> IntensityBank:
    try:
        with path.open(newline="", encoding="utf-8-sig") as lines:
            rows = list(csv.reader(lines, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as problem:
        raise RecordError(f"{path}: it cannot be read as a CSV of {','.join(COLUMNS)}: {problem}") from problem
    places = _columns(path, [name.strip() for name in rows[0]] if rows else [])
    angles: list[float] = []
    intensities: list[float] = []
    lines_of: list[int] = []
    for line, row in enumerate(rows[1:], start=2):
        if not any(cell.strip() for cell in row):
            continue
        angle, intensity = (_cell(path, line, row, name, place) for name, place in zip(COLUMNS, places, strict=True))
        if intensity < 0:
            raise RecordError(f"{path}, line {line}: intensity is {intensity}, it must not be negative")
        angles.append(angle)
        intensities.append(intensity)
        lines_of.append(line)
    _require_angles(path, len(angles))
    if angles[-1] < angles[0]:  # a scan from high to low
        angles, intensities, lines_of = angles[::-1], intensities[::-1], lines_of[::-1]
    for (low, high), line in zip(pairwise(angles), lines_of[1:], strict=True):
        if not low < high:
            raise RecordError(
                f"{path}, line {line}: the angle {high:g} deg is out of order beside {low:g} deg; "
                "sort the rows by angle_deg, and average repeated angles"
            )
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
        raise RecordError(f"{path}, line 1: the column {doubled[0]} stands there more than once; keep one of them")
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


def _read_folders(path: Path) -> FrameBank:
    folders = sorted(entry for entry in path.iterdir() if entry.is_dir() and not entry.name.startswith("."))
    by_angle: dict[float, Path] = {}
    for folder in folders:
        numbers = _NUMBER.findall(folder.name)
        if len(numbers) != 1:
            raise RecordError(
                f"{folder}: the name must hold the angle in degrees as its only number, as in 'angle_-12.5deg'; "
                f"it holds {len(numbers)}"
            )
        angle = float(numbers[0])
        if angle in by_angle:
            raise RecordError(f"{folder}: the angle {angle:g} deg was given before, by {by_angle[angle].name}")
        by_angle[angle] = folder
    _require_angles(path, len(by_angle))
    angles = sorted(by_angle)
    return FrameBank(angles_deg=tuple(angles), folders=tuple(by_angle[angle] for angle in angles))


def _require_angles(path: Path, count: int) -> None:
    if count < 3:
        raise RecordError(f"{path}: it holds {count} angles, at least 3 are needed for a search")
