"""The page of a live search: controls, panels, the slider over what has happened, and what a person takes away."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
from nicegui import run, ui

from markerseek.bridges.child import Outcome
from markerseek.bridges.page.controls import USUAL, RunControls
from markerseek.bridges.page.page_searches import ChildSearch, PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import SearchPanels, Timeline, VerdictPanel
from markerseek.core import MarkerseekError, SearchError
from markerseek.show import Verdict

REPORT_S = 120.0
"""Longest time to draw a report, in seconds."""


def is_claimed(answer: Mapping[str, Any]) -> bool:
    """Whether a search claims its angle; the paper's form of a method answers always and claims nothing."""
    return bool(answer["answer"] == "found" and not answer["as_published"])


@lru_cache(maxsize=1)
def make_report(journal: Path) -> dict[str, bytes]:
    """Picture and page of a finished search by the ordinary command, as file names and contents.

    Raises `OSError` or `TimeoutExpired` if the command cannot be run, or not to its end.
    """
    with tempfile.TemporaryDirectory() as folder:
        # -P: a file in the current folder must not replace a module.
        done = subprocess.run(  # noqa: S603  no shell; the journal is one that this page keeps
            [sys.executable, "-P", "-m", "markerseek", "resume", str(journal), "--plot", "--out", folder, "--json"],
            capture_output=True,
            timeout=REPORT_S,
            check=False,
            stdin=subprocess.DEVNULL,
        )
        made = {f"search{path.suffix}": path.read_bytes() for path in sorted(Path(folder).iterdir())}
        if not made:
            raise SearchError(Outcome.of(done.returncode, done.stdout).message)
        return made


class ResultRow:
    """Buttons of a finished search."""

    def __init__(self) -> None:
        self._live: ChildSearch | None = None
        with ui.element("div").classes("ms-foot") as self._bar:
            for name in ("search.html", "search.png"):
                _button(f"report {name[7:].upper()}", "download").on_click(lambda name=name: self._give(name))
            _button("report JSON", "download").on_click(self._give_json)
            self._copy_button = _button("copy the angle", "content_copy").on_click(self._copy)

    @property
    def _answer(self) -> dict[str, Any]:
        """The result; empty if there is none."""
        answer = (self._live and self._live.outcome and self._live.outcome.answer) or {}
        return answer if "angle_deg" in answer else {}

    def show(self, live: ChildSearch | None) -> None:
        """Show the buttons once there is a result."""
        self._live = live
        answer = self._answer
        self._bar.set_visibility(bool(answer))
        # An angle that nobody claims must not find its way into a protocol.
        self._copy_button.set_visibility(bool(answer) and is_claimed(answer))

    def _give_json(self) -> None:
        ui.download.content(msgspec.json.format(msgspec.json.encode(self._answer), indent=2), "search.json")

    async def _give(self, name: str) -> None:
        if self._live is None:
            return
        ui.notify("the report is being drawn, which takes some seconds", position="bottom-right")
        try:
            made = await run.io_bound(make_report, self._live.journal)
        except (MarkerseekError, OSError, subprocess.TimeoutExpired) as problem:
            ui.notify(str(problem), type="negative", multi_line=True)
            return
        # None while the program ends.
        if made is not None:
            ui.download.content(made[name], name)

    def _copy(self) -> None:
        ui.clipboard.write(f"{self._answer['angle_deg']:.4f}")
        ui.notify("the angle is in the clipboard")


def _button(text: str, icon: str) -> ui.button:
    return ui.button(text, icon=icon).props("flat dense")


def build_search_page(searches: PageSearches, query: Mapping[str, str]) -> None:
    """Build the page for one viewer; ``query``: of its link."""
    shell = PageShell(searches, "/search")
    verdict = VerdictPanel()
    controls = RunControls(shell, USUAL, query)
    panels = SearchPanels(searches.rig.search)
    timeline = Timeline()
    results = ResultRow()

    def update() -> None:
        live = searches.search
        run = None if live is None else live.run
        view = timeline.view(run)
        controls.update(live)
        verdict.show(Verdict(next_step="press Start") if live is None else live.verdict(view))
        panels.show(run, view)
        results.show(live)
        shell.show_emulated(run)

    shell.run(update)
