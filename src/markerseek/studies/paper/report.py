"""Sections as files: a CSV for each table, PNG and SVG of the picture, and one HTML page with all of them."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

from markerseek._version import __version__
from markerseek.pictures import new_picture, png_data_uri, save_png, save_svg, write_page
from markerseek.studies.paper.options import PAPER_MARKERS, RunOptions
from markerseek.studies.paper.printed import PAPER_NUMBERS, PaperNumber
from markerseek.studies.paper.section import Cell, Section, Table, make_table

REPORT = "report.html"
"""Name of the page."""


def write_section(section: Section, folder: Path) -> list[Path]:
    """Write the tables and the picture of a section, and return their paths."""
    for table in _tables(section):
        _write_csv(table, folder / f"{table.name}.csv")
    if section.draw is not None:
        # Drawn again for the page: a figure holds megabytes, and sections are kept until the end.
        figure = section.draw()
        save_png(figure, folder / f"{section.name}.png")
        save_svg(figure, folder / f"{section.name}.svg")
    return [folder / name for name in _file_names(section)]


def write_report(
    sections: Sequence[Section],
    folder: Path,
    *,
    options: RunOptions,
    durations_s: Sequence[float] = (),
    own_bank: Path | None = None,
) -> Path:
    """Write the page of all sections, and return its path.

    ``sections``: in the order of the page. ``folder``: where `write_section` put their files. ``durations_s``: how long
    each took; empty if not measured. ``own_bank``: the user's bank from which they were made; None for simulated ones.
    """
    if own_bank is not None:
        note = f"Searches on your own bank {own_bank}, with the intensities that it holds."
    else:
        note = "Simulated: no hardware was involved, and the materials are stand-ins."
        if options.markers < PAPER_MARKERS:
            note += f" Made with {options.markers} markers instead of {PAPER_MARKERS}, and fewer repeats and angles."
    write_page(
        folder / REPORT,
        "paper.html.jinja",
        title="The paper, reproduced",
        note=note,
        made_with=f"markerseek {__version__}"
        + (f", seed {options.seed}, {options.markers} markers" if own_bank is None else ""),
        sections=list(zip_longest(sections, durations_s)),
        limitations=_limitations(),
        shown=shown,
        comparison_table=comparison_table,
        file_names=_file_names,
        png_data_uri=png_data_uri,
        reasons=_reasons,
    )
    return folder / REPORT


def comparison_table(section: Section) -> Table:
    """The paper's numbers and ours, as a table of the section."""
    return make_table(
        f"{section.name}_beside_the_paper",
        "The paper's numbers beside ours",
        "number place unit condition paper paper_spread ours ours_spread half_interval95 difference off without_claim",
        (
            (
                each.paper.quantity, each.paper.place, each.paper.unit, each.condition, each.paper.value, each.paper.sd,
                each.ours, each.sd, each.half, each.difference, each.failed, each.unclaimed,
            )
            for each in section.comparisons
        ),
    )  # fmt: skip


def shown(cell: Cell) -> str:
    """One cell as people read it: three significant digits, and nothing for None."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        # Three digits of 1234.5 would be "1.23e+03".
        return f"{cell:.0f}" if abs(cell) >= 100 else f"{cell:.3g}"
    return str(cell)


def _tables(section: Section) -> list[Table]:
    return [*([comparison_table(section)] if section.comparisons else []), *section.tables]


def _file_names(section: Section) -> list[str]:
    pictures = [] if section.draw is None else [f"{section.name}.png", f"{section.name}.svg"]
    return [*(f"{table.name}.csv" for table in _tables(section)), *pictures]


def _write_csv(table: Table, path: Path) -> None:
    with new_picture(path, what="table") as part, part.open("w", newline="", encoding="utf-8") as lines:
        # The default of the csv module is CRLF, on every system.
        csv.writer(lines, lineterminator="\n").writerows([table.columns, *table.rows])


def _reasons(section: Section) -> list[tuple[str, dict[str, list[str]]]]:
    """Headings, and under each the sentences about the section's numbers, with the numbers of each sentence."""
    limitations: dict[str, list[str]] = {}
    notes: dict[str, list[str]] = {}
    for number in dict.fromkeys(each.paper for each in section.comparisons):
        for sentence, sentences in ((number.limitation, limitations), (number.note, notes)):
            if sentence is not None:
                sentences.setdefault(sentence, []).append(f"{number.quantity} ({number})")
    return [("What cannot be reproduced, and why", limitations), ("What else is known of these numbers", notes)]


def _limitations() -> list[tuple[PaperNumber, int]]:
    """The first number with each limitation, and how many more have the same."""
    by_sentence: dict[str, list[PaperNumber]] = {}
    for number in PAPER_NUMBERS.values():
        if number.limitation is not None:
            by_sentence.setdefault(number.limitation, []).append(number)
    return [(numbers[0], len(numbers) - 1) for numbers in by_sentence.values()]
