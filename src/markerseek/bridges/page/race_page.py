"""The race: two methods search the same simulated scene side by side, on the same clock."""

from __future__ import annotations

from dataclasses import replace

from nicegui import ui

from markerseek.bridges.page.child_search import ChildSearch
from markerseek.bridges.page.controls import METHOD_FIELDS, RIG_FIELDS, SettingsRow, hold_in_link
from markerseek.bridges.page.models import angle_text, answer_text
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import FanPanel
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.settings import PageSettings
from markerseek.bridges.page.state import Snapshot
from markerseek.core import Interval

RACERS = ("posterior", "ternary")
"""Methods that race where none are chosen: ours, and one of the paper's."""


class Lane:
    """One racer: its settings, fan and counters."""

    def __init__(self, method: str, search: Interval) -> None:
        with ui.element("section").classes("ms-panel"):
            with ui.element("div").classes("ms-controls"):
                self._row = SettingsRow(PageSettings(method=method), METHOD_FIELDS)
            self._fan = FanPanel(search)
            self._counts = ui.label("").classes("ms-counts")
            self._angle = ui.label("–").classes("ms-angle")
            self._answer = ui.label("").classes("ms-answer")

    def settings(self, shared: PageSettings) -> PageSettings:
        """Settings of this racer, with those that both share."""
        own = self._row.settings
        return replace(shared, **{name: getattr(own, name) for name in METHOD_FIELDS})

    def show(self, live: ChildSearch, *, reveal: bool) -> None:
        """Show where the racer is."""
        if live.run is None:
            self._fan.clear()
            self._counts.set_text(live.message or live.status)
            self._angle.set_text("–")
            self._answer.set_text("")
            return
        snapshot = live.run.snapshots[-1]
        self._fan.show(live.run, snapshot, reveal=reveal)
        self._counts.set_text(counts_text(live.run, snapshot))
        self._angle.set_text(angle_text(snapshot))
        self._answer.set_text(live.message if live.failed else answer_text(snapshot))


def counts_text(run: RunHistory, snapshot: Snapshot) -> str:
    """What counts in a race; it names what was run, because the fields may have been changed since."""
    return (
        f"{run.name}: {snapshot.acquisitions} acquisitions, {snapshot.travel_deg:.0f}° of rotation, "
        f"{snapshot.elapsed_s:.0f} s (virtual)"
    )


def verdict(runs: tuple[ChildSearch, ...]) -> str:
    """Who is through first, by the rigs' own clocks; empty until all are over."""
    if not runs or any(each.status != "ended" for each in runs):
        return ""
    if any(each.outcome is None or not each.outcome.answered for each in runs):
        return "no result: stopped, or ended by a fault"
    found = [each.run for each in runs if each.run is not None and each.outcome and each.outcome.exit_code == 0]
    # The paper's form of a method always answers: it claims nothing, and cannot win.
    claimed = [each for each in found if not each.configuration.plan.as_published]
    if not claimed:
        return "no marker was found" if not found else "nothing is claimed"
    winner = min(claimed, key=lambda each: each.snapshots[-1].elapsed_s)
    return f"{winner.configuration.plan.method} is first, after {winner.snapshots[-1].elapsed_s:.0f} s (virtual)"


def build_race_page(searches: PageSearches, settings: PageSettings) -> None:
    """Build the page for one viewer.

    ``settings``: the settings of the rig at first, from the link.
    """
    frame = PageShell(searches, "/race")
    if not searches.rig.simulated:
        ui.label("A race needs two rigs: start markerseek page without --rig.").classes("ms-help")
        frame.run(lambda: None)
        return
    with ui.element("div").classes("ms-controls"):
        shared = SettingsRow(settings, RIG_FIELDS, on_change=hold_in_link("/race"))
        start = ui.button("Start the race", icon="play_arrow").props("dense padding='6px 14px'")
        verdict_label = ui.label("").classes("ms-answer")
    with ui.element("div").classes("ms-lanes"):
        lanes = [Lane(method, searches.rig.search) for method in RACERS]
    frame.on_click(start, lambda: searches.start_race(*(lane.settings(shared.settings) for lane in lanes)))

    def update() -> None:
        start.set_enabled(not searches.busy)
        over = all(each.status == "ended" for each in searches.race)
        for lane, live in zip(lanes, searches.race, strict=False):
            lane.show(live, reveal=over)
        verdict_label.set_text(verdict(searches.race))
        alarms = any(each.failed for each in searches.race)
        frame.show_status("ready" if not searches.race else "over" if over else "running", alarms=alarms)

    frame.run(update)
