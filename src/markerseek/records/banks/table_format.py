"""What a person says of a recording that does not say it itself: columns, units, angles, axes, channels left out.

The unit of an angle is that of the option, else that in the name of its column or variable, else degrees. A name with a
unit that is none of angle is refused: counts become degrees by ``deg_per_unit`` and ``offset_deg``.
"""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np

from markerseek.core import ConfigError, Float64, RecordError
from markerseek.files import DEG_PER, MIB, AngleUnit, is_number, read_text, unit_in
from markerseek.records.banks.bank import AXES, MAX_DEG
from markerseek.records.notes import note

_FEW = 2.0
"""Range of angles below which their unit may be radians: 2 rad are 115 degrees."""

_DEG_DIGITS = 4
"""Decimals of an angle in degrees that was written in another unit."""


class TableFormat(msgspec.Struct, frozen=True, kw_only=True):
    """What a recording does not say itself: its columns or variables, units, angles, axes, channels to be left out."""

    columns: tuple[str, str] | None = None
    """Names of the columns of angle and intensity, or their numbers, counted from 1; None: ``angle_deg`` (or
    ``angle_mrad``, ``angle_rad``) and ``intensity`` (or ``intensity_db``), or the two columns of a table without
    names. An empty first name: the angles are stated."""
    unit: AngleUnit | None = None
    """None: as the name of the column says, else degrees; a name with a unit that is none of angle is refused."""
    deg_per_unit: float | None = None
    """Degrees of one unit of the angles, of counts of an encoder or steps of a motor; negative: they count the other
    way."""
    offset_deg: float = 0.0
    """Degrees that are added to each angle: the angle of the probe where the reading is 0."""
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
        if self.columns is not None and (not self.columns[1] or self.columns[0] == self.columns[1]):
            raise ConfigError(
                f"columns is {','.join(self.columns)}, two different names or numbers are needed: ANGLE,INTENSITY"
            )
        if self.columns is not None and bool(self.columns[0]) == self.states_angles:
            raise ConfigError(
                f"`columns` is {','.join(filter(None, self.columns))!r}: ANGLE,INTENSITY are needed, or INTENSITY "
                "alone with `first_and_step_deg`, or with `angles_deg`"
            )
        if self.deg_per_unit is not None and not 0 < abs(self.deg_per_unit) < math.inf:
            raise ConfigError(f"`deg_per_unit` is {self.deg_per_unit:g}: a finite number is needed, and not 0")
        if self.deg_per_unit is not None and self.unit is not None:
            raise ConfigError(
                f"`unit={self.unit}` and `deg_per_unit={self.deg_per_unit:g}` both say what a unit is; leave one out"
            )
        if not math.isfinite(self.offset_deg):
            raise ConfigError(f"`offset_deg` is {self.offset_deg:g}: a finite number of degrees is needed")
        if self.first_and_step_deg is not None and self.angles_deg is not None:
            raise ConfigError("`angles_deg` and `first_and_step_deg` both give the angles; leave one out")
        if self.first_and_step_deg is not None:
            first_deg, step_deg = self.first_and_step_deg
            if not (math.isfinite(first_deg) and 0 < abs(step_deg) < math.inf):
                raise ConfigError(
                    f"`first_and_step_deg=({first_deg:g}, {step_deg:g})`: finite numbers are needed, a step not 0"
                )
        if self.axes is not None and sorted(self.axes) != sorted(AXES):
            raise ConfigError(f"`axes` is {','.join(self.axes)!r}; write the three in their order: {','.join(AXES)}")

    @property
    def states_angles(self) -> bool:
        """Whether a person states the angles of the acquisitions."""
        return self.first_and_step_deg is not None or self.angles_deg is not None

    def stated_deg(self, path: Path, count: int, *, what: str) -> Float64[np.ndarray, " angles"]:
        """Return the stated angle of each acquisition in degrees; ``what`` they are, for the message."""
        if self.first_and_step_deg is not None:
            first_deg, step_deg = self.first_and_step_deg
            return first_deg + step_deg * np.arange(count, dtype=np.float64)
        angles_deg = self.angles_deg or ()
        if len(angles_deg) != count:
            raise RecordError(f"{path}: {len(angles_deg)} angles are given for {count} {what}; correct them")
        return np.array(angles_deg, dtype=np.float64)

    def largest(self, path: Path, name: str) -> float:
        """Return the largest magnitude of a number in a column of angles, which is a turn."""
        return (MAX_DEG + abs(self.offset_deg)) / abs(self._scale(path, name))

    def degrees(self, path: Path, name: str, angles: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
        """Return the angles of a column or variable in degrees.

        The rounding of another unit is taken off, so that the same scan in degrees is searched in the same way. If only
        their range can tell the unit, a small range is not taken for degrees.
        """
        scale = self._scale(path, name)
        finite = angles[np.isfinite(angles)]
        if self.unit is None and self.deg_per_unit is None and finite.size > 2 and float(np.ptp(finite)) < _FEW:
            question = f"the angles run from {finite.min():g} to {finite.max():g}: are these radians?"
            named = unit_in(name).unit
            if named is None:
                raise RecordError(f"{path}: {question} Say so: `unit=rad`, or `unit=deg` if they are degrees")
            if named == "deg":
                note(path, f"{question} They are taken as degrees (`unit=rad`, `unit=deg`)")
        degrees = angles if scale == 1 else np.round(angles * scale, _DEG_DIGITS)
        return degrees + self.offset_deg if self.offset_deg else degrees

    def _scale(self, path: Path, name: str) -> float:
        """Return the degrees of one unit of a column or variable; refused if its name says another kind of unit."""
        if self.deg_per_unit is not None:
            return self.deg_per_unit
        if self.unit is not None:
            return DEG_PER[self.unit]
        cure = "say how many degrees one is, `deg_per_unit`, and where the probe is at 0, `offset_deg`; or `unit`"
        return deg_per_unit_of(path, name, cure=cure)


DEFAULT_FORMAT = TableFormat()
"""The format of the tables that we write."""


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
