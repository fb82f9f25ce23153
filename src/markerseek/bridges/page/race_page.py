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
from markerseek.bridges.page.curve import race_options
from markerseek.bridges.page.elements import Chart
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import CurvePanel, FanPanel, VerdictPanel, panel
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.search_page import verdict_before
from markerseek.bridges.page.state import Snapshot
from markerseek.bridges.page.verdict import verdict_of
from markerseek.core import Interval, counted

RACERS = ("posterior", "ternary")
"""Methods that race where none are chosen: ours, and one of the paper's."""


class Lane:
    """One racer: its settings, verdict, fan and curve."""

    def __init__(self, method: str, search: Interval) -> None:
        with panel(method, "lane") as self._title:
            with ui.element("div").classes("ms-controls"):
                self._row = SettingsRow(USUAL.changed(method=method), METHOD_FIELDS)
            self._verdict = VerdictPanel()
            with ui.element("div").classes("ms-lane"):
                self._fan, self._curve = FanPanel(search), CurvePanel(search)

    @property
    def usable(self) -> bool:
        """Whether a search can have its settings."""
        return self._row.usable

    def settings(self, shared: AskedSearch) -> AskedSearch:
        """Settings of this racer, with those that both share."""
        own = self._row.settings.values
        return shared.changed(**{name: own[name] for name in METHOD_FIELDS})

    def show(self, live: ChildSearch, *, reveal: bool, leads: bool) -> None:
        """Show where the racer is."""
        self._title.classes(replace="ms-title ms-leads" if leads else "ms-title")
        if live.run is None:
            self._fan.clear()
            self._curve.clear()
            self._verdict.show(verdict_before(live, next_step=""))
            return
        snapshot = live.run.snapshots[-1]
        self._fan.show(live.run, snapshot, reveal=reveal)
        self._curve.show(live.run, snapshot, reveal=reveal)
        self._title.set_text(("FIRST: " if leads else "") + counts_text(live.run, snapshot))
        self._verdict.show(verdict_of(snapshot))


def counts_text(run: RunHistory, snapshot: Snapshot) -> str:
    """What counts in a race; it names what was run, because the fields may have been changed since."""
    return (
        f"{run.name}: {counted(snapshot.acquisitions, 'acquisition')}, {snapshot.travel_deg:.0f}° of rotation, "
        f"{snapshot.elapsed_s:.0f} s (virtual)"
    )


def leader(runs: tuple[ChildSearch, ...]) -> ChildSearch | None:
    """Who found the marker first, by the clocks of the rigs; None while another may still be, and without a result."""
    if any(each.status == "ended" and not (each.outcome and each.outcome.answered) for each in runs):
        return None
    found = [each for each in runs if each.run is not None and each.outcome and each.outcome.exit_code == 0]
    # The paper's form of a method always answers: it claims nothing, and cannot win.
    claimed = [each for each in found if each.run is not None and not each.run.configuration.plan.as_published]
    first = min(claimed, key=_elapsed_s, default=None)
    if first is None or any(each.status != "ended" and _elapsed_s(each) < _elapsed_s(first) for each in runs):
        return None
    return first


def _elapsed_s(live: ChildSearch) -> float:
    return 0.0 if live.run is None else live.run.snapshots[-1].elapsed_s


def race_verdict(runs: tuple[ChildSearch, ...]) -> str:
    """How the race stands; empty before anybody leads."""
    over = bool(runs) and all(each.status == "ended" for each in runs)
    if over and not all(each.outcome and each.outcome.answered for each in runs):
        return "no result: stopped, or ended by a fault"
    first = leader(runs)
    if first is not None and first.run is not None:
        return f"{first.run.configuration.plan.method} is first, after {_elapsed_s(first):.0f} s (virtual)"
    if not over:
        return ""
    found = any(each.outcome is not None and each.outcome.exit_code == 0 for each in runs)
    return "nothing is claimed" if found else "no marker was found"


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
        shared = SettingsRow(settings, RIG_FIELDS, problems=problems, on_change=hold_in_link("/race"))
        verdict_label = ui.label("").classes("ms-interval").props('role="status"')
    with ui.element("div").classes("ms-lanes"):
        lanes = [Lane(method, searches.rig.search) for method in RACERS]
    with panel("both on one clock: where the probes are", "clock"):
        clock = Chart(race_options({}, searches.rig.search), said="angles of both probes over the time")
    shown: tuple[object, ...] = ()
    frame.on_click(start, lambda: searches.start_race(*(lane.settings(shared.settings) for lane in lanes)))

    def update() -> None:
        nonlocal shown
        start.set_enabled(not searches.busy and shared.usable and all(each.usable for each in lanes))
        over = all(each.status == "ended" for each in searches.race)
        first = leader(searches.race)
        for lane, live in zip(lanes, searches.race, strict=False):
            lane.show(live, reveal=over, leads=live is first)
        runs = [each.run for each in searches.race if each.run is not None]
        tracks = [tuple(each.snapshots) for each in runs]
        if (key := (*runs, *map(len, tracks))) != shown:
            shown = key
            names = [f"{place}: {each.name}" for place, each in enumerate(runs, start=1)]
            clock.show(race_options(dict(zip(names, tracks, strict=True)), searches.rig.search))
        verdict_label.set_text(race_verdict(searches.race))
        alarms = any(each.failed for each in searches.race)
        frame.show_status("ready" if not searches.race else "over" if over else "running", alarms=alarms)

    frame.run(update)
