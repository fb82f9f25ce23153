"""The page that replays recordings: a finished journal event by event, or a search on a recorded bank."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import msgspec
from nicegui import run, ui

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.page.child_search import ChildSearch
from markerseek.bridges.page.controls import METHOD_FIELDS, USUAL, SettingsRow, start_button
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import RunPlayer, VerdictPanel
from markerseek.bridges.page.results import ResultRow
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.search_page import status_text, verdict_before
from markerseek.core import MarkerseekError
from markerseek.records import with_minus
from markerseek.records.journal import is_journal, read_journal, summary


class ReplayPage:
    """The replay of one viewer.

    ``recording``: name in the link of the recording that is shown at first; empty for none.
    """

    def __init__(self, searches: PageSearches, recording: str) -> None:
        self._searches = searches
        self._message = "choose a recording"
        self._frame = PageShell(searches, "/replay")
        # Names only: the browser never sends a path.
        self._recordings: dict[str, Path] = {}
        try:
            self._recordings = searches.recordings()
        except (MarkerseekError, OSError) as problem:
            self._message = str(problem)
        self._verdict = VerdictPanel()
        with ui.element("div").classes("ms-controls"):
            names = {name: name for name in self._recordings}
            self._chosen = ui.select(names, label="recording", with_input=True, on_change=self._choose)
            self._chosen.props("dense outlined options-dense").classes("ms-recording")
            with ui.element("div").classes("ms-controls") as self._methods:
                search = start_button("Search it")
                self._row = SettingsRow(USUAL, METHOD_FIELDS, usual=USUAL)
        self._methods.visible = False
        self._frame.on_click(search, self._search_bank)
        self._player = RunPlayer(searches.rig.search, self._verdict, playable=True)
        self._show_nothing()
        self._results = ResultRow()
        if recording in self._recordings:
            self._chosen.set_value(recording)
        elif recording:
            self._message = f"link: {recording[:80]!r} is no recording here; choose one from the list"
        ui.timer(0.0, self._describe, once=True)
        self._frame.run(self._update)

    async def _describe(self) -> None:
        """Add to each name what is known of the recording."""
        described = await run.io_bound(lambda: {name: described_of(path) for name, path in self._recordings.items()})
        # None while the program ends.
        if described is not None:
            options = {name: ": ".join(filter(None, (name, text))) for name, text in described.items()}
            self._chosen.set_options(options, value=self._chosen.value)

    def _show_nothing(self) -> None:
        """Forget the recording before."""
        self._run: RunHistory | None = None
        self._live: ChildSearch[AskedSearch] | None = None
        self._answer: Mapping[str, Any] | None = None
        self._journal: Path | None = None
        self._frame.show_kind("replayed")
        self._player.clear()

    async def _choose(self) -> None:
        path = self._recordings.get(self._chosen.value)
        if path is None:
            return
        self._show_nothing()
        ui.navigate.history.replace(f"/replay?{urlencode({'recording': self._chosen.value})}")
        try:
            is_run = path.is_file() and is_journal(path)
            self._methods.visible = not is_run
            self._message = "choose a method, then search" if not is_run else f"reads {path.name}"
            if not is_run:
                return
            # In a thread: images of all acquisitions are formed. None while the program ends.
            read = await run.io_bound(_read, path)
            # Another recording may have been chosen since.
            if read is not None and self._recordings.get(self._chosen.value) == path:
                self._run, self._answer = read
                self._journal, self._message = path, self._run.last.facts.description
        except (MarkerseekError, OSError) as problem:
            if self._recordings.get(self._chosen.value) == path:
                self._message = str(problem)

    def _search_bank(self) -> None:
        self._show_nothing()
        self._live = self._searches.replay(self._chosen.value, self._row.settings)

    def _update(self) -> None:
        if self._live is not None:
            self._run, self._message = self._live.run, status_text(self._live)
            self._answer = None if self._live.outcome is None else self._live.outcome.answer
        waits = self._run is None and self._live is None
        alarms = self._live is not None and self._live.failed
        self._frame.show_status("ready" if waits else self._message, alarms=alarms)
        self._results.show(self._answer, self._journal)
        if self._run is None:
            self._verdict.show(verdict_before(self._live, next_step=self._message if waits else ""))
        else:
            facts = self._run.last.facts
            # Nothing moves here, also where the recording is one of devices.
            self._frame.show_kind("simulated" if facts.kind == "simulated" else "replayed", emulated=facts.emulated)
            self._player.show(self._run, reveal=True)


def described_of(path: Path) -> str:
    """Answer, seed and tissue of the run in a journal; empty for a bank, and for what cannot be read."""
    if not (path.is_file() and is_journal(path)):
        return ""
    found = summary(path)
    return with_minus("; ".join(filter(None, (found.end, found.description))))


def _read(path: Path) -> tuple[RunHistory, dict[str, Any] | None]:
    """The run of a journal, and its result if it is over."""
    shown = RunHistory.of(read_journal(path))
    return shown, None if shown.last.finished is None else msgspec.to_builtins(shown.last.result())
