"""The page of a live search: controls, panels, the slider over what has happened, and what a person takes away."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
from nicegui import ui

from markerseek.bridges.outcome import Outcome, PrintedResult
from markerseek.bridges.page.children import ChildSearch
from markerseek.bridges.page.controls import USUAL, RunControls
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import SearchPanels, Timeline, VerdictPanel
from markerseek.bridges.page.report_buttons import report_button
from markerseek.bridges.page.reports import make_search_report
from markerseek.show import Verdict


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
    def _outcome(self) -> Outcome | None:
        """How the search ended that is shown; None before."""
        return None if self._live is None else self._live.outcome

    @property
    def _result(self) -> PrintedResult | None:
        """Its result; None if there is none."""
        return None if self._outcome is None else self._outcome.result

    def show(self, live: ChildSearch | None) -> None:
        """Show the buttons once there is a result."""
        self._live = live
        result = self._result
        self._bar.set_visibility(result is not None)
        # An angle that nobody claims must not find its way into a protocol.
        self._copy_button.set_visibility(result is not None and result.is_claimed)

    def _give_json(self) -> None:
        if self._outcome is not None:
            printed = msgspec.json.encode(self._outcome.printed)
            ui.download.content(msgspec.json.format(printed, indent=2), "search.json")

    def _make(self) -> dict[str, bytes] | None:
        return None if self._live is None else make_search_report(self._live.journal)

    def _copy(self) -> None:
        if self._result is not None:
            ui.clipboard.write(f"{self._result.angle_deg:.4f}")
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
