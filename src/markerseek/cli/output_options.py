"""Options of the commands that print JSON or write a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

AsJson: TypeAlias = Annotated[bool, typer.Option("--json", help="Print one JSON object for programs.")]
Out: TypeAlias = Annotated[
    Path | None, typer.Option(help="Folder for the picture, with --plot.", show_default="the current one")
]
