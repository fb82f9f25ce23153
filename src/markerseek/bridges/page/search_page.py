"""The page of a live search: controls, panels, the slider over what has happened, and what a person takes away."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec
from nicegui import ui

from markerseek.bridges.page.children import ChildSearch
from markerseek.bridges.page.controls import USUAL, RunControls
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import SearchPanels, Timeline, VerdictPanel
from markerseek.bridges.page.report_buttons import report_button
from markerseek.bridges.page.reports import make_search_report
from markerseek.show import Verdict


def is_claimed(answer: Mapping[str, Any]) -> bool:
    """Whether a search claims its angle; the paper's form of a method answers always and claims nothing."""
    return bool(answer["answer"] == "found" and not answer["as_published"])


class ResultRow:
    """Buttons of a finished search."""

    def __init__(self) -> None:
        self._live: ChildSearch | None = None
        with ui.element("div").classes("ms-foot") as self._bar:
            for name in ("search.html", "search.png"):
                report_button(f"report {name[7:].upper()}", name, self._make)
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

    def _make(self) -> dict[str, bytes] | None:
        return None if self._live is None else make_search_report(self._live.journal)

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
