"""Writes what markerseek's packages offer into docs/reference/api.md: ``python docs/public_names.py``.

A test compares the page with the packages; the site adds the whole docstrings below each table.
"""

from __future__ import annotations

import inspect
import re
from functools import cache
from importlib import import_module
from pathlib import Path
from types import FunctionType

from sphinx.pycode import ModuleAnalyzer

import markerseek
from markerseek.core import shapes

PAGE = Path(__file__).parent / "reference" / "api.md"

PACKAGES = (
    *("core", "search", "scan", "guard", "signals", "acoustics", "geometry", "rigs", "show", "studies"),
    "contract",
)

WITHOUT_DOCSTRING = {
    "__version__": "The version of this package.",
    # In tests these are classes of jaxtyping.
    **dict.fromkeys(set(shapes.__all__) - {"CHECKED"}, "Array of this type; its shape stands in the brackets."),
}


def names_of(package: str) -> list[str]:
    """Names that a package offers and `markerseek` itself does not."""
    return [name for name in import_module(f"markerseek.{package}").__all__ if name not in markerseek.__all__]


def meaning_of(package: str, name: str) -> str:
    """Return what stands below a constant or an alias, wherever in the package it is defined."""
    return _meanings(package).get(name, "")


@cache
def _meanings(package: str) -> dict[str, str]:
    """Return what stands below each constant of a package, also in files that nothing has imported yet."""
    folder = Path(import_module(package).__file__ or "").parent
    found: dict[str, str] = {}
    for path in sorted(folder.rglob("*.py")):
        for (owner, name), lines in ModuleAnalyzer.for_file(path, path.stem).find_attr_docs().items():
            if not owner:
                found.setdefault(name, " ".join(lines).strip())
    return found


def first_sentence(package: str, name: str) -> str:
    """Return the first sentence of what documents a name of a package."""
    thing = getattr(import_module(package), name)
    is_documented = isinstance(thing, type | FunctionType)
    text = WITHOUT_DOCSTRING.get(name) or (inspect.getdoc(thing) if is_documented else meaning_of(package, name)) or ""
    paragraph = text.partition("\n\n")[0]
    return re.split(r"(?<=\.) ", " ".join(paragraph.split()))[0].replace("``", "`").replace("|", "\\|")


def table_of(package: str, names: list[str]) -> list[str]:
    """Return the lines of a table of names, each with its first sentence."""
    rows = [f"| `{name}` | {first_sentence(package, name)} |" for name in names]
    return ["| name | what it is |", "|---|---|", *rows]


def markdown() -> str:
    """The tables of the names of `markerseek` and of its packages."""
    lines = [*table_of("markerseek", markerseek.__all__), "", "<!-- details: markerseek -->"]
    for package in PACKAGES:
        front = import_module(f"markerseek.{package}")
        front_page = f"../../src/markerseek/{package}/__init__.py"
        summary = " ".join((front.__doc__ or "").partition("\n\n")[0].split()).replace("``", "`")
        names = table_of(f"markerseek.{package}", names_of(package))
        lines += ["", f"## markerseek.{package}", "", f"{summary} [Source]({front_page}).", "", *names, ""]
        lines += [f"<!-- details: markerseek.{package} -->"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Replace all below the first table's head."""
    above = PAGE.read_text(encoding="utf-8").partition("| name |")[0]
    PAGE.write_text(above + markdown(), encoding="utf-8")


if __name__ == "__main__":
    main()
