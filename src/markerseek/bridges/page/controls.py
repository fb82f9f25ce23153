"""The controls of a search: its settings, start, pause, go on, and the link that holds the settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Generic, TypeAlias, TypeVar

from nicegui import ui

from markerseek.bridges.asked import Asked, AskedRegistration, AskedSearch
from markerseek.bridges.page.page_shell import PageShell
from markerseek.core import ConfigError, SimulationOptions
from markerseek.records import with_minus
from markerseek.search import METHODS
from markerseek.sim import TISSUES

USUAL = AskedSearch(simulation=SimulationOptions(seed=1, pace=0.05))
"""What the page begins with: a search of two minutes is shown in six seconds."""

USUAL_REGISTRATION = AskedRegistration(sweep=True, seed=1, pace=0.5)
"""The same for a session: sweeps of half a minute are shown in a quarter."""

LinkSettings: TypeAlias = tuple[AskedSearch, tuple[str, ...]]
"""Settings of a link, and what is wrong with each of its values that are left out."""

_AskedT = TypeVar("_AskedT", bound=Asked)

METHOD_FIELDS = ("method", "acquisitions", "tolerance_mm", "as_published")
"""Settings of any search."""

RIG_FIELDS = ("tissue", "snr_db", "readout_s", "pace")
"""Settings of a simulated rig, besides its seed."""

_CHOICES: dict[str, Mapping[Any, str]] = {
    "method": {each.name: each.name for each in METHODS},
    "tissue": {None: "as the rig file"} | {name: name for name in TISSUES},
    "readout_s": {None: "as the rig file", 10.0: "SonixDAQ, 10 s", 0.1: "streams, 0.1 s"},
    "pace": {1.0: "real time", 0.2: "5 × faster", 0.05: "20 × faster", 0.01: "100 × faster", 0.0: "no waiting"},
}

_LABELS = {
    "tre_mm": "TRE [mm]",
    "tolerance_mm": "± [mm]",
    "snr_db": "SNR [dB]",
    "readout_s": "receiver",
    "pace": "speed",
}
"""Labels of settings; of others it is their name."""


class SettingsRow(Generic[_AskedT]):
    """Fields for the settings of one run, folded but for the seed; what is wrong with one of them stands below.

    ``usual``: settings that are not named beside the fold. ``problems``: what is wrong with the link whose settings
    these are. ``on_change``: called with the settings after each change that can be used.
    """

    def __init__(
        self,
        settings: _AskedT,
        names: Iterable[str],
        *,
        usual: _AskedT,
        problems: Iterable[str] = (),
        on_change: Callable[[_AskedT], None] = lambda _: None,
    ) -> None:
        self._values, self._usual = settings.values, usual
        self._options = usual.options()
        self._on_change = on_change
        self._fields: dict[str, Any] = {}
        self._following = False
        self.usable = True
        """Whether a search can have these settings."""
        for name in (each for each in names if each == "seed"):
            self._add(name)
        with ui.element("details").classes("ms-settings"):
            with ui.element("summary"):
                self._summary = ui.label("")
            with ui.element("div").classes("ms-controls"):
                for name in (each for each in names if each != "seed"):
                    self._add(name)
        self._problem = ui.label("").classes("ms-problem").props('role="alert"')
        self._say("; ".join(f"link: {each}; it is left out" for each in problems))

    @property
    def settings(self) -> _AskedT:
        """What the fields show."""
        return self._usual.changed(**self._values)

    def follow(self, settings: _AskedT) -> None:
        """Show the settings of a run that was started, here or elsewhere."""
        self._following = True
        self._values = settings.values
        for name, field in self._fields.items():
            field.set_value(self._values[name])
        self._following = False
        self._say("")

    def _add(self, name: str) -> None:
        label, value = _label(name), self._values[name]
        field: ui.select | ui.checkbox | ui.number
        given: dict[str, Any] = {"value": value, "on_change": lambda event: self._set(name, event.value)}
        if name in _CHOICES:
            # A link may hold a value that is not in the list.
            known = {value: f"{value:g}" if isinstance(value, float) else value} | dict(_CHOICES[name])
            field = ui.select(known, label=label, **given)
        elif isinstance(value, bool):
            field = ui.checkbox(label, **given)
        else:
            field = ui.number(label, placeholder=self._options[name].shown, **given).props("debounce=300 stack-label")
        field.props("dense outlined options-dense no-error-icon hide-bottom-space").tooltip(self._options[name].help)
        self._fields[name] = field.classes(f"ms-field-{name}")

    def _set(self, name: str, value: Any) -> None:
        if self._following:
            return
        if self._options[name].kind is int and value is not None and float(value).is_integer():
            value = int(value)
        # Kept as it is shown, right or wrong: a search with other settings than those on the page must not start.
        self._values[name] = self._options[name].default if value is None else value
        for field in self._fields.values():
            field.props(remove="error")
        try:
            settings = self.settings
        except ConfigError as problem:
            self._fields[name].props("error")
            self._say(str(problem), usable=False)
            return
        self._say("")
        self._on_change(settings)

    def _say(self, problem: str, *, usable: bool = True) -> None:
        """Say what is wrong, and name beside the fold what differs from the usual."""
        self.usable = usable
        self._problem.set_text(with_minus(problem))
        self._problem.set_visibility(bool(problem))
        chosen = {name: self._values[name] for name in self._fields if name != "seed"}
        changed = [
            f"{_label(name)} {_CHOICES.get(name, {}).get(value, '' if value is True else value)}".strip()
            for name, value in chosen.items()
            if value != self._usual.values[name]
        ]
        self._summary.set_text("settings" + (f": {', '.join(changed)}" if changed else ""))


class SearchControls:
    """Settings and commands of the search page."""

    def __init__(self, frame: PageShell, link: LinkSettings) -> None:
        self._searches = frame.searches
        self._shown: object = None
        settings, problems = link
        self._is_linked = settings != USUAL
        with ui.element("div").classes("ms-controls"):
            self._start = start_button("Start").mark("start")
            self._pause = ui.button("Pause", icon="pause").props("dense outline padding='6px 10px'").mark("pause")
            # As wide as its longer text, so that the row stays one.
            self._pause.style("min-width: 98px")
            names = (*METHOD_FIELDS, "sweep") + (("seed", *RIG_FIELDS) if self._searches.rig.simulated else ())
            self._row = SettingsRow(
                settings, names, usual=USUAL, problems=problems, on_change=hold_in_link("/search", USUAL)
            )
        frame.on_click(self._start, lambda: self._searches.start(self._row.settings, asked_by=frame.viewer))
        frame.on_click(self._pause, self._pause_or_go_on)

    def update(self) -> None:
        """Show what can be pressed now, and the settings of the run that is shown."""
        busy, live = self._searches.busy, self._searches.search
        if live is not None and live is not self._shown and (self._searches.searching or not self._is_linked):
            self._row.follow(live.asked)
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


def hold_in_link(path: str, usual: Asked) -> Callable[[Asked], None]:
    """What puts settings into the address of a page, so that its link holds them."""
    return lambda asked: ui.navigate.history.replace(f"{path}?{asked.query(usual=usual)}".rstrip("?"))


def _label(name: str) -> str:
    return _LABELS.get(name, name.replace("_", " "))
