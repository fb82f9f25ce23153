"""The page of the registration sessions that are kept: open one, go on with it, take its report, delete it."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from functools import partial
from pathlib import Path

from nicegui import ui

from markerseek.bridges.page.controls import USUAL_REGISTRATION
from markerseek.bridges.page.page_searches import Further, PageSearches
from markerseek.bridges.page.page_shell import Heading, PageShell
from markerseek.bridges.page.report_buttons import report_button
from markerseek.bridges.page.reports import make_session_report
from markerseek.core import counted
from markerseek.registration import KeptSession
from markerseek.show import with_minus

SHOWN = 50
"""Most sessions that are listed, the newest."""

FURTHER: tuple[tuple[Further, str, str], ...] = (
    ("go on", "play_arrow", "Go on with it: it was stopped before its end."),
    ("one more marker", "add_location", "Go on with it for one more marker, whatever its error."),
    ("check", "rule", "Check it by one more spot that takes no part in the registration."),
)
"""How a session can be continued: its name, its icon, and what it does."""


class SessionCards:
    """A card for each session that is kept."""

    def __init__(self, shell: PageShell) -> None:
        self._shell = shell
        self._searches = shell.searches
        self._commands: list[ui.button] = []
        self._shown: list[KeptSession] | None = None
        with ui.element("div").classes("ms-sessions") as self._list:
            pass

    def update(self) -> None:
        """Show the sessions again if any has changed."""
        kept = self._searches.kept_sessions()[:SHOWN]
        if kept != self._shown:
            self._shown = kept
            self._list.clear()
            self._commands = []
            with self._list:
                if not kept:
                    ui.label("No session is kept yet: register begins one.").classes("ms-note")
                for each in kept:
                    self._add(each)
        for button in self._commands:
            button.set_enabled(not self._searches.busy)

    def _add(self, kept: KeptSession) -> None:
        folder = Path(kept.folder)
        with ui.element("section").classes("ms-panel ms-kept").props(f'aria-label="session of {_when(kept)}"'):
            Heading(f"{_when(kept)}: {kept.state}", level=2).classes("ms-kept-title")
            ui.label(_facts(kept)).classes("ms-kept-facts")
            if not kept.registered:
                ui.label(with_minus(kept.said)).classes("ms-note")
            with ui.element("div").classes("ms-foot"):
                if kept.phase != "unreadable":
                    self._add_further(kept, folder)
                    for form in ("html", "pdf"):
                        report_button(f"report {form.upper()}", f"report.{form}", partial(make_session_report, folder))
                delete = ui.button("delete", icon="delete").props("flat dense")
                self._shell.on_click(delete, lambda: self._ask_to_delete(kept))
                self._commands.append(delete)

    def _add_further(self, kept: KeptSession, folder: Path) -> None:
        """Buttons that show a session, or continue it."""
        show = ui.button("open", icon="visibility").props("flat dense")
        self._shell.on_click(
            show, lambda: self._go_to_it(partial(self._searches.show_session, folder, usual=USUAL_REGISTRATION))
        )
        self._commands.append(show)
        for name, icon, what in FURTHER:
            if (name == "go on") == (kept.phase == "ended") or (name == "check" and not kept.registered):
                continue
            button = ui.button(name, icon=icon).props("flat dense").tooltip(what)
            further = partial(
                self._searches.continue_session,
                folder,
                name,
                usual=USUAL_REGISTRATION,
                asked_by=self._shell.viewer,
            )
            self._shell.on_click(button, partial(self._go_to_it, further))
            self._commands.append(button)

    def _go_to_it(self, begin: partial[None]) -> None:
        begin()
        ui.navigate.to(f"{self._shell.prefix}/")

    def _ask_to_delete(self, kept: KeptSession) -> None:
        """Ask, and delete the session if the answer is yes."""
        with ui.dialog(value=True) as asked, ui.card():
            ui.label(
                f"Delete the session of {_when(kept)}, with {counted(kept.markers, 'marker')}? Its record, its "
                f"journals and its images, {kept.size_bytes / 1e6:.1f} MB, are removed from the disk for good."
            )
            with ui.row():
                yes = ui.button("delete it", icon="delete", color="negative")
                ui.button("keep it", on_click=asked.close).props("flat")
        asked.on("hide", asked.delete)
        self._shell.on_click(yes, lambda: self._delete(kept, asked))

    def _delete(self, kept: KeptSession, asked: ui.dialog) -> None:
        asked.close()
        left = self._searches.delete_session(Path(kept.folder))
        if left:
            ui.notify(f"{kept.folder}: other files stayed there: {', '.join(left[:5])}", multi_line=True)


def build_sessions_page(searches: PageSearches, query: Mapping[str, str]) -> None:
    """Build the page for one viewer; ``query``: of its link, which says nothing here."""
    del query
    shell = PageShell(searches, "/sessions")
    cards = SessionCards(shell)
    shell.run(cards.update)


def _when(kept: KeptSession) -> str:
    """Return when a session began, in UTC; the name of its folder if the record does not say."""
    try:
        return f"{datetime.fromisoformat(kept.begun or ''):%Y-%m-%d %H:%M} UTC"
    except ValueError:
        # The record cannot be read, or comes from somebody else.
        return Path(kept.folder).name


def _facts(kept: KeptSession) -> str:
    """Return the rig, markers, errors and size of a session."""
    parts = [kept.rig, counted(kept.markers, "marker")] if kept.begun is not None else []
    if kept.tre_m is not None and kept.tre95_m is not None:
        parts.append(f"expected error {1e3 * kept.tre_m:.2f} mm (95 %: {1e3 * kept.tre95_m:.2f} mm)")
    if kept.off_m is not None:
        parts.append(f"{1e3 * kept.off_m:.2f} mm off at the spot that checked it")
    return "; ".join([*parts, f"{kept.size_bytes / 1e6:.1f} MB"])
