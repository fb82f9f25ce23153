"""A run with the slider over its events, which at its end follows a run that goes on."""

from __future__ import annotations

from nicegui import ui

from markerseek.bridges.page.elements import Slider
from markerseek.bridges.page.panels import Panels, VerdictPanel
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.verdict import Verdict, verdict_of
from markerseek.core import Interval
from markerseek.runs import RunView

PLAY_TICKS = 4
"""Updates of the page for which each event is shown while a run is played."""


class RunPanels:
    """Panels of a run and the slider below them; its verdict stands above, where the page has put it."""

    def __init__(self, search: Interval, verdict: VerdictPanel, *, playable: bool = False) -> None:
        self._verdict = verdict
        self._panels = Panels(search)
        self._timeline = Timeline(playable=playable)

    def clear(self) -> None:
        """Empty everything, so that facts of one run are not shown as those of the next, which may never begin."""
        self._verdict.show(Verdict())
        self._panels.clear()
        self._timeline.clear()

    def show(self, run: RunHistory, *, reveal: bool, next_step: str = "", comparison: str = "") -> None:
        """Show the event that was chosen, or the newest; the true angle only where it is to be revealed.

        ``next_step`` and ``comparison``: as for `verdict_of`.
        """
        snapshot = self._timeline.snapshot(run)
        self._verdict.show(verdict_of(snapshot, next_step=next_step, comparison=comparison))
        self._panels.show(run, snapshot, reveal=reveal)


class Timeline:
    """A slider over the events of a run.

    ``playable``: whether a button plays the run from the event shown, or from its beginning.
    """

    def __init__(self, *, playable: bool = False) -> None:
        with ui.element("div").classes("ms-foot"):
            if playable:
                self._play = ui.button(icon="play_arrow", on_click=self._toggle).props('flat dense aria-label="play"')
            self._label = ui.label("").classes("ms-note").style("min-width: 128px")
            self._slider = Slider(min=0, max=1, step=1, value=0, on_change=lambda event: self._choose(int(event.value)))
            self._slider.props('aria-label="event shown" label').mark("timeline")
            self._follow = ui.button("newest", on_click=self._to_newest).props("flat dense")
        self._playing = self._moving = False
        self.clear()

    def clear(self) -> None:
        """Forget the run."""
        if self._playing:
            self._toggle()
        self._ticks = 0
        self._run: RunHistory | None = None
        self._following = True
        self._chosen = self._last = 0
        self._slider.props["max"] = 1
        self._move(0)
        self._label.set_text("event 0 of 0")

    def snapshot(self, run: RunHistory) -> RunView:
        """The snapshot to be shown: the newest, or the one that was chosen."""
        if run is not self._run:
            self._run, self._following = run, True
        last = len(run.snapshots) - 1
        if self._playing:
            self._advance(last)
        shown = last if self._following else min(self._chosen, last)
        if last != self._last:
            self._last = last
            self._slider.props["max"] = max(last, 1)
        if self._following and self._slider.value != last:
            self._move(last)
        self._label.set_text(f"event {shown} of {last}")
        self._follow.set_enabled(not self._following)
        return run.snapshots[shown]

    def _advance(self, last: int) -> None:
        self._ticks += 1
        if self._ticks % PLAY_TICKS == 0:
            self._chosen = min(self._chosen + 1, last)
            self._following = self._chosen == last
            self._move(self._chosen)
            if self._chosen == last:
                self._toggle()

    def _toggle(self) -> None:
        self._playing = not self._playing
        self._play.props(f"icon={'pause' if self._playing else 'play_arrow'}")
        if self._playing and self._following:
            self._chosen, self._following = 0, False

    def _move(self, number: int) -> None:
        """Move the slider without choosing an event: a run may have gone on in the meantime."""
        self._moving = True
        self._slider.set_value(number)
        self._moving = False

    def _choose(self, number: int) -> None:
        if self._moving:
            return
        last = 0 if self._run is None else len(self._run.snapshots) - 1
        self._chosen, self._following = number, number >= last

    def _to_newest(self) -> None:
        if self._playing:
            self._toggle()
        self._following = True
