"""The angles of a recording in degrees.

The unit of an angle is that of the option, else that in the name of its column or variable, else degrees. A name with a
unit that is none of angle is refused: counts become degrees by ``deg_per_unit`` and ``offset_deg``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from markerseek.core import Float64, RecordError
from markerseek.files import DEG_PER, MIB, is_number, read_text, unit_in
from markerseek.records.banks.bank import MAX_DEG
from markerseek.records.banks.table_format import TableFormat
from markerseek.records.notes import note

_FEW = 2.0
"""Range of angles below which their unit may be radians: 2 rad are 115 degrees."""

_DEG_DIGITS = 4
"""Decimals of an angle in degrees that was written in another unit."""


def stated_deg(table: TableFormat, path: Path, count: int, *, what: str) -> Float64[np.ndarray, " angles"]:
    """Return the stated angle of each acquisition in degrees; ``what`` they are, for the message."""
    if table.first_and_step_deg is not None:
        first_deg, step_deg = table.first_and_step_deg
        return first_deg + step_deg * np.arange(count, dtype=np.float64)
    angles_deg = table.angles_deg or ()
    if len(angles_deg) != count:
        raise RecordError(f"{path}: {len(angles_deg)} angles are given for {count} {what}; correct them")
    return np.array(angles_deg, dtype=np.float64)


def largest_angle(table: TableFormat, path: Path, name: str) -> float:
    """Return the largest magnitude of a number in a column of angles, which is a turn."""
    return (MAX_DEG + abs(table.offset_deg)) / abs(_scale(table, path, name))


def angles_in_degrees(
    table: TableFormat, path: Path, name: str, angles: Float64[np.ndarray, " n"]
) -> Float64[np.ndarray, " n"]:
    """Return the angles of a column or variable in degrees.

    The rounding of another unit is taken off, so that the same scan in degrees is searched in the same way. If only
    their range can tell the unit, a small range is not taken for degrees.
    """
    scale = _scale(table, path, name)
    finite = angles[np.isfinite(angles)]
    if table.unit is None and table.deg_per_unit is None and finite.size > 2 and float(np.ptp(finite)) < _FEW:
        question = f"the angles run from {finite.min():g} to {finite.max():g}: are these radians?"
        named = unit_in(name).unit
        if named is None:
            raise RecordError(f"{path}: {question} Say so: `unit=rad`, or `unit=deg` if they are degrees")
        if named == "deg":
            note(path, f"{question} They are taken as degrees (`unit=rad`, `unit=deg`)")
    degrees = angles if scale == 1 else np.round(angles * scale, _DEG_DIGITS)
    return degrees + table.offset_deg if table.offset_deg else degrees


def _scale(table: TableFormat, path: Path, name: str) -> float:
    """Return the degrees of one unit of a column or variable; refused if its name says another kind of unit."""
    if table.deg_per_unit is not None:
        return table.deg_per_unit
    if table.unit is not None:
        return DEG_PER[table.unit]
    cure = "say how many degrees one is, `deg_per_unit`, and where the probe is at 0, `offset_deg`; or `unit`"
    return deg_per_unit_of(path, name, cure=cure)


def deg_per_unit_of(path: Path, name: str, *, cure: str) -> float:
    """Return the degrees of one unit of the numbers below a name; refused if it names another unit than one of angle.

    ``cure``: advice, which the units that are known follow.
    """
    named = unit_in(name)
    if named.other:
        raise RecordError(
            f"{path}: the angles are in {name!r}, and {named.other!r} is no unit of an angle; {cure} "
            f"{', '.join(DEG_PER)}"
        )
    return DEG_PER[named.unit or "deg"]


def angles_in(path: Path) -> tuple[float, ...]:
    """Return the angles in degrees of a text file with one on each line, below a name or not.

    `RecordError` if it is none.
    """
    cure = "write one angle in degrees on each line"
    text = read_text(path, most_bytes=MIB, what="a list of angles", cure=cure, also=("cp1252",))
    # A comma can only be the sign of the decimals.
    texts = [line.strip().replace(",", ".").replace("\u2212", "-") for line in text.split("\n") if line.strip()]
    try:
        named = texts[:1] if texts and not is_number(texts[0]) else []
        scale = deg_per_unit_of(path, "".join(named), cure="write them in degrees, or in one of")
        angles = [float(text) for text in texts[len(named) :]]
        return tuple(each if scale == 1 else round(each * scale, _DEG_DIGITS) for each in angles)
    except ValueError as problem:
        raise RecordError(f"{path}: {problem}; {cure}") from problem
