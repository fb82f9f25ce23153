"""Options of the commands that read a CSV: which columns, and the unit of the angle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.records.banks import TableFormat

Columns: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="ANGLE,INTENSITY",
        help="Names or numbers of a CSV's columns of angle and intensity.",
        show_default="angle_deg,intensity",
    ),
]
Unit: TypeAlias = Annotated[
    Literal["deg", "mrad", "rad"] | None,
    typer.Option(help="Unit of a CSV's angles.", show_default="deg, unless the column is angle_mrad or angle_rad"),
]


def table_format(columns: str | None, unit: Literal["deg", "mrad", "rad"] | None) -> TableFormat:
    """Format of a CSV from the options of a command.

    Raises
    ------
    ConfigError
        If --columns does not name two columns.
    """
    from markerseek.records.banks import TableFormat

    if columns is None:
        return TableFormat(unit=unit)
    angle, comma, intensity = (part.strip() for part in columns.partition(","))
    if not comma or not angle or not intensity or "," in intensity:
        raise ConfigError(f"--columns is {columns!r}, two names or numbers with a comma are needed: ANGLE,INTENSITY")
    return TableFormat(columns=(angle, intensity), unit=unit)
