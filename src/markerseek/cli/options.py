"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from markerseek.core import ConfigError, Tolerance

if TYPE_CHECKING:
    from markerseek.records.banks import FrameBank, IntensityBank, TableFormat

AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")]
Out: TypeAlias = Annotated[
    Path | None, typer.Option(help="Folder for the picture, with --plot.", show_default="the current one")
]
RigFile: TypeAlias = Annotated[
    Path | None, typer.Option(help="Rig file (TOML); without one, the simulated rig with its defaults.")
]
Arm: TypeAlias = Annotated[
    bool, typer.Option("--arm", help="Arm a rig of devices without being asked; not needed for a simulated rig.")
]
ProbeName: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--probe",
        help="Preset of the imaging chain for channel data, or FILE.toml that describes your own probe.",
        show_default="that of the bank, else BPL9-5/55",
    ),
]

# A copy of `markerseek.search.METHODS`, compared by a test: importing that package would slow down every --help.
USUAL_ACQUISITIONS = {
    "posterior": 16,
    "weighted-average": 57,
    "golden-section": 28,
    "golden-section-reuse": 16,
    "ternary": 28,
    "exhaustive": 141,
    "manual": 28,
}
"""Most acquisitions of each method, where the user names no number."""


def _completed(incomplete: str) -> Iterator[str]:
    """Names of methods for the shell."""
    return (name for name in USUAL_ACQUISITIONS if name.startswith(incomplete))


MethodName: TypeAlias = Annotated[
    str,
    typer.Option("--method", help="How to search; an unknown name lists them all.", autocompletion=_completed),
]
Acquisitions: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--acquisitions",
        min=2,
        help="Most acquisitions.",
        show_default=", ".join(f"{name} {number}" for name, number in USUAL_ACQUISITIONS.items()),
    ),
]
AsPublished: TypeAlias = Annotated[
    bool, typer.Option("--as-published", help="The paper's form of the method, which always answers.")
]
Others: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--others",
        help="Probability that another source as loud is there as well, before the search; less takes fewer "
        "acquisitions.",
        show_default="0.05",
    ),
]
Single: TypeAlias = Annotated[
    bool, typer.Option("--single", help="State that there is one source only, as --others 0 does.")
]
ToleranceMm: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--tolerance-mm",
        help="How well the angle of a marker that is found must be known: 95 % within this at the marker.",
        show_default="1",
    ),
]
ToleranceDeg: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--tolerance-deg",
        help="The same in degrees, where the marker's distance from the axis is not known.",
        show_default="1",
    ),
]
SweepOption: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--sweep",
        help="Turn the probe while the laser fires, one frame a pulse: an answer in seconds (posterior only).",
    ),
]
Stay: TypeAlias = Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")]

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


def others_of(others: float | None, *, single: bool) -> float | None:
    """Prior probability of another source from the options of a command; `ConfigError` if both say it differently."""
    if not single:
        return others
    if others:
        raise ConfigError(f"--others is {others:g}, and --single states that it is 0; leave one of them out")
    return 0.0


def tolerance_of(mm: float | None, deg: float | None) -> Tolerance:
    """Tolerance from the options of a command; `ConfigError` if one is not positive."""
    usual = Tolerance()
    return Tolerance(mm=usual.mm if mm is None else mm, deg=usual.deg if deg is None else deg)


def table_format(columns: str | None, unit: Literal["deg", "mrad", "rad"] | None) -> TableFormat:
    """Format of a CSV from the options of a command."""
    from markerseek.records.banks import TableFormat

    if columns is None:
        return TableFormat(unit=unit)
    angle, comma, intensity = (part.strip() for part in columns.partition(","))
    if not comma or not angle or not intensity or "," in intensity:
        raise ConfigError(f"--columns is {columns!r}, two names or numbers with a comma are needed: ANGLE,INTENSITY")
    return TableFormat(columns=(angle, intensity), unit=unit)


def require_frames(bank: IntensityBank | FrameBank, path: Path, **given: object) -> None:
    """Refuse options for channel data, by their names, where a bank holds intensities only."""
    from markerseek.records.banks import FrameBank

    for name, value in given.items():
        if value is not None and not isinstance(bank, FrameBank):
            option = f"--{name.replace('_', '-')}"
            raise ConfigError(f"{option} is {value}, and {path} holds intensities, not channel data; leave it out")
