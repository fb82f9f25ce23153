"""Options of the commands that read a recording: what it does not say itself."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer
from msgspec.structs import replace

from markerseek.core import ConfigError
from markerseek.records.banks import ANGLE_FIELD, TableFormat

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank

AngleField: TypeAlias = Annotated[
    str | None, typer.Option(help=ANGLE_FIELD.text, show_default=ANGLE_FIELD.shown or True)
]


@dataclass(frozen=True, slots=True, kw_only=True)
class TypedTable:
    """What is typed of a recording otherwise than `TableFormat` holds it: in one word, by two options, in a file."""

    columns: Annotated[
        str | None,
        typer.Option(
            metavar="ANGLE,INTENSITY",
            help="Angle and intensity: names or numbers of a CSV's columns, names of an .npz's or .mat's variables; "
            "with --first-deg or --angles the intensity, or the frames, alone.",
            show_default="angle_deg,intensity",
        ),
    ] = None
    first_deg: Annotated[
        float | None, typer.Option(help="Angle of the first frame, where the recording has no angles.")
    ] = None
    step_deg: Annotated[float | None, typer.Option(help="Step from one of its angles to the next.")] = None
    angles: Annotated[
        Path | None, typer.Option(help="Text file with the angle of each frame in degrees, one a line.")
    ] = None
    axes: Annotated[
        str | None,
        typer.Option(help="Order of the axes of its frames.", show_default="angles,channels,samples"),
    ] = None
    without_channel: Annotated[
        list[int] | None,
        typer.Option(help="Channel that is left out, counted from 1; may be given several times."),
    ] = None

    def added_to(self, table: TableFormat) -> TableFormat:
        """Return the format with this; `ConfigError` if the options contradict one another."""
        from markerseek.records.banks import angles_in

        if (self.first_deg is None) != (self.step_deg is None):
            raise ConfigError("--first-deg and --step-deg go together; give both")

        named = None
        if self.columns is not None:
            parts = [part.strip() for part in self.columns.split(",")]
            if not all(parts) or len(parts) > 2:
                raise ConfigError(
                    f"--columns is {self.columns!r}, two names or numbers with a comma are needed: ANGLE,INTENSITY"
                )
            # Without the column of the angles, they are stated.
            named = (parts[0] if len(parts) == 2 else "", parts[-1])
        stepped = None if self.first_deg is None or self.step_deg is None else (self.first_deg, self.step_deg)
        return replace(
            table,
            columns=named,
            first_and_step_deg=stepped,
            angles_deg=None if self.angles is None else angles_in(self.angles),
            axes=None if self.axes is None else tuple(each.strip() for each in self.axes.split(",")),
            without_channels=tuple(self.without_channel or ()),
        )


def require_frames(bank: IntensityBank | FrameBank, path: Path, **given: object) -> None:
    """Refuse options for channel data, by their names, where a bank holds intensities only."""
    from markerseek.records.banks import FrameBank

    for name, value in given.items():
        if value is not None and not isinstance(bank, FrameBank):
            option = f"--{name.replace('_', '-')}"
            raise ConfigError(f"{option} is {value}, and {path} holds intensities, not channel data; leave it out")
