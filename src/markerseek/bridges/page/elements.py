"""The page's own elements: slider, headings, fan, image, and the beat that shows whether the program is alive."""

from __future__ import annotations

from typing import Any

from nicegui import ui
from nicegui.elements.mixins.text_element import TextElement


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


class Image(Drawn, component="static/image.js"):
    """The photoacoustic image."""


class Heartbeat(Drawn, component="static/beat.js"):
    """Reports to the browser that the program lives; if no beat comes for a second, the browser says so."""
