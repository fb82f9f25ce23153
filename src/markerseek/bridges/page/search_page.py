"""The page of a live search: controls, panels, and the slider over what has happened."""

from __future__ import annotations

from markerseek.bridges.page.child_search import ChildSearch
from markerseek.bridges.page.controls import SearchControls
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import VerdictPanel
from markerseek.bridges.page.results import ResultRow
from markerseek.bridges.page.settings import LinkSettings
from markerseek.bridges.page.timeline import RunView
from markerseek.bridges.page.verdict import verdict_of


def build_search_page(searches: PageSearches, link: LinkSettings) -> None:
    """Build the page for one viewer."""
    frame = PageShell(searches, "/")
    verdict = VerdictPanel()
    controls = SearchControls(frame, link)
    view = RunView(searches.rig.search, verdict)
    results = ResultRow()
    shown: ChildSearch | None = None

    def update() -> None:
        nonlocal shown
        controls.update()
        live = searches.search
        # A search that goes on has the journal of the one before.
        if shown is not None and live is not None and live.journal != shown.journal:
            view.clear()
        shown = live
        outcome = None if live is None else live.outcome
        results.show(None if outcome is None else outcome.answer, None if live is None else live.journal)
        elsewhere = searches.busy and not searches.searching
        status = "a race, or the search of a recording, runs" if elsewhere else None
        frame.show_status(
            status or status_text(live, simulated=searches.rig.simulated), alarms=live is not None and live.failed
        )
        if live is None or live.run is None:
            return
        run = live.run
        frame.show_kind(run.configuration.facts.kind, emulated=run.configuration.facts.emulated)
        view.show(run, reveal=run.snapshots[-1].phase == "finished", next_step=next_step_text(searches))

    frame.run(update)


def next_step_text(searches: PageSearches) -> str:
    """What a person can do after a search that was stopped or ended by a fault; empty while anything runs."""
    if searches.busy:
        return ""
    if searches.paused:
        return "Go on continues it; Start begins a new search"
    if searches.rig.simulated:
        return "Start begins a new search"
    return "Start begins a new search; markerseek resume, in the terminal, goes on with this one"


def status_text(live: ChildSearch | None, *, simulated: bool = True) -> str:
    """One line on a search; of one on devices that starts, who is asked what."""
    if live is None:
        return "ready: press Start"
    if live.status == "ended":
        if live.run is not None:
            verdict = verdict_of(live.run.snapshots[-1])
            # What the verdict says in large letters is not said twice.
            return f"{verdict.line}: {live.message}" if live.failed and not verdict.problem else verdict.line
        return f"fault: {live.message}" if live.failed else live.message
    if live.status == "starting" and not simulated:
        return "starting: the terminal where the page was started asks whether to arm"
    if live.status == "running" and live.run is not None:
        snapshot = live.run.snapshots[-1]
        return snapshot.line if snapshot.phase == "turning" else snapshot.phase
    return live.status
