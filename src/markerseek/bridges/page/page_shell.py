"""What every page has: its own elements, navigation, the banner that says what is simulated, STOP, and the beat."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement
from nicegui.events import GenericEventArguments

from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.run_history import RunHistory
from markerseek.core import MarkerseekError, listed, plain


class Slider(ui.slider):
    """A slider that moves at once: if values came back from the server, the next key would start from an old one."""

    LOOPBACK: bool | None = False


class Heading(TextElement):
    """A heading; ``level``: 1 for the page, 2 for a panel."""

    def __init__(self, text: str, *, level: int) -> None:
        super().__init__(tag=f"h{level}", text=text)


class Drawn(ui.element):
    """An element that the browser draws from values; each is sent only if it has changed."""

    def show(self, **values: Any) -> None:
        """Send other values."""
        for name, value in values.items():
            if self._props.get(name) != value:
                self._props[name] = value


class Fan(Drawn, component="static/fan.js"):
    """The probe from its end, with the probability of the marker over the angle."""


class ImageView(Drawn, component="static/image.js"):
    """The photoacoustic image."""


class LifeSign(Drawn, component="static/beat.js"):
    """Reports to the browser that the program lives; if no beat comes for a second, the browser says so."""


TICK_S = 0.1
"""Time between two updates of one viewer, in seconds."""

_BEAT_S = 0.4
"""Time between two beats, in seconds."""

STALE_S = 2.0
"""Age of the news behind a command beyond which it is refused, in seconds: the second after which the browser itself
switches commands off, and one for the way."""

_PLACE_IN_DRAWING = """(event) => {
    const drawing = event.currentTarget.querySelector("svg");
    if (!drawing) return;
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(drawing.getScreenCTM().inverse());
    emit([at.x, at.y, window.markerseekBeat]);
}"""
"""Sends the place of a click in the coordinates of the drawing that the element holds."""

_BANNERS = {
    "simulated": "SIMULATED: no hardware is involved",
    "bench": "A RIG OF DEVICES: armed only in the terminal of the page",
}

_STYLE = (Path(__file__).parent / "static" / "page.css").read_text(encoding="utf-8")

PAGES = {"/": "register", "/sessions": "sessions", "/search": "search"}
"""Paths of the pages, and their names."""


class PageShell:
    """Top of a page, and its one timer."""

    def __init__(self, searches: PageSearches, path: str) -> None:
        self.searches = searches
        client = ui.context.client
        self.viewer = f"a browser at {client.ip}"
        self.prefix: str = client.request.scope["root_path"]
        """Path in front of all paths of the page, behind a proxy."""
        # The first tick sends one, so that a page that has just connected may be used.
        self._beat_s = -math.inf
        ui.page_title(f"markerseek: {PAGES[path]}")
        ui.add_css(_STYLE)
        self._dark = ui.dark_mode(value=None)
        self._beat = LifeSign()
        self._beat.show(beat=0)
        with ui.element("header").classes("ms-head"):
            Heading("markerseek", level=1).classes("ms-name")
            with ui.element("nav").props('aria-label="pages"'):
                for target, name in PAGES.items():
                    if target != "/search" and not searches.rig.registers:
                        continue
                    ui.link(name, target).props('aria-current="page"' if target == path else "")
            ui.button("◐", on_click=self._toggle_dark).props('flat dense aria-label="dark or light"')
            # Plain HTML and a plain request: it works while the connection of the page is busy or broken.
            ui.element("button").classes("ms-stop").props('type="button" title="stops everything (Escape)"').on(
                "click", js_handler="() => window.markerseekStop()"
            ).props('innerHTML="STOP"')
        self._kind = "simulated" if searches.rig.simulated else "bench"
        self._banner = ui.label(_BANNERS[self._kind]).classes(f"ms-banner ms-banner-{self._kind}")

    def show_emulated(self, run: RunHistory | None) -> None:
        """Say in the banner which devices of the run's rig are emulated."""
        devices = run.last.facts.emulated if run else ()
        self._banner.set_text((f"EMULATED {listed(devices)}. " if devices else "") + _BANNERS[self._kind])

    def run(self, update: Callable[[], None]) -> None:
        """Call a function again and again; it must send only what has changed."""

        def tick() -> None:
            if time.monotonic() - self._beat_s >= _BEAT_S:
                # The browser sends it back with each command.
                self._beat_s = time.monotonic()
                self._beat.show(beat=self._beat_s)
            update()

        ui.timer(TICK_S, tick)

    def on_click(self, element: ui.element, handler: Callable[[], None]) -> None:
        """Run a command at a click, unless the page that was clicked on shows old things.

        ``handler``: the command; its errors are shown.
        """

        def checked(event: GenericEventArguments) -> None:
            self._run_checked(event.args, handler)

        element.classes("ms-command")
        element.on("click", checked, js_handler="() => emit(window.markerseekBeat)")

    def on_point(self, element: ui.element, handler: Callable[[float, float], None]) -> None:
        """Run a command at a click into the drawing of an element, as of `on_click`.

        ``handler``: the command; it gets the place in the coordinates of the drawing.
        """

        def checked(event: GenericEventArguments) -> None:
            match event.args:
                case [int() | float() as x, int() | float() as y, seen_s]:
                    self._run_checked(seen_s, lambda: handler(float(x), float(y)))

        element.on("click", checked, js_handler=_PLACE_IN_DRAWING)

    def _run_checked(self, seen_s: object, command: Callable[[], None]) -> None:
        """Run a command unless the page that was clicked on shows old things; ``seen_s``: the last beat that it saw."""
        if time.monotonic() - (seen_s if isinstance(seen_s, int | float) else -math.inf) > STALE_S:
            ui.notify("this page had no news for a second: look again, then press", type="warning")
            return
        try:
            command()
        except (MarkerseekError, OSError) as problem:
            ui.notify(plain(str(problem)), type="negative", multi_line=True)

    async def _toggle_dark(self) -> None:
        # At first it is as the system has it, which only the browser knows.
        self._dark.value = not await ui.run_javascript("document.body.classList.contains('body--dark')")
