"""The page's own elements: slider, fan, image, and the beat that shows whether the program is alive."""

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


class Chart(ui.echart):
    """A chart as SVG, which the style sheet colours.

    ``said``: what it shows, for those who hear the page.
    """

    def __init__(self, options: dict[str, Any], *, said: str) -> None:
        super().__init__(options, renderer="svg")
        self.props(f'role="img" aria-label="{said}"').classes("ms-chart")

    def show(self, options: dict[str, Any]) -> None:
        """Send other options, if they differ."""
        if options != self.options:
            self.options.clear()
            self.options.update(options)
            self.update()


class Fan(ui.element, component="static/fan.js"):
    """The probe from its end, with the probability of the marker over the angle."""

    def __init__(self, model: dict[str, Any]) -> None:
        super().__init__()
        self._props["view"] = model

    def show(self, model: dict[str, Any]) -> None:
        """Send another state, if it differs."""
        if self._props["view"] != model:
            self._props["view"] = model


class Image(ui.element, component="static/image.js"):
    """The photoacoustic image, over a background."""

    def __init__(self, model: dict[str, Any]) -> None:
        super().__init__()
        self._props["view"] = model
        self._props["background"] = {}

    def show(self, model: dict[str, Any], background: dict[str, Any]) -> None:
        """Send another image and its background, if they differ."""
        if self._props["background"] != background:
            self._props["background"] = background
        if self._props["view"] != model:
            self._props["view"] = model


class Heartbeat(ui.element, component="static/beat.js"):
    """Reports to the browser that the program lives; where no beat comes for a second, the page says so."""

    def __init__(self) -> None:
        super().__init__()
        self._props["beat"] = 0

    def strike(self, beat: int) -> None:
        """Send the number of a new beat."""
        self._props["beat"] = beat
