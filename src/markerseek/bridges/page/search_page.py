"""The page of a live search: controls, panels, and the slider over what has happened."""

from __future__ import annotations

from markerseek.bridges.page.controls import SearchControls
from markerseek.bridges.page.desk import Desk
from markerseek.bridges.page.frame import Frame
from markerseek.bridges.page.live import LiveRun
from markerseek.bridges.page.panels import Panels
from markerseek.bridges.page.results import ResultRow
from markerseek.bridges.page.settings import PageSettings
from markerseek.bridges.page.timeline import Timeline


def build_search_page(desk: Desk, settings: PageSettings) -> None:
    """Build the page for one viewer.

    Parameters
    ----------
    desk
        What all viewers share.
    settings
        The settings at first, from the link.
    """
    frame = Frame(desk, "/")
    controls = SearchControls(frame, settings)
    panels = Panels()
    timeline = Timeline()
    results = ResultRow()

    def update() -> None:
        controls.update()
        live = desk.search
        frame.show_status(status_text(live))
        if live is None or live.run is None:
            return
        run = live.run
        frame.show_kind(run.configuration.facts.kind, emulated=run.configuration.facts.emulated)
        snapshot = timeline.snapshot(run)
        panels.show(run, snapshot, reveal=run.snapshots[-1].phase == "finished")
        results.show(None if live.outcome is None else live.outcome.answer, live.journal)

    frame.run(update)


def status_text(live: LiveRun | None) -> str:
    """One line on the search."""
    if live is None:
        return "ready: press Start"
    if live.status == "ended":
        return live.message
    if live.status == "running" and live.run is not None:
        return live.run.snapshots[-1].phase
    return live.status
