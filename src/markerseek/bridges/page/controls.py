"""The controls of a search: its settings, start, pause, go on, and the link that holds the settings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeAlias

from nicegui import ui

from markerseek.bridges.asked import OPTIONS, AskedSearch
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.state import with_minus
from markerseek.core import ConfigError, SimulationOptions
from markerseek.search import METHODS
from markerseek.sim import TISSUES

USUAL = AskedSearch(simulation=SimulationOptions(seed=1, pace=0.05))
"""What the page begins with: a search of two minutes is shown in six seconds."""

LinkSettings: TypeAlias = tuple[AskedSearch, tuple[str, ...]]
"""Settings of a link, and what is wrong with each of its values that are left out."""

PACES = {1.0: "real time", 0.2: "5 × faster", 0.05: "20 × faster", 0.01: "100 × faster", 0.0: "no waiting"}
"""Speeds that can be chosen for a simulated rig, by their pace."""

READOUTS = {10.0: "SonixDAQ, 10 s", 0.1: "streams, 0.1 s"}
"""Receivers that can be chosen, by the time in seconds to read one acquisition."""

METHOD_FIELDS = ("method", "acquisitions", "tolerance_mm", "as_published")
"""Settings of any search."""

RIG_FIELDS = ("tissue", "snr_db", "seed", "readout_s", "pace")
"""Settings of a simulated rig."""


class SettingsRow:
    """Fields for the settings of one search; what is wrong with one of them stands below.

    ``problems``: what is wrong with the link whose settings these are. ``on_change``: called with the settings after
    each change that can be used.
    """

    def __init__(
        self,
        settings: AskedSearch,
        names: Iterable[str],
        *,
        problems: Iterable[str] = (),
        on_change: Callable[[AskedSearch], None] | None = None,
    ) -> None:
        self._values = settings.values
        self._on_change = on_change
        self._fields: dict[str, ui.element] = {}
        self.usable = True
        """Whether a search can have these settings."""
        made: dict[str, Callable[[], object]] = {
            "method": lambda: self._select("method", {each.name: each.name for each in METHODS}, "method", 116),
            "acquisitions": lambda: self._number("acquisitions", "acquisitions", 84),
            "tolerance_mm": lambda: self._number("tolerance_mm", "± [mm]", 76),
            "as_published": lambda: self._box(
                "as_published", "as published", "the paper's form of the method, which always answers"
            ),
            "sweep": lambda: self._box("sweep", "sweep", "turns the probe while the laser fires, one frame a pulse"),
            "tissue": lambda: self._select("tissue", _with_rig({name: name for name in TISSUES}), "tissue", 106),
            "snr_db": lambda: self._number("snr_db", "SNR [dB]", 72),
            "seed": lambda: self._number("seed", "seed", 58),
            "readout_s": lambda: self._select("readout_s", _with_rig(READOUTS), "receiver", 106),
            "pace": lambda: self._select("pace", PACES, "speed", 112),
        }
        for name in names:
            made[name]()
        self._problem = ui.label("").classes("ms-problem").props('role="alert"')
        self._say("; ".join(f"link: {each}; it is left out" for each in problems))

    @property
    def settings(self) -> AskedSearch:
        """What the fields show."""
        return USUAL.changed(**self._values)

    def _box(self, name: str, label: str, tip: str) -> None:
        box = ui.checkbox(label, value=self._values[name])
        box.on_value_change(lambda event: self._set(name, event.value))
        box.props("dense").tooltip(tip)
        self._fields[name] = box

    def _select(self, name: str, options: Mapping[Any, str], label: str, width_px: int) -> None:
        value = self._values[name]
        known = dict(options)
        if value not in options:
            # A link may hold a value that is not in the list.
            known[value] = _pace_text(value) if name == "pace" else f"{value:g} s"
        field = ui.select(known, value=value, label=label, on_change=lambda event: self._set(name, event.value))
        field.props("dense outlined options-dense no-error-icon hide-bottom-space")
        # As wide as its text: no name is cut.
        field.style(f"min-width: {width_px}px")
        self._fields[name] = field

    def _number(self, name: str, label: str, width_px: int) -> None:
        field = ui.number(label, value=self._values[name])
        field.on_value_change(lambda event: self._set(name, _setting_of(name, event.value)))
        field.props('dense outlined debounce=300 placeholder="usual" stack-label no-error-icon hide-bottom-space')
        field.style(f"width: {width_px}px")
        self._fields[name] = field

    def _set(self, name: str, value: object) -> None:
        # Kept as it is shown, right or wrong: a search with other settings than those on the page must not start.
        self._values[name] = OPTIONS[name].default if value is None else value
        for field in self._fields.values():
            field.props(remove="error")
        try:
            settings = self.settings
        except ConfigError as problem:
            self._fields[name].props("error")
            self._say(str(problem), usable=False)
            return
        self._say("")
        if self._on_change is not None:
            self._on_change(settings)

    def _say(self, problem: str, *, usable: bool = True) -> None:
        self.usable = usable
        self._problem.set_text(with_minus(problem))
        self._problem.set_visibility(bool(problem))


class SearchControls:
    """Settings and commands of the search page."""

    def __init__(self, frame: PageShell, link: LinkSettings) -> None:
        self._searches = frame.searches
        settings, problems = link
        with ui.element("div").classes("ms-controls"):
            self._start = start_button("Start").mark("start")
            self._pause = ui.button("Pause", icon="pause").props("dense outline padding='6px 10px'").mark("pause")
            # As wide as its longer text, so that the row stays one.
            self._pause.style("min-width: 98px")
            names = (*METHOD_FIELDS, "sweep") + (RIG_FIELDS if self._searches.rig.simulated else ())
            self._row = SettingsRow(settings, names, problems=problems, on_change=hold_in_link("/"))
        frame.on_click(self._start, lambda: self._searches.start(self._row.settings, asked_by=frame.viewer))
        frame.on_click(self._pause, self._pause_or_go_on)

    def update(self) -> None:
        """Show what can be pressed now."""
        busy = self._searches.busy
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


def start_button(text: str, *, icon: str = "play_arrow") -> ui.button:
    """The button of a page that is pressed first."""
    return ui.button(text, icon=icon, color=None).props("dense padding='6px 10px'").classes("ms-go")


def hold_in_link(path: str) -> Callable[[AskedSearch], None]:
    """What puts settings into the address of a page, so that its link holds them."""

    def hold(settings: AskedSearch) -> None:
        query = settings.query(usual=USUAL)
        ui.navigate.history.replace(f"{path}?{query}" if query else path)

    return hold


def _with_rig(options: Mapping[Any, str]) -> dict[Any, str]:
    return {None: "as the rig", **options}


def _pace_text(pace: float) -> str:
    return f"{1 / pace:.3g} × faster" if pace < 1 else f"{pace:.3g} × slower"


def _setting_of(name: str, value: float | None) -> float | int | None:
    """The setting of a field with a number; a whole one where the setting is a count."""
    return (
        int(value)
        if value is not None and name not in ("snr_db", "tolerance_mm") and float(value).is_integer()
        else value
    )
