"""What every page has: navigation, the banner that says what is simulated, STOP, and the beat."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from nicegui import ui
from nicegui.events import GenericEventArguments

from markerseek.bridges.page.elements import Heading, Heartbeat
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.core import MarkerseekError, listed

TICK_S = 0.1
"""Least time between two updates of one viewer, and longest time without one, in seconds."""

BEAT_S = 0.4
"""Time between two beats, in seconds."""

STALE_S = 2.0
"""Age of the news behind a command beyond which it is refused, in seconds: the second after which the browser itself
switches commands off, and one for the way."""

_BANNERS = {
    True: ("simulated", "SIMULATED: no hardware is involved"),
    False: ("bench", "A RIG OF DEVICES: armed only in the terminal of the page"),
}
"""Class and text of the banner, by whether the rig is simulated."""

_STYLE = (Path(__file__).parent / "static" / "page.css").read_text(encoding="utf-8")

PAGES = {"/": "register", "/search": "search"}
"""Paths of the pages, and their names."""


class PageShell:
    """Top of a page, and its one timer."""

    def __init__(self, searches: PageSearches, path: str) -> None:
        self.searches = searches
        self.viewer = f"a browser at {ui.context.client.ip}"
        self._changed = searches.changes.subscribe()
        # The first tick sends one, so that a page that has just connected may be used.
        self._beat_s = -math.inf
        self._update: Callable[[], None] = lambda: None
        ui.page_title(f"markerseek: {PAGES[path]}")
        ui.add_css(_STYLE)
        self._dark = ui.dark_mode(value=None)
        self._beat = Heartbeat()
        self._beat.show(beat=0)
        with ui.element("header").classes("ms-head"):
            Heading("markerseek", level=1).classes("ms-name")
            with ui.element("nav").props('aria-label="pages"'):
                for target, name in PAGES.items():
                    if target == "/" and not searches.rig.registers:
                        continue
                    ui.link(name, target).props('aria-current="page"' if target == path else "")
            self._status_label = ui.label("").classes("ms-status").props('role="status"').mark("status")
            ui.button("◐", on_click=self._toggle_dark).props('flat dense aria-label="dark or light"')
            # Plain HTML and a plain request: it works while the connection of the page is busy or broken.
            ui.element("button").classes("ms-stop").props('type="button" title="stops everything (Escape)"').on(
                "click", js_handler="() => window.markerseekStop()"
            ).mark("stop").props('innerHTML="STOP"')
        kind, self._kind_said = _BANNERS[searches.rig.simulated]
        self._banner = ui.label(self._kind_said).classes(f"ms-banner ms-banner-{kind}")

    def show_emulated(self, devices: Sequence[str]) -> None:
        """Say in the banner which devices of the rig are emulated."""
        self._banner.set_text((f"EMULATED {listed(devices)}. " if devices else "") + self._kind_said)

    def show_status(self, text: str, *, alarms: bool = False) -> None:
        """Say in one line what happens, or how it ended; in bold red where a person must see to it."""
        if text != self._status_label.text:
            # Two lines of it are seen; the pointer shows the rest.
            self._status_label.props["title"] = text
            self._status_label.classes(replace="ms-status ms-alarm" if alarms else "ms-status")
            self._status_label.set_text(text)

    def run(self, update: Callable[[], None]) -> None:
        """Call a function after news, and at least once in `TICK_S`; it must send only what has changed."""
        self._update = update
        # It waits by itself: news is shown at once, and not up to a tick later.
        ui.timer(0.0, self._tick)

    async def _tick(self) -> None:
        if time.monotonic() - self._beat_s >= BEAT_S:
            # The browser sends it back with each command.
            self._beat_s = time.monotonic()
            self._beat.show(beat=self._beat_s)
        has_changed = self._changed.is_set()
        self._changed.clear()
        self._update()
        if has_changed:
            # Events may come faster than anybody can see them.
            await asyncio.sleep(TICK_S)
        with suppress(TimeoutError):
            await asyncio.wait_for(self._changed.wait(), TICK_S)

    def on_click(self, element: ui.element, handler: Callable[[], None]) -> None:
        """Run a command at a click, unless the page that was clicked on shows old things.

        ``handler``: the command; its errors are shown.
        """

        def checked(event: GenericEventArguments) -> None:
            seen_s = event.args if isinstance(event.args, int | float) else -math.inf
            if time.monotonic() - seen_s > STALE_S:
                ui.notify("this page had no news for a second: look again, then press", type="warning")
                return
            try:
                handler()
            except (MarkerseekError, OSError) as problem:
                ui.notify(str(problem), type="negative", multi_line=True)
            self._changed.set()

        element.classes("ms-command")
        element.on("click", checked, js_handler="() => emit(window.markerseekBeat)")

    async def _toggle_dark(self) -> None:
        # At first it is as the system has it, which only the browser knows.
        self._dark.value = not await ui.run_javascript("document.body.classList.contains('body--dark')")
