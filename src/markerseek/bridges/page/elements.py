"""The page's own elements: slider, fan, image, and the beat that shows whether the program is alive."""

from __future__ import annotations

from typing import Any

from nicegui import ui


class Slider(ui.slider):
    """A slider that moves at once: if values came back from the server, the next key would start from an old one."""

    LOOPBACK: bool | None = False


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
    """Tells the browser that the program lives; where no beat comes for a second, the page says so."""

    def __init__(self, beat: int) -> None:
        super().__init__()
        self._props["beat"] = beat

    def strike(self, beat: int) -> None:
        """Send the number of a new beat."""
        self._props["beat"] = beat
