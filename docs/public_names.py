"""Writes what markerseek's packages offer into docs/reference/api.md: ``python docs/public_names.py``.

A test compares the page with the packages; the site adds the whole docstrings below each list.
"""

from __future__ import annotations

import inspect
import re
from importlib import import_module
from pathlib import Path

import markerseek

PAGE = Path(__file__).parent / "reference" / "api.md"

PACKAGES = (
    *("core", "search", "scan", "guard", "signals", "acoustics", "geometry", "rigs", "show", "studies"),
    "contract",
)

WITHOUT_DOCSTRING = {"__version__": "The version of this package."}


def names_of(package: str) -> list[str]:
    """Names that a package offers and `markerseek` itself does not."""
    return [name for name in import_module(f"markerseek.{package}").__all__ if name not in markerseek.__all__]


def first_sentence(name: str, thing: object) -> str:
    """First sentence of what documents a name."""
    paragraph = (WITHOUT_DOCSTRING.get(name) or inspect.getdoc(thing) or "").partition("\n\n")[0]
    return re.split(r"(?<=\.) ", " ".join(paragraph.split()))[0].replace("``", "`").replace("|", "\\|")


def markdown() -> str:
    """The table of the names of `markerseek`, and the lists of those of its packages."""
    lines = ["| name | what it is |", "|---|---|"]
    lines += [f"| `{name}` | {first_sentence(name, getattr(markerseek, name))} |" for name in markerseek.__all__]
    lines += ["", "<!-- details: markerseek -->"]
    for package in PACKAGES:
        front = import_module(f"markerseek.{package}")
        front_page = f"../../src/markerseek/{package}/__init__.py"
        summary = " ".join((front.__doc__ or "").partition("\n\n")[0].split()).replace("``", "`")
        names = ", ".join(f"`{name}`" for name in names_of(package))
        lines += ["", f"## markerseek.{package}", "", f"{summary} [Source]({front_page}).", "", names, ""]
        lines += [f"<!-- details: markerseek.{package} -->"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Replace all below the first table's head."""
    above = PAGE.read_text(encoding="utf-8").partition("| name |")[0]
    PAGE.write_text(above + markdown(), encoding="utf-8")


if __name__ == "__main__":
    main()
