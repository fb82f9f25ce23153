"""Sections as files: CSV, PNG and SVG for each, and one HTML page that holds all of them and loads nothing."""

from __future__ import annotations

import csv
import html
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

from markerseek._version import __version__
from markerseek.core import ConfigError
from markerseek.files import replaced
from markerseek.pictures import png_data_uri, save_png, save_svg
from markerseek.studies.paper.effort import PAPER_MARKERS, Effort
from markerseek.studies.paper.page import PAGE
from markerseek.studies.paper.reported import REPORTED, Reported, reported
from markerseek.studies.paper.section import Cell, Section, Table
from markerseek.studies.paper.stopwatch import Took

REPORT = "report.html"
"""Name of the page."""

_UNBROKEN = 22
"""Most letters of a cell that is kept on one line."""


def write_section(section: Section, folder: Path) -> list[Path]:
    """Write the tables and pictures of a section, and return their paths.

    Raises
    ------
    ConfigError
        If a file cannot be written.
    """
    paths = []
    for table in _tables(section):
        path = folder / f"{table.name}.csv"
        _write_csv(table, path)
        paths.append(path)
    for picture in section.pictures:
        figure = picture.draw()
        for save, ending in ((save_png, "png"), (save_svg, "svg")):
            path = folder / f"{picture.name}.{ending}"
            save(figure, path)
            paths.append(path)
    return paths


def write_report(sections: Sequence[Section], folder: Path, *, effort: Effort, times: Sequence[Took] = ()) -> Path:
    """Write the page of all sections, and return its path.

    Parameters
    ----------
    sections
        In the order in which they stand there.
    folder
        Where `write_section` put their files.
    effort
        What they used.
    times
        How long each took; empty where nobody measured it.

    Raises
    ------
    ConfigError
        If the file cannot be written.
    """
    thinned = f"Made with {effort.markers} markers instead of {PAPER_MARKERS}, and fewer repeats and angles to match."
    sensitive = reported("sensitive")
    text = PAGE.format(
        note=thinned if effort.markers < PAPER_MARKERS else "",
        version=__version__,
        seed=effort.seed,
        markers=effort.markers,
        contents="".join(f'<a href="#{each.name}">{html.escape(each.name)}</a>' for each in sections)
        + '<a href="#fig9">fig9</a><a href="#limits">limits</a>',
        sections="\n".join(_section(each, took) for each, took in zip_longest(sections, times)),
        fig9=html.escape(f"Not made. {sensitive.limits} The paper has {sensitive} for {sensitive.what}."),
        limits="".join(_limit(number) for number in _limited()),
    )
    path = folder / REPORT
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with replaced(path) as part:
            part.write_text(text, encoding="utf-8")
    except OSError as problem:
        raise ConfigError(f"{path}: the report cannot be written: {problem.strerror}; name another --out") from problem
    return path


def beside_table(section: Section) -> Table:
    """The paper's numbers and ours, as a table of the section."""
    return Table(
        name=f"{section.name}_beside_the_paper",
        caption="The paper's numbers beside ours",
        columns=(
            "number",
            "place",
            "unit",
            "condition",
            "paper",
            "paper_spread",
            "ours",
            "ours_spread",
            "half_interval95",
            "difference",
            "off",
        ),
        rows=tuple(
            (
                each.paper.what,
                each.paper.place,
                each.paper.unit,
                each.condition,
                each.paper.mean,
                each.paper.spread,
                each.ours,
                each.spread,
                each.half,
                each.difference,
                each.failed,
            )
            for each in section.besides
        ),
    )


def shown(cell: Cell) -> str:
    """One cell as people read it: three significant digits, and nothing for None."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.0f}" if abs(cell) >= 100 else f"{cell:.3g}"
    return str(cell)


def _tables(section: Section) -> list[Table]:
    return [*([beside_table(section)] if section.besides else []), *section.tables]


def _write_csv(table: Table, path: Path) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replaced(path) as part, part.open("w", newline="", encoding="utf-8") as lines:
            writer = csv.writer(lines, lineterminator="\n")
            writer.writerow(table.columns)
            writer.writerows(table.rows)
    except OSError as problem:
        raise ConfigError(f"{path}: the table cannot be written: {problem.strerror}; name another --out") from problem


def _section(section: Section, took: Took | None) -> str:
    parts = [f'<h2 id="{html.escape(section.name)}">{html.escape(section.title)}</h2>']
    parts += [f"<p>{html.escape(paragraph)}</p>" for paragraph in section.method]
    if section.besides:
        parts.append(_table(beside_table(section)))
    for picture in section.pictures:
        uri = png_data_uri(picture.draw())
        parts.append(f'<p><img src="{uri}" alt="{html.escape(picture.alt)}"></p>')
    parts += [f"<p>{html.escape(remark)}</p>" for remark in section.remarks]
    numbers = list(dict.fromkeys(each.paper for each in section.besides))
    for heading, said in (
        ("What of these numbers cannot be had", {number: number.limits for number in numbers}),
        ("What else is known of them", {number: number.note for number in numbers}),
    ):
        lines = _by_reason(said)
        parts += [f"<h3>{heading}</h3><ul>{lines}</ul>"] if lines else []
    parts += [_table(table) for table in section.tables if table.shown]
    names = ", ".join(f"{table.name}.csv" for table in _tables(section))
    pictures = "".join(f", {picture.name}.png, {picture.name}.svg" for picture in section.pictures)
    spent = "" if took is None else f". Made in {took}."
    parts.append(f'<p class="files">Files: {html.escape(names + pictures + spent)}</p>')
    return "\n".join(parts)


def _by_reason(said: Mapping[Reported, str | None]) -> str:
    """One line for each sentence, with the numbers of which it holds."""
    held: dict[str, list[str]] = {}
    for number, sentence in said.items():
        if sentence is not None:
            held.setdefault(sentence, []).append(f"{number.what} ({number})")
    return "".join(f"<li>{html.escape(_few(names))}: {html.escape(sentence)}</li>" for sentence, names in held.items())


def _few(names: Sequence[str]) -> str:
    return "; ".join(names) if len(names) <= 3 else f"{names[0]}, and {len(names) - 1} like it"


def _table(table: Table) -> str:
    head = ""
    for place, name in enumerate(table.columns):
        kind = ' class="n"' if any(isinstance(row[place], float | int) for row in table.rows) else ""
        head += f"<th{kind}>{html.escape(name.replace('_', ' '))}</th>"
    body = "".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in table.rows)
    return (
        f'<div class="wide"><table id="{html.escape(table.name)}"><caption>{html.escape(table.caption)}</caption>'
        f"<tr>{head}</tr>{body}</table></div>"
    )


def _cell(cell: Cell) -> str:
    kind = ""
    if isinstance(cell, float | int):
        kind = ' class="n"'
    elif cell is not None and len(cell) <= _UNBROKEN:
        kind = ' class="s"'
    return f"<td{kind}>{html.escape(shown(cell))}</td>"


def _limited() -> list[Reported]:
    """Numbers with a reason why they cannot be had, one for each reason."""
    return list({number.limits: number for number in reversed(REPORTED.values()) if number.limits}.values())[::-1]


def _limit(number: Reported) -> str:
    same = sum(other.limits == number.limits for other in REPORTED.values())
    more = "" if same == 1 else f", and {same - 1} more"
    said = f"{number.place}, {number.what}: {number}{more}. {number.limits}"
    return f"<li>{html.escape(said)}</li>"
