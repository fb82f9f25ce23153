"""The controls of a search: its settings, start, pause, go on, and the link that holds the settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from typing import Any

from nicegui import ui

from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.settings import REAL_TIME_READOUT_S, SONIXDAQ_READOUT_S, LinkSettings, PageSettings
from markerseek.core import ConfigError
from markerseek.records import with_minus
from markerseek.search import METHODS
from markerseek.sim import TISSUES

PACES = {1.0: "real time", 0.2: "5 × faster", 0.05: "20 × faster", 0.01: "100 × faster", 0.0: "no waiting"}
"""Speeds that can be chosen for a simulated rig, by their pace."""

READOUTS = {SONIXDAQ_READOUT_S: "SonixDAQ, 10 s", REAL_TIME_READOUT_S: "streams, 0.1 s"}
"""Receivers that can be chosen, by the time in seconds to read one acquisition."""

METHOD_FIELDS = ("method", "acquisitions", "tolerance_mm", "as_published")
"""Settings of any search."""

RIG_FIELDS = ("tissue", "snr_db", "readout_s", "pace")
"""Settings of a simulated rig, besides its seed."""

_AS_RIG = "as the rig file"

_CHOICES: dict[str, Mapping[Any, str]] = {
    "method": {each.name: each.name for each in METHODS},
    "tissue": {None: _AS_RIG} | {name: name for name in TISSUES},
    "readout_s": {None: _AS_RIG} | READOUTS,
    "pace": PACES,
}

_FIELDS = {
    "method": ("method", "How the next angle is chosen. posterior is markerseek's own; the others are the paper's."),
    "acquisitions": ("acquisitions", "Most acquisitions. Empty: the usual number of the method."),
    "tolerance_mm": ("± [mm]", "How well the place of the marker must be known, in millimetres. Empty: 0.5 mm."),
    "as_published": ("as published", "The paper's form of the method, which always answers, also without a marker."),
    "sweep": ("sweep", "The probe turns while the laser fires: one frame for each pulse."),
    "tissue": ("tissue", "Simulated material around the marker."),
    "snr_db": ("SNR [dB]", "Signal over noise with the probe on the marker. Empty: as the rig file says."),
    "seed": ("seed", "Number of the simulated scene: the same seed is the same marker and the same noise."),
    "readout_s": ("receiver", "Time to read one acquisition."),
    "pace": ("speed", "How fast the simulated clock runs."),
}
"""Label of each setting, and what it means."""


class SettingsRow:
    """Fields for the settings of one search, folded but for the seed; what is wrong with one of them stands below.

    ``problems``: what is wrong with the link whose settings these are. ``on_change``: called with the settings after
    each change that can be used.
    """

    def __init__(
        self,
        settings: PageSettings,
        names: Iterable[str],
        *,
        problems: Iterable[str] = (),
        on_change: Callable[[PageSettings], None] = lambda _: None,
    ) -> None:
        self._values = asdict(settings)
        self._on_change = on_change
        self._fields: dict[str, Any] = {}
        self._following = False
        self.usable = True
        """Whether a search can have these settings."""
        for name in (each for each in names if each == "seed"):
            self._add(name)
        with ui.element("details").classes("ms-settings") as self._fold:
            with ui.element("summary"):
                self._summary = ui.label("settings")
            with ui.element("div").classes("ms-controls"):
                for name in (each for each in names if each != "seed"):
                    self._add(name)
        self._problem = ui.label("").classes("ms-problem").props('role="alert"')
        self._say("; ".join(f"link: {each}; it is left out" for each in problems))
        self._summarise()

    @property
    def settings(self) -> PageSettings:
        """What the fields show."""
        return PageSettings(**self._values)

    def follow(self, settings: PageSettings) -> None:
        """Show the settings of a run that somebody else has started, too."""
        self._following = True
        for name, value in asdict(settings).items():
            self._values[name] = value
            if name in self._fields:
                self._fields[name].set_value(value)
        self._following = False
        self._say("")
        self._summarise()

    def _add(self, name: str) -> None:
        label, hint = _FIELDS[name]
        value = self._values[name]
        field: Any
        if name in _CHOICES:
            # A link may hold a value that is not in the list.
            known = dict(_CHOICES[name])
            if value not in known:
                known[value] = f"pace {value:g}" if name == "pace" else f"{value:g} s"
            field = ui.select(known, value=value, label=label, on_change=lambda event: self._set(name, event.value))
        elif isinstance(value, bool):
            field = ui.checkbox(label, value=value, on_change=lambda event: self._set(name, event.value))
        else:
            field = ui.number(label, value=value, on_change=lambda event: self._set(name, _whole(name, event.value)))
            field.props("debounce=300 stack-label")
        field.props("dense outlined options-dense no-error-icon hide-bottom-space").tooltip(hint)
        field.classes(f"ms-field-{name}")
        self._fields[name] = field

    def _set(self, name: str, value: object) -> None:
        if self._following:
            return
        # Kept as it is shown, right or wrong: a search with other settings than those on the page must not start.
        self._values[name] = value
        for field in self._fields.values():
            field.props(remove="error")
        try:
            settings = self.settings
        except ConfigError as problem:
            self._fields[name].props("error")
            self._say(str(problem), usable=False)
            return
        self._say("")
        self._summarise()
        self._on_change(settings)

    def _summarise(self) -> None:
        """Name what differs from the usual beside the fold."""
        usual = asdict(PageSettings())
        values = {name: self._values[name] for name in self._fields if name != "seed"}
        changed = [f"{_FIELDS[name][0]} {_shown(name, each)}" for name, each in values.items() if each != usual[name]]
        self._summary.set_text("settings" + (f": {', '.join(changed)}" if changed else ""))

    def _say(self, problem: str, *, usable: bool = True) -> None:
        self.usable = usable
        self._problem.set_text(with_minus(problem))
        self._problem.set_visibility(bool(problem))


class SearchControls:
    """Settings and commands of the search page."""

    def __init__(self, frame: PageShell, link: LinkSettings) -> None:
        self._searches = frame.searches
        self._shown: object = None
        settings, problems = link
        self._is_linked = settings != PageSettings()
        with ui.element("div").classes("ms-controls"):
            self._start = start_button("Start").mark("start")
            self._pause = ui.button("Pause", icon="pause").props("dense outline padding='6px 10px'").mark("pause")
            # As wide as its longer text, so that the row stays one.
            self._pause.style("min-width: 98px")
            names = (*METHOD_FIELDS, "sweep") + (("seed", *RIG_FIELDS) if self._searches.rig.simulated else ())
            self._row = SettingsRow(settings, names, problems=problems, on_change=hold_in_link("/"))
        frame.on_click(self._start, lambda: self._searches.start(self._row.settings, asked_by=frame.viewer))
        frame.on_click(self._pause, self._pause_or_go_on)

    def update(self) -> None:
        """Show what can be pressed now, and the settings of the run that is shown."""
        busy, live = self._searches.busy, self._searches.search
        if live is not None and live is not self._shown and (self._searches.searching or not self._is_linked):
            self._row.follow(live.settings)
        self._shown = live
        paused = not busy and self._searches.paused
        self._start.set_enabled(not busy and self._row.usable)
        self._pause.set_enabled(self._searches.searching or paused)
        self._pause.set_text("Go on" if paused else "Pause")
        self._pause.set_icon("play_arrow" if paused else "pause")

    def _pause_or_go_on(self) -> None:
        if self._searches.searching:
            self._searches.stop()
        else:
            self._searches.go_on()


def start_button(text: str) -> ui.button:
    """The button of a page that is pressed first."""
    return ui.button(text, icon="play_arrow", color=None).props("dense padding='6px 10px'").classes("ms-go")


def hold_in_link(path: str) -> Callable[[PageSettings], None]:
    """What puts settings into the address of a page, so that its link holds them."""

    def hold(settings: PageSettings) -> None:
        ui.navigate.history.replace(f"{path}?{settings.query()}".rstrip("?"))

    return hold


def _shown(name: str, value: object) -> str:
    return _CHOICES[name].get(value, str(value)) if name in _CHOICES else "" if value is True else str(value)


def _whole(name: str, value: float | None) -> float | int | None:
    """The setting of a field with a number; a whole one if the setting is a count."""
    counts = value is not None and name in {"acquisitions", "seed"} and float(value).is_integer()
    return int(value or 0) if counts else value
