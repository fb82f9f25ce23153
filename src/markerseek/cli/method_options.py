"""Options of the commands that search: the method, its form, and its number of acquisitions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, TypeAlias

import typer

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
Single: TypeAlias = Annotated[
    bool, typer.Option("--single", help="State that there is one source only: fewer acquisitions, none for others.")
]
Stay: TypeAlias = Annotated[bool, typer.Option("--stay", help="Do not turn to the marker at the end.")]
