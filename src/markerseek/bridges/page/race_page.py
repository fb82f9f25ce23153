"""The race: two methods search the same simulated scene side by side, on the same clock."""

from __future__ import annotations

from nicegui import ui

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.page.child_search import ChildSearch
from markerseek.bridges.page.controls import (
    METHOD_FIELDS,
    RIG_FIELDS,
    USUAL,
    LinkSettings,
    SettingsRow,
    hold_in_link,
    start_button,
)
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import RunPanels, VerdictPanel, panel
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.search_page import verdict_before
from markerseek.core import Interval, counted
from markerseek.records import tracks_svg
from markerseek.runs import verdict_of

RACERS = ("posterior", "ternary")
"""Methods that race if none are chosen: ours, and one of the paper's."""


class Lane:
    """One racer: its settings, verdict, fan and curve."""

    def __init__(self, method: str, search: Interval) -> None:
        with panel(method, "lane") as self._title:
            with ui.element("div").classes("ms-controls"):
                self.row = SettingsRow(USUAL.changed(method=method), METHOD_FIELDS, usual=USUAL)
            self._verdict = VerdictPanel()
            self._panels = RunPanels(search, lane=True)

    def settings(self, shared: AskedSearch) -> AskedSearch:
        """Settings of this racer, with those that both share."""
        own = self.row.settings.values
        return shared.changed(**{name: own[name] for name in METHOD_FIELDS})

    def show(self, live: ChildSearch[AskedSearch], *, reveal: bool, leads: bool) -> None:
        """Show where the racer is."""
        self._title.classes(replace="ms-title ms-leads" if leads else "ms-title")
        if live.run is None:
            self._panels.clear()
            self._verdict.show(verdict_before(live, next_step=""))
            return
        self._panels.show(live.run, live.run.last, reveal=reveal)
        self._title.set_text(("FIRST: " if leads else "") + counts_text(live.run))
        self._verdict.show(verdict_of(live.run.last))


def counts_text(run: RunHistory) -> str:
    """What counts in a race; it names what was run, because the fields may have been changed since."""
    view = run.last
    return (
        f"{run.name}: {counted(view.acquisitions, 'acquisition')}, {view.travel_deg:.0f}° of rotation, "
        f"{view.elapsed_s:.0f} s (virtual)"
    )


def leader(runs: tuple[ChildSearch[AskedSearch], ...]) -> ChildSearch[AskedSearch] | None:
    """Who found the marker first, by the clocks of the rigs; None while another may still be, and without a result."""
    if any(each.status == "ended" and not (each.outcome and each.outcome.answered) for each in runs):
        return None
    # The paper's form of a method always answers: it claims nothing, and cannot win.
    claimed = (each for each in runs if _found(each) and each.run and not each.run.last.plan.as_published)
    first = min(claimed, key=_elapsed_s, default=None)
    if first is None or any(each.status != "ended" and _elapsed_s(each) < _elapsed_s(first) for each in runs):
        return None
    return first


def _found(live: ChildSearch[AskedSearch]) -> bool:
    return live.run is not None and live.outcome is not None and live.outcome.exit_code == 0


def _elapsed_s(live: ChildSearch[AskedSearch]) -> float:
    return 0.0 if live.run is None else live.run.last.elapsed_s


def race_verdict(runs: tuple[ChildSearch[AskedSearch], ...]) -> str:
    """How the race stands; empty before anybody leads."""
    over, first = bool(runs) and all(each.status == "ended" for each in runs), leader(runs)
    if first is not None and first.run is not None:
        return f"{first.run.last.plan.method} is first, after {_elapsed_s(first):.0f} s (virtual)"
    if not over:
        return ""
    if not all(each.outcome and each.outcome.answered for each in runs):
        return "no result: stopped, or ended by a fault"
    return "nothing is claimed" if any(map(_found, runs)) else "no marker was found"


def build_race_page(searches: PageSearches, link: LinkSettings) -> None:
    """Build the page for one viewer.

    ``link``: the settings of the rig at first.
    """
    frame = PageShell(searches, "/race")
    if not searches.rig.simulated:
        ui.label("A race needs two rigs: start markerseek page without --rig.").classes("ms-help")
        frame.run(lambda: None)
        return
    settings, problems = link
    with ui.element("div").classes("ms-controls"):
        start = start_button("Start the race")
        shared = SettingsRow(
            settings,
            ("seed", *RIG_FIELDS),
            usual=USUAL,
            problems=problems,
            on_change=hold_in_link("/race", USUAL),
        )
        result = ui.label("").classes("ms-interval").props('role="status"')
    with ui.element("div").classes("ms-lanes"):
        lanes = [Lane(method, searches.rig.search) for method in RACERS]
    with panel("both on one clock: where the probes are", "clock"):
        clock = ui.html(sanitize=False).classes("ms-chart ms-clock")
    shown: tuple[ChildSearch[AskedSearch], ...] = ()
    drawn: list[tuple[RunHistory, int]] = []
    frame.on_click(start, lambda: searches.start_race(*(lane.settings(shared.settings) for lane in lanes)))

    def update() -> None:
        nonlocal shown, drawn
        race = searches.race
        start.set_enabled(not searches.busy and all(row.usable for row in (shared, *(each.row for each in lanes))))
        over = all(each.status == "ended" for each in race)
        first = leader(race)
        for lane, live in zip(lanes, race, strict=False):
            lane.show(live, reveal=over, leads=live is first)
            if race is not shown:
                shared.follow(live.asked)
                lane.row.follow(live.asked)
        shown = race
        runs = [each.run for each in race if each.run is not None]
        if drawn != (drawn := [(each, len(each.views)) for each in runs]) or not clock.content:
            limits = searches.rig.search
            tracks = {f"{place}: {each.name}": _track(each) for place, each in enumerate(runs, start=1)}
            clock.set_content(tracks_svg(tracks, range_deg=(limits.low_deg, limits.high_deg)))
        result.set_text(race_verdict(race))
        alarms = any(each.failed for each in race)
        frame.show_status("ready" if not race else "over" if over else "running", alarms=alarms)

    frame.run(update)


def _track(run: RunHistory) -> list[tuple[float, float]]:
    """Time and angle of each readback."""
    return [
        (each.elapsed_s, each.probe_deg) for each in run.views if each.probe_deg is not None and each.target_deg is None
    ]
