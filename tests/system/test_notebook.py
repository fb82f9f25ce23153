"""The example notebook runs from its first cell to its last, and is what its page of the docs shows."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "gallery.md"


@pytest.fixture
def executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[Any]]:
    """Runs a notebook of the examples; its cells of code come back, with their outputs."""

    def run(name: str, *, most_lines: int, **options: object) -> list[Any]:
        # Here, for the import takes seconds, and each process that runs tests collects this file.
        nbformat = pytest.importorskip("nbformat", reason="needs the packages of the tests")
        nbclient = pytest.importorskip("nbclient", reason="needs the packages of the tests")
        for variable in ("IPYTHONDIR", "JUPYTER_RUNTIME_DIR", "JUPYTER_CONFIG_DIR"):
            monkeypatch.setenv(variable, str(tmp_path / variable))
        book = nbformat.read(ROOT / "examples" / name, as_version=4)
        code = [cell for cell in book.cells if cell.cell_type == "code"]
        assert sum(len(cell.source.splitlines()) for cell in code) <= most_lines
        assert not any(cell.outputs for cell in code)
        nbclient.NotebookClient(book, timeout=300, kernel_name="python3", **options).execute()
        return code

    return run


def test_the_notebook_searches_draws_and_counts(executed: Callable[..., list[Any]]) -> None:
    pytest.importorskip("pandas", reason="needs the extra notebook")
    code = executed("search.ipynb", most_lines=20, resources={"metadata": {"path": str(ROOT / "examples")}})
    assert [cell.source for cell in code] == re.findall(r"^```ipython\n(.*?)\n```$", PAGE.read_text(), re.M | re.S)
    searched, drawn, table, bank = [
        {kind: data for each in cell.outputs for kind, data in each.get("data", {}).items()} for cell in code
    ]
    assert "<td" in searched["text/html"]
    assert ">found<" in searched["text/html"]
    assert "<svg" in searched["text/html"]
    assert any("acquisition 1:" in each.get("text", "") for each in code[0].outputs)
    assert drawn["image/png"]
    acquisitions = int(re.findall(r">acquisitions</th><td[^>]*>(\d+)<", searched["text/html"])[0])
    assert [table["text/html"].count(f">{role}<") for role in ("search", "confirmation")] == [acquisitions, 1]
    assert "-8." in bank["text/plain"]


@pytest.mark.long
def test_the_notebook_of_a_registration_registers(executed: Callable[..., list[Any]]) -> None:
    code = executed("register.ipynb", most_lines=22)
    said = "".join(each.get("text", "") for cell in code for each in cell.outputs)
    assert said.count("found") >= 4
    assert float(re.findall(r"true error ([\d.]+) mm", said)[0]) < 2.5
