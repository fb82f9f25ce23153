"""The paper's numbers as data, summaries of errors, and the report: the page agrees with the CSV."""

from __future__ import annotations

import csv
import math
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from markerseek.core import ConfigError
from markerseek.studies.paper import RunOptions, Section, write_report, write_section
from markerseek.studies.paper.offline import OfflineBank, fig6, grid, offline_searches
from markerseek.studies.paper.report import REPORT
from markerseek.studies.paper.section import MATERIALS, PAPER_NUMBERS, compared, errors_of, paper_number


class Tables(HTMLParser):
    """Cells of every table of a page, by the table's id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: dict[str, list[list[str]]] = {}
        self._name = ""
        self._cell = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self._name = dict(attrs).get("id") or ""
            self.found[self._name] = []
        elif tag == "tr":
            self.found[self._name].append([])
        elif tag == "td":
            self._cell = True
            self.found[self._name][-1].append("")

    def handle_endtag(self, tag: str) -> None:
        self._cell = self._cell and tag != "td"

    def handle_data(self, data: str) -> None:
        if self._cell:
            self.found[self._name][-1][-1] += data


def test_the_papers_numbers_are_those_of_the_paper() -> None:
    assert [paper_number(f"table1/TS/{material}").value for material in MATERIALS] == [0.34, 0.29, 0.34, 0.32, 0.32]
    assert (paper_number("table2/GSS").value, paper_number("table2/GSS").sd) == (0.74, 0.58)
    assert (paper_number("fig7/TS/2").value, paper_number("fig7/GSS/2").value) == (4.20, 5.89)
    assert paper_number("fig5/TS").value == pytest.approx(70 * (2 / 3) ** 14 / 4, abs=0.001)
    assert str(paper_number("fig5/WA")) == "0.47 ± 0.11°"
    assert all(number.place for number in PAPER_NUMBERS.values())
    with pytest.raises(ConfigError, match="not a number of the paper"):
        paper_number("fig12")


def test_errors_are_summed_up_as_by_hand() -> None:
    count, mean_deg, sd_deg, half_deg, failed = errors_of([1.0, 2.0, 6.0]).cells
    assert (count, mean_deg) == (3, 3.0)
    assert sd_deg == pytest.approx(math.sqrt((4 + 1 + 9) / 2))
    assert failed == pytest.approx(1 / 3)
    # Student's t for two degrees of freedom
    assert half_deg == pytest.approx(4.302653 * math.sqrt(7) / math.sqrt(3), rel=1e-5)
    assert errors_of([0.5]).error_deg.half is None


def test_the_grid_is_that_of_the_paper_but_rough() -> None:
    places = grid(np.random.default_rng(3))
    assert len(places) == 9
    x_mm = [1e3 * place.radius_m * math.sin(math.radians(place.angle_deg or 0.0)) for place in places]
    assert np.array(x_mm).reshape(3, 3).mean(axis=0) == pytest.approx([-20, 0, 20], abs=5)
    assert len({place.angle_deg for place in places}) == 9


def test_the_page_holds_the_numbers_of_the_csv_and_loads_nothing(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    options = RunOptions(markers=20)
    example = Path(__file__).parents[4] / "examples" / "simulated_scan.csv"
    own = OfflineBank(path=example, material="mine", reference_deg=-8.25)
    searches = offline_searches([own], options)
    of_paper = Section(name="s", title="s", method=(), comparisons=(compared("fig7/TS/2", errors_of([0.1, 0.2])),))
    sections = [fig6(searches, own), of_paper]
    paths = [path for section in sections for path in write_section(section, tmp_path)]
    text = write_report(sections, tmp_path, options=options).read_text(encoding="utf-8")
    assert (tmp_path / REPORT).exists()
    assert not re.search(r"""(src|href)=["'](?!data:|#)""", text)
    pages = Tables(text).found
    assert set(pages) == {"fig6_beside_the_paper", "s_beside_the_paper"}
    for name, found in pages.items():
        with (tmp_path / f"{name}.csv").open(newline="", encoding="utf-8") as lines:
            rows = list(csv.reader(lines))[1:]
        page = [row for row in found if row]
        assert len(page) == len(rows) > 0
        for on_page, in_csv in zip(page, rows, strict=True):
            for seen, exact in zip(on_page, in_csv, strict=True):
                assert _same(seen, exact), (name, seen, exact)
    assert {path.suffix for path in paths} == {".csv", ".png", ".svg"}
    # The reason stands at its section, and in the list of all; that of no section only there.
    assert text.count("one iteration leaves a larger error") == 2
    assert text.count("the probe turns by 122° (TS) and 76° (GSS)") == 1
    assert "made with 20 markers instead of 1000" in text.lower()


def _same(seen: str, exact: str) -> bool:
    try:
        return math.isclose(float(seen), float(exact), rel_tol=6e-3, abs_tol=1e-12)
    except ValueError:
        return seen == exact


def test_a_report_that_cannot_be_written_is_refused_in_words(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    ours = compared("fig5/TS", errors_of([0.1, 0.2]))
    section = Section(name="s", title="s", method=(), comparisons=(ours,))
    with pytest.raises(ConfigError, match="choose another folder"):
        write_section(section, blocked / "below")
    with pytest.raises(ConfigError, match="choose another folder"):
        write_report([section], blocked / "below", options=RunOptions(markers=10))


def test_results_do_not_depend_on_the_number_of_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    steps: list[tuple[str, int, int]] = []
    alone = RunOptions(progress=lambda *step: steps.append(step)).each(math.sqrt, [1.0, 4.0, 9.0], stage="roots")
    assert alone == RunOptions(workers=2).each(math.sqrt, [1.0, 4.0, 9.0], stage="roots") == [1.0, 2.0, 3.0]
    assert steps == [("roots", done, 3) for done in range(4)]
    assert "PYTHONSAFEPATH" not in os.environ, "it would keep later programs from importing of the current folder"
