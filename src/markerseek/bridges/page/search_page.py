"""The page of a live search: controls, panels, and the slider over what has happened."""

from __future__ import annotations

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.page.child_search import ChildSearch
from markerseek.bridges.page.controls import LinkSettings, SearchControls
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import RunPlayer, VerdictPanel
from markerseek.bridges.page.results import ResultRow
from markerseek.runs import Verdict, verdict_of


def build_search_page(searches: PageSearches, link: LinkSettings) -> None:
    """Build the page for one viewer."""
    frame = PageShell(searches, "/search")
    verdict = VerdictPanel()
    controls = SearchControls(frame, link)
    player = RunPlayer(searches.rig.search, verdict)
    results = ResultRow()
    shown: ChildSearch[AskedSearch] | None = None

    def update() -> None:
        nonlocal shown
        controls.update()
        live = searches.search
        # A search that goes on has the journal of the one before.
        if shown is not None and live is not None and live.journal != shown.journal:
            player.clear()
        shown = live
        outcome = None if live is None else live.outcome
        results.show(None if outcome is None else outcome.answer, None if live is None else live.journal)
        elsewhere = searches.busy and not searches.searching
        status = "a registration runs on the other page" if elsewhere else None
        frame.show_status(status or status_text(live), alarms=live is not None and live.failed)
        if live is None or live.run is None:
            verdict.show(verdict_before(live, next_step=next_step_text(searches)))
            return
        view = live.run.last
        frame.show_emulated(view.facts.emulated)
        player.show(live.run, reveal=view.phase == "finished", next_step=next_step_text(searches))

    frame.run(update)


def next_step_text(searches: PageSearches) -> str:
    """What a person can do next: before a search, or after one that was stopped or ended by a fault.

    Empty while anything runs, but for devices that a person must arm.
    """
    live = searches.search
    if searches.busy:
        asks = not searches.rig.simulated and live is not None and live.status == "starting"
        return "answer in the terminal where the page was started" if asks else ""
    if live is None:
        return "press Start"
    if searches.paused:
        return "Go on continues it; Start begins a new search"
    if searches.rig.simulated or live.run is None:
        return "Start begins a new search"
    # As the terminal says it: a fault that the journal holds is reset by a person who has looked at the rig.
    is_fault = live.run.last.phase == "fault"
    resume = "once the fault is repaired, markerseek resume --reset-fault" if is_fault else "markerseek resume"
    return f"Start begins a new search; {resume}, in the terminal, goes on with this one"


def verdict_before(live: ChildSearch[AskedSearch] | None, *, next_step: str) -> Verdict:
    """The verdict of a search that has not begun, or ended before its first event."""
    if live is None:
        return Verdict(next_step=next_step)
    if live.status != "ended":
        return Verdict(word=live.status.upper(), kind="busy", next_step=next_step)
    if live.failed:
        return Verdict(word="FAULT", kind="fault", problem=live.message, next_step=next_step)
    word, _, reason = live.message.partition(": ")
    return Verdict(word=word.upper(), kind="stopped", reason=reason, next_step=next_step)


def status_text(live: ChildSearch[AskedSearch] | None) -> str:
    """One line on a search; what the verdict says in large letters is not said twice."""
    if live is None:
        return "ready"
    if live.status == "ended":
        verdict = verdict_before(live, next_step="") if live.run is None else verdict_of(live.run.last)
        return f"{verdict.line}: {live.message}" if live.failed and not verdict.problem else verdict.line
    if live.status != "running" or live.run is None:
        return live.status
    view = live.run.last
    return {"turning": view.line, "dark": "measuring the noise"}.get(view.phase, view.phase)
