"""The option ``--probe`` of the commands that image channel data."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer

ProbeName: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--probe",
        help="Preset of the imaging chain for channel data, or FILE.toml that describes your own probe.",
        show_default="that of the bank, else BPL9-5/55",
    ),
]
