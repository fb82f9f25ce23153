"""The page of a live search: controls, panels, and the slider over what has happened."""

from __future__ import annotations

from collections.abc import Mapping

from markerseek.bridges.page.controls import USUAL, RunControls
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import SearchPanels, Timeline, VerdictPanel
from markerseek.bridges.page.results import ResultRow
from markerseek.runs import Verdict


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
