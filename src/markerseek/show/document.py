"""A report that is kept: verdict, facts, figures, tables and texts, as one page of HTML, or as PDF."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from markerseek.show.files import new_picture, png_data_uri, write_page
from markerseek.show.style import new_figure
from markerseek.show.verdict import Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Rows = Sequence[tuple[str, ...]]
"""Rows of a table, the headings first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DocumentFigure:
    """A figure of a report."""

    title: str
    alt: str
    """What it shows, for those who cannot see it."""
    draw: Callable[[], Figure]


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """What a report holds; the same for all its forms."""

    title: str
    verdict: Verdict
    note: str | None
    """What must not be overlooked; None: nothing."""
    facts: Sequence[tuple[str, str]]
    figures: Sequence[DocumentFigure] = ()
    tables: Mapping[str, Rows] = field(default_factory=dict)
    """Tables by their titles."""
    blocks: Mapping[str, str] = field(default_factory=dict)
    """Texts to be pasted elsewhere, by what they are for."""


def write_document_page(document: Document, path: Path) -> None:
    """Write a report as one HTML file, which loads no other."""
    figures = [(each.title, each.alt, png_data_uri(each.draw())) for each in document.figures]
    write_page(path, "document.html.jinja", title=document.title, document=document, figures=figures)


PAGE_IN = (8.27, 11.69)
"""Width and height of a page in inches: A4."""

_FONT_PT = 8.0
_LINE_IN = 1.35 * _FONT_PT / 72
_MARGIN_IN = 0.7
_COLUMNS = 98
"""Letters in a line of the fixed font between the margins."""

_NAME_COLUMNS = 26
"""Letters of the names of facts."""


def write_document_pdf(document: Document, path: Path) -> None:
    """Write a report as PDF: pages of text, then one for each figure; the same report gives the same file."""
    with new_picture(path, what="report") as part:
        _write_pages(document, part)


def _write_pages(document: Document, part: Path) -> None:
    # Tests first that Matplotlib is installed.
    pages = list(_text_pages(document))
    from matplotlib.backends.backend_pdf import PdfPages

    with PdfPages(part, metadata={"Title": document.title, "CreationDate": None}) as pdf:
        for page in pages:
            pdf.savefig(page)
        for each in document.figures:
            pdf.savefig(each.draw())


def _text_pages(document: Document) -> Iterator[Figure]:
    """Yield the text of a report on pages."""
    for lines in _pages(document, most=int((PAGE_IN[1] - 2 * _MARGIN_IN - 0.4) / _LINE_IN)):
        page = new_figure(width_in=PAGE_IN[0], height_in=PAGE_IN[1])
        left = _MARGIN_IN / PAGE_IN[0]
        page.text(left, 1 - 0.5 / PAGE_IN[1], document.title, fontsize=12, weight="bold", va="top", parse_math=False)
        top = 1 - (_MARGIN_IN + 0.3) / PAGE_IN[1]
        page.text(
            left,
            top,
            "\n".join(lines),
            fontsize=_FONT_PT,
            family="monospace",
            linespacing=1.35,
            va="top",
            parse_math=False,
        )
        yield page


def _pages(document: Document, *, most: int) -> list[list[str]]:
    """Return the lines of each page, at most so many; a section that fits on one page is not broken."""
    pages: list[list[str]] = [[]]
    for section in _sections(document):
        if pages[-1] and len(pages[-1]) + len(section) > most:
            pages.append([])
        for line in section:
            if len(pages[-1]) == most:
                pages.append([])
            pages[-1].append(line)
    return pages


def _sections(document: Document) -> Iterator[list[str]]:
    """Yield the text of a report, in lines of a fixed font; an empty one ends each section."""
    yield [*_head(document), ""]
    yield [*(line for name, value in document.facts for line in _fact(name, value)), ""]
    for title, rows in document.tables.items():
        yield [title, *_table(rows), ""]
    for title, text in document.blocks.items():
        yield [title, *text.splitlines(), ""]


def _head(document: Document) -> Iterator[str]:
    verdict = document.verdict
    yield " ".join(filter(None, (verdict.word, verdict.lead, verdict.angle, verdict.sigma)))
    for sentence in filter(None, (verdict.turn, verdict.reason, verdict.next_step, document.note)):
        yield from textwrap.wrap(sentence, _COLUMNS)


def _fact(name: str, value: str) -> Iterator[str]:
    names = textwrap.wrap(name, _NAME_COLUMNS - 2) or [""]
    values = textwrap.wrap(value, _COLUMNS - _NAME_COLUMNS) or [""]
    for number in range(max(len(names), len(values))):
        left = names[number] if number < len(names) else ""
        right = values[number] if number < len(values) else ""
        yield f"{left:<{_NAME_COLUMNS}}{right}".rstrip()


def _table(rows: Rows) -> Iterator[str]:
    """Yield a table in a fixed font; its last column, which may hold sentences, is wrapped."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]) - 1)]
    room = max(_COLUMNS - sum(widths) - 2 * len(widths), 20)
    for row in rows:
        first = "".join(f"{cell:<{width + 2}}" for cell, width in zip(row[:-1], widths, strict=True))
        for number, line in enumerate(textwrap.wrap(row[-1], room) or [""]):
            yield f"{first if number == 0 else ' ' * len(first)}{line}".rstrip()
