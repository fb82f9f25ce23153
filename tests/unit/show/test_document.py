"""A report as a page and as PDF: all that it holds is in both, and the same report gives the same file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from markerseek.show import Document, DocumentFigure, Verdict, errors_figure, write_document_page, write_document_pdf
from markerseek.show.document import _pages

pytest.importorskip("matplotlib", reason="needs the extra plot")

ERRORS = [(3, 1.4, 2.6), (4, 1.1, 2.1), (5, 0.9, 1.8)]


def document(rows: int = 3) -> Document:
    return Document(
        title="A <report>",
        verdict=Verdict(word="REGISTERED", kind="found", angle="0.95 mm", reason="five markers"),
        note="Simulated: no measurement.",
        facts=[("rig", "a rig of $50 & more"), ("a name that is longer than its column is wide", "x " * 90)],
        figures=[DocumentFigure(title="Errors", alt="three errors", draw=lambda: errors_figure(ERRORS, goal_mm=1.0))],
        tables={"Markers": [("marker", "reason"), *((str(number), "found") for number in range(rows))]},
        blocks={"for ROS 2": "ros2 run tf2_ros static_transform_publisher \\\n    --x 1"},
    )


def test_the_page_holds_all_and_escapes_what_others_wrote(tmp_path: Path) -> None:
    write_document_page(document(), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for part in (
        "A &lt;report&gt;",
        "REGISTERED",
        "0.95 mm",
        "five markers",
        "Simulated: no measurement.",
        "a rig of $50 &amp; more",
        'alt="three errors"',
        "<h2>Markers</h2>",
        "static_transform_publisher",
    ):
        assert part in text, part
    assert text.count("<tr>") == 2 + 4
    # It loads no other file.
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_the_pdf_has_its_text_on_pages_then_the_figures_and_is_the_same_again(tmp_path: Path) -> None:
    for name in ("a.pdf", "b.pdf"):
        write_document_pdf(document(rows=100), tmp_path / name)
    written = (tmp_path / "a.pdf").read_bytes()
    assert written.startswith(b"%PDF")
    assert written == (tmp_path / "b.pdf").read_bytes()
    assert len(re.findall(rb"/Type /Page\b", written)) == len(_pages(document(rows=100), most=68)) + 1


def test_a_section_that_fits_on_a_page_is_not_broken() -> None:
    pages = _pages(document(rows=30), most=40)
    assert [page[0] for page in pages][:2] == ["REGISTERED 0.95 mm", "Markers"]
    assert all(len(page) <= 40 for page in pages)
    lines = [line for page in pages for line in page]
    # Nothing is lost where a section is longer than a page.
    assert [line for page in _pages(document(rows=30), most=10) for line in page] == lines
    assert "found" in next(line for line in lines if line.startswith("29"))
