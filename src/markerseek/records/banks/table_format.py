"""What a person says of a recording that does not say it itself: columns, units, angles, axes, channels left out."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

from markerseek.core import ConfigError, Help
from markerseek.files import AngleUnit

AXES = ("angles", "channels", "samples")
"""Axes of the frames of a bank, in their order."""

ANGLE_FIELD = Help(
    "Field of a sequence (.igs.mha, .nrrd) with the angle of each frame in degrees, or a transform that turns with the "
    "probe.",
    shown="ProbeRotation, trus_angle_deg, angle_deg, or ProbeToProbeHome",
)
"""Help of an option that images of other kinds have too."""


class TableFormat(msgspec.Struct, frozen=True, kw_only=True):
    """What a recording does not say itself: its columns or variables, units, angles, axes, channels to be left out."""

    columns: tuple[str, str] | None = None
    """Names of the columns of angle and intensity, or their numbers, counted from 1; None: ``angle_deg`` (or
    ``angle_mrad``, ``angle_rad``) and ``intensity`` (or ``intensity_db``), or the two columns of a table without
    names. An empty first name: the angles are stated."""
    unit: Annotated[
        AngleUnit | None, Help("Unit of their angles.", shown="as the name of the column says, else deg")
    ] = None
    deg_per_unit: Annotated[
        float | None, Help("Degrees of one unit of their angles, such as a count or a step; may be negative.")
    ] = None
    offset_deg: Annotated[float, Help("Degrees that are added to each of their angles.")] = 0.0
    db: Annotated[
        bool, Help("The intensities are decibels, 20 log10 of the amplitude, also where no name says dB.")
    ] = False
    skip_invalid: Annotated[bool, Help("Leave rows out that hold no number, such as NaN.")] = False
    first_and_step_deg: tuple[float, float] | None = None
    """Angle of the first frame and step to the next, in degrees, of a recording without angles."""
    angles_deg: tuple[float, ...] | None = None
    """Angle of each frame in degrees, of such a recording."""
    axes: tuple[str, ...] | None = None
    """Order of the axes of the frames, a permutation of `AXES`; None: that of `AXES`, refused where axes of equal
    length leave it open."""
    first_frame: Annotated[
        int | None,
        Help(
            "Frame of a Vantage's receive buffer that has the first angle.",
            shown="the one behind Resource.RcvBuffer.lastFrame",
        ),
    ] = None
    without_channels: tuple[int, ...] = ()
    """Channels that are left out, counted from 1."""
    angle_field: Annotated[str | None, ANGLE_FIELD] = None

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


DEFAULT_FORMAT = TableFormat()
"""The format of the tables that we write."""
