"""Fills in what pages take from elsewhere: ``python docs/made.py``.

A page marks such a text ``<!-- made: NAME -->text<!-- end -->``, which a forge shows as the text. The name is one of
`MADE`, or a value of a table in docs/data: ``FILE.csv :: ROW :: COLUMN``, with the row's first column. A block of code
below ``<!-- FILE -->`` or ``<!-- FILE: NAME -->`` is that file, or that class or function of it. A test compares.
"""

from __future__ import annotations

import ast
import csv
import re
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from textwrap import dedent
from typing import Any

DOCS = Path(__file__).parent
ROOT = DOCS.parent
MARKED = re.compile(r"(<!-- made: (.+?) -->)(.*?)(<!-- end -->)", re.DOTALL)
"""A text that is made: what stands before it, its name, the text, and what stands behind it."""

SHOWN = re.compile(r"(<!-- ([^\s:]+)(?:: (\S+))? -->\n```\w*\n)(.*?)(\n```)", re.DOTALL)
"""A file on a page: what stands before it, its path, a name in it, its text there, and what stands behind it."""


def _of_commands() -> str:
    import typer
    from typer.cli import get_docs_for_click

    from markerseek.cli.app import all_commands

    command = all_commands()
    text = get_docs_for_click(obj=command, ctx=typer.Context(command, info_name="markerseek"), name="markerseek")
    # Headings of commands stand under a heading of the page; what is shown of their use is no session.
    text = re.sub(r"^#(#+) `(.+)`$", r"##\1 \2", text.removeprefix("# `markerseek`"), flags=re.MULTILINE)
    text = text.replace("```console\n$ ", "```text\n")
    return f"\n{text.strip()}\n"


def _of_settings(name: str) -> Callable[[], str]:
    def made() -> str:
        import settings_tables

        return f"\n{getattr(settings_tables, name)().strip()}\n"

    return made


def _of_seeds() -> str:
    sys.path.insert(0, str(DOCS / "validation"))
    import measure_seeds

    return f"\n{measure_seeds.table()}\n"


MADE: dict[str, Callable[[], str]] = {
    "commands": _of_commands,
    "bench rig": _of_settings("bench_rig"),
    "simulated rig": _of_settings("simulated_rig"),
    "study": _of_settings("study"),
    "registration seeds": _of_seeds,
}
"""Texts by their names."""


@cache
def _rows(file: str) -> dict[str, dict[str, str]]:
    """Return the rows of a table in docs/data by their first column."""
    with (DOCS / "data" / file).open(encoding="utf-8", newline="") as table:
        reader = csv.DictReader(table)
        first = (reader.fieldnames or [""])[0]
        return {row[first]: row for row in reader}


def text_of(name: str) -> str:
    """Return the text of a name; `KeyError` where there is none."""
    if name in MADE:
        return MADE[name]()
    file, row, column = name.split(" :: ")
    return _rows(file)[row][column]


def shown_part(path: Path, name: str) -> str:
    """Return the text of a file, or of a class or function in it, which is named with its class."""
    lines = path.read_text(encoding="utf-8").rstrip().splitlines()
    node: Any = ast.parse("\n".join(lines)) if name else None
    for word in filter(None, name.split(".")):
        node = next(each for each in node.body if getattr(each, "name", None) == word)
    return "\n".join(lines) if node is None else dedent("\n".join(lines[node.lineno - 1 : node.end_lineno]))


def filled(text: str) -> str:
    """Return a page with its made texts, and the files that it shows, as they are now."""
    text = MARKED.sub(lambda found: found[1] + text_of(found[2]) + found[4], text)
    return SHOWN.sub(lambda found: found[1] + shown_part(ROOT / found[2], found[3] or "") + found[5], text)


def pages() -> list[Path]:
    """Return the pages that may hold made texts."""
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]


def main() -> None:
    """Fill in all pages."""
    for page in pages():
        text = page.read_text(encoding="utf-8")
        page.write_text(filled(text), encoding="utf-8")


if __name__ == "__main__":
    sys.path.insert(0, str(DOCS))
    main()
