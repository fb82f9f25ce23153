"""The elements of a probe in a file: they must be the straight, equally spaced row that the imaging needs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from markerseek.core import Float64, RecordError
from markerseek.records.banks.ipasc import fields
from markerseek.records.hdf5 import CheckedHdf5

TOLERANCE = 0.01
"""Largest distance of an element from its place in the row, in pitches."""


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
