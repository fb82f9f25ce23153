"""All figures and tables by name, and their files: CSV, PNG and SVG, and one HTML page with all of them."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path

from markerseek._version import __version__
from markerseek.core import ConfigError
from markerseek.show import new_picture, png_data_uri, save_figure, write_page
from markerseek.studies.paper.fig5 import fig5
from markerseek.studies.paper.fig9 import fig9
from markerseek.studies.paper.methods import PAPER_MARKERS, PaperSearch, RunOptions
from markerseek.studies.paper.offline import OfflineBank, fig6, offline_searches, simulated_banks, table1
from markerseek.studies.paper.online import fig7, fig8, online_searches, table2
from markerseek.studies.paper.section import PAPER_NUMBERS, PaperNumber, Section, Table, TableCell, make_table

SECTIONS = ("fig5", "fig6", "table1", "table2", "fig7", "fig8", "fig9")
"""Names of the sections, in the order of the report."""

OFFLINE = ("fig6", "table1")
"""What can be made from a user's own bank."""


def make_sections(
    names: Sequence[str], *, options: RunOptions, folder: Path, own: OfflineBank | None = None
) -> Iterator[Section]:
    """Return the sections of these names, in this order; what several of them share is computed once.

    ``folder``: where banks are written. ``own``: a user's bank instead of the simulated ones; None for those. Raises
    `ConfigError` if a name is unknown, or cannot be made from a user's own bank; nothing is made then.
    """

    @cache
    def offline() -> list[PaperSearch]:
        banks = simulated_banks(folder / "banks", options) if own is None else [own]
        return offline_searches(banks, options)

    @cache
    def online() -> list[PaperSearch]:
        return online_searches(options)

    makers: dict[str, Callable[[], Section]] = {
        "fig5": lambda: fig5(options),
        "fig6": lambda: fig6(offline(), own),
        "table1": lambda: table1(offline(), own),
        "table2": lambda: table2(online()),
        "fig7": lambda: fig7(online()),
        "fig8": lambda: fig8(online()),
        "fig9": lambda: fig9(options),
    }
    for name in names:
        if name not in makers:
            raise ConfigError(f"reproduce: {name!r} is unknown; there are: {', '.join(SECTIONS)}, all")
        if own is not None and name not in OFFLINE:
            raise ConfigError(f"reproduce: {name} uses no bank; give `bank` with {' or '.join(OFFLINE)}")
    # Not `yield`: the names are checked at the call, before the first section takes its minutes.
    return (makers[name]() for name in names)


REPORT = "report.html"
"""Name of the page."""


def write_section(section: Section, folder: Path) -> list[Path]:
    """Write the tables and the picture of a section, and return their paths."""
    for table in _tables(section):
        _write_csv(table, folder / f"{table.name}.csv")
    if section.draw is not None:
        # Drawn again for the page: a figure holds megabytes, and sections are kept until the end.
        figure = section.draw()
        save_figure(figure, folder / f"{section.name}.png")
        save_figure(figure, folder / f"{section.name}.svg")
    return [folder / name for name in _file_names(section)]


def write_report(
    sections: Sequence[Section],
    folder: Path,
    *,
    options: RunOptions,
    own_bank: Path | None = None,
) -> Path:
    """Write the page of all sections, and return its path.

    ``sections``: in the order of the page. ``folder``: where `write_section` put their files. ``own_bank``: the user's
    bank from which they were made; None for simulated ones.
    """
    if own_bank is not None:
        note = f"Searches on your own bank {own_bank}, with the intensities that it holds."
    else:
        note = "Simulated, the materials too: no hardware was involved."
        if options.markers < PAPER_MARKERS:
            note += f" Made with {options.markers} markers instead of {PAPER_MARKERS}, and fewer repeats and angles."
    write_page(
        folder / REPORT,
        "paper.html.jinja",
        title="The paper, reproduced",
        note=note,
        made_with=f"markerseek {__version__}"
        + (f", seed {options.seed}, {options.markers} markers" if own_bank is None else ""),
        sections=sections,
        numbers=PAPER_NUMBERS.values(),
        shown=cell_text,
        comparison_table=comparison_table,
        file_names=_file_names,
        png_data_uri=png_data_uri,
        reasons=_reasons,
    )
    return folder / REPORT


def comparison_table(section: Section) -> Table:
    """Return the paper's numbers and ours, as a table of the section."""
    return make_table(
        f"{section.name}_beside_the_paper",
        "The paper's numbers beside ours",
        "number place unit condition paper paper_spread ours ours_spread half_interval95 difference off",
        (
            (
                each.paper.quantity, each.paper.place, each.paper.unit, each.condition, each.paper.value, each.paper.sd,
                each.ours, each.sd, each.half, each.difference, each.failed,
            )
            for each in section.comparisons
        ),
    )  # fmt: skip


def cell_text(cell: TableCell) -> str:
    """Return one cell as people read it: three significant digits, and nothing for None."""
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


def _reasons(numbers: Iterable[PaperNumber]) -> dict[str, list[str]]:
    """Return what is known of these numbers, in sentences, with the numbers of each sentence."""
    found: dict[str, list[str]] = {}
    for number in dict.fromkeys(numbers):
        for sentence in filter(None, (number.limitation, number.note)):
            found.setdefault(sentence, []).append(f"{number.place}, {number.quantity} ({number})")
    return found
