"""The controls of a search: its settings, start, pause, go on, and the link that holds the settings."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from markerseek.bridges.page.frame import Frame
from markerseek.bridges.page.settings import REAL_TIME_READOUT_S, SONIXDAQ_READOUT_S, PageSettings
from markerseek.core import ConfigError
from markerseek.search import METHODS
from markerseek.sim import TISSUES

PACES = {1.0: "real time", 0.2: "5 × faster", 0.05: "20 × faster", 0.01: "100 × faster", 0.0: "no waiting"}
"""Speeds that can be chosen for a simulated rig, by their pace."""

READOUTS = {SONIXDAQ_READOUT_S: "SonixDAQ (10 s)", REAL_TIME_READOUT_S: "real-time receiver"}
"""Receivers that can be chosen, by the time in seconds to read one acquisition."""


class SettingsRow:
    """Fields for the settings of one search.

    Parameters
    ----------
    settings
        The settings at first.
    simulated
        Whether the rig is simulated; else only the method can be chosen.
    on_change
        Called with the settings after each change that can be used.
    """

    def __init__(
        self, settings: PageSettings, *, simulated: bool, on_change: Callable[[PageSettings], None] | None = None
    ) -> None:
        self.settings = settings
        self._on_change = on_change
        self._select("method", {each.name: each.name for each in METHODS}, "method").style("width: 150px")
        self._number("acquisitions", "acquisitions").style("width: 92px")
        ui.checkbox(
            "as published",
            value=settings.as_published,
            on_change=lambda event: self._set("as_published", event.value),
        ).props("dense").tooltip("the paper's form of the method, which always answers")
        if simulated:
            self._select("tissue", {None: "as the rig"} | {name: name for name in TISSUES}, "tissue").style(
                "width: 128px"
            )
            self._number("peak_snr_db", "SNR [dB]").style("width: 84px")
            self._number("seed", "seed").style("width: 66px")
            self._select("readout_s", {None: "as the rig"} | READOUTS, "receiver").style("width: 134px")
            self._select("pace", PACES, "speed").style("width: 116px")

    def _select(self, name: str, options: dict[Any, str], label: str) -> ui.select:
        value = getattr(self.settings, name)
        # A link may hold a value that is not in the list.
        known = options if value in options else {**options, value: f"{value:g}"}
        return (
            ui.select(known, value=value, label=label, on_change=lambda event: self._set(name, event.value))
            .props("dense outlined options-dense")
            .mark(f"setting-{name}")
        )

    def _number(self, name: str, label: str) -> ui.number:
        whole = name != "peak_snr_db"

        def change(value: float | None) -> None:
            self._set(name, None if value is None else int(value) if whole and value == int(value) else value)

        return (
            ui.number(label, value=getattr(self.settings, name), on_change=lambda event: change(event.value))
            .props('dense outlined debounce=300 placeholder="usual" stack-label')
            .mark(f"setting-{name}")
        )

    def _set(self, name: str, value: object) -> None:
        try:
            self.settings = self.settings.changed(name, value)
        except (ConfigError, TypeError) as problem:
            ui.notify(str(problem), type="negative", multi_line=True)
            return
        if self._on_change is not None:
            self._on_change(self.settings)


class SearchControls:
    """Settings and commands of the search page.

    Parameters
    ----------
    frame
        The page.
    settings
        The settings at first, from the link.
    """

    def __init__(self, frame: Frame, settings: PageSettings) -> None:
        self._desk = frame.desk
        with ui.element("div").classes("ms-controls"):
            self._row = SettingsRow(settings, simulated=self._desk.rig.simulated, on_change=_hold_in_link)
            self._start = ui.button("Start", icon="play_arrow").props("dense padding='6px 14px'").mark("start")
            self._pause = ui.button("Pause", icon="pause").props("dense outline padding='6px 10px'").mark("pause")
        frame.on_click(self._start, lambda: self._desk.start(self._row.settings))
        frame.on_click(self._pause, self._pause_or_go_on)

    @property
    def settings(self) -> PageSettings:
        """The settings now."""
        return self._row.settings

    def update(self) -> None:
        """Show what can be pressed now."""
        busy = self._desk.busy
        self._start.set_enabled(not busy)
        self._pause.set_enabled(busy or self._desk.paused)
        self._pause.set_text("Pause" if busy else "Go on")

    def _pause_or_go_on(self) -> None:
        if self._desk.busy:
            self._desk.stop()
        else:
            self._desk.go_on()


def _hold_in_link(settings: PageSettings) -> None:
    query = settings.query()
    ui.navigate.history.replace(f"/?{query}" if query else "/")
