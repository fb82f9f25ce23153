"""The controls of a search and of a registration: start, go on, and the settings, which the link of the page holds."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from nicegui import ui

from markerseek.bridges.page.children import ChildSearch
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.request import AnyRequest, SearchRequest, SessionRequest
from markerseek.core import ConfigError, Option, SceneOptions, SimulationOptions, as_text, plain
from markerseek.registration import SessionPlan
from markerseek.search import METHODS
from markerseek.show import with_minus
from markerseek.sim import TISSUES

USUAL = SearchRequest(simulation=SimulationOptions(seed=1, pace=0.05))
"""What the page begins with: a search of two minutes is shown in six seconds."""

USUAL_REGISTRATION = SessionRequest(plan=SessionPlan(sweep=True), simulation=SceneOptions(seed=1, pace=0.5))
"""The same for a session: sweeps of half a minute are shown in a quarter."""

_SIMULATED = ("tissue", "snr_db", "readout_s", "breathing_mm", "seed", "pace")
"""Settings of a simulated rig."""

_SEARCH = ("method", "acquisitions", "tolerance_mm", "as_published", "sweep", *_SIMULATED)
_REGISTRATION = ("tre_mm", "target_mm", "markers", "sweep", "again", "check", "breathing_mm", "seed", "pace")

_CHOICES: dict[str, Mapping[Any, str]] = {
    "method": {each.name: each.name for each in METHODS},
    "tissue": {None: "as the rig file"} | {name: name for name in TISSUES},
    "readout_s": {None: "as the rig file", 10.0: "SonixDAQ, 10 s", 0.1: "streams, 0.1 s"},
    "pace": {1.0: "real time", 0.2: "5 × faster", 0.05: "20 × faster", 0.01: "100 × faster", 0.0: "no waiting"},
}

_LABELS = {
    "tre_mm": "TRE [mm]",
    "target_mm": "target X Y Z [mm]",
    "tolerance_mm": "± [mm]",
    "snr_db": "SNR [dB]",
    "readout_s": "receiver",
    "breathing_mm": "breathing [± mm]",
    "pace": "speed",
}
"""Labels of settings; of others it is their name."""


class Settings:
    """Fields for the settings of a run, folded but for the seed; what is wrong with one of them stands below.

    ``usual``: settings that are not named beside the fold. ``query``: of the link, which holds the settings.
    ``prefix``: path in front of all paths of the page.
    """

    def __init__(self, usual: AnyRequest, query: Mapping[str, str], *, simulated: bool, prefix: str) -> None:
        linked, problems = usual.with_query(query)
        self._usual = usual
        self._options = usual.options
        self._values = linked.values
        self._path = prefix + ("/search" if isinstance(usual, SearchRequest) else "/")
        self._fields: dict[str, Any] = {}
        self.linked = bool(query)
        """Whether the link had settings of its own."""
        self.usable = True
        """Whether a run can have these settings."""
        if simulated:
            self._add("seed")
        with ui.element("details").classes("ms-settings"):
            with ui.element("summary"):
                self._summary = ui.label("")
            with ui.element("div").classes("ms-controls"):
                for name in _SEARCH if isinstance(usual, SearchRequest) else _REGISTRATION:
                    if name != "seed" and (simulated or name not in _SIMULATED):
                        self._add(name)
        self._problem = ui.label("").classes("ms-problem").props('role="alert"')
        self._say("; ".join(f"link: {each}; it is left out" for each in problems))

    @property
    def asked(self) -> AnyRequest:
        """What the fields show."""
        return self._usual.changed(**{name: self._read(name) for name in self._values})

    def follow(self, asked: AnyRequest) -> None:
        """Show the settings of a run that was started, here or elsewhere."""
        self._values = asked.values
        for name, field in self._fields.items():
            field.set_value(self._values[name])
        self._say("")

    def _add(self, name: str) -> None:
        label = _label(name)
        value = self._values[name]
        field: ui.select | ui.checkbox | ui.number | ui.input
        given: dict[str, Any] = {"value": value, "on_change": lambda event: self._set(name, event.value)}
        if name in _CHOICES:
            # A link may hold a value that is not in the list.
            known = {value: f"{value:g}" if isinstance(value, float) else value} | dict(_CHOICES[name])
            field = ui.select(known, label=label, **given)
        elif isinstance(value, bool):
            field = ui.checkbox(label, **given)
        elif self._options[name].kind is str:
            field = ui.input(label, placeholder=self._options[name].shown, **given).props("debounce=300 stack-label")
        else:
            field = ui.number(label, placeholder=self._options[name].shown, **given).props("debounce=300 stack-label")
        field.props("dense outlined options-dense no-error-icon hide-bottom-space").tooltip(self._options[name].help)
        self._fields[name] = field.classes(f"ms-field-{name}")

    def _set(self, name: str, value: Any) -> None:
        if value == self._values[name]:
            return
        # Kept as it is shown, right or wrong: a run with other settings than those on the page must not start.
        self._values[name] = value
        for each in self._fields:
            try:
                self._read(each)
            except ConfigError as problem:
                self._say(str(problem), wrong=each)
                return
        try:
            query = self.asked.query(usual=self._usual)
        except ConfigError as problem:
            self._say(str(problem), wrong=self._wrong(name))
            return
        self._say("")
        ui.navigate.history.replace(f"{self._path}?{query}".rstrip("?"))

    def _wrong(self, changed: str) -> str:
        """The field without which the others can be used; the one that was changed last if several are such."""
        for name in (changed, *self._fields):
            with suppress(ConfigError):
                self._usual.changed(**self._values | {name: self._usual.values[name]})
                return name
        return changed

    def _read(self, name: str) -> Any:
        """The value of a setting from what its field shows; `ConfigError` if that is none."""
        value = self._values[name]
        usual = self._usual.values[name]
        if value is None and usual is not None:
            # A field that is usually empty has a meaning when it is empty; this one has none.
            raise ConfigError(f"{name} is empty, it needs a value, such as {as_text(usual)}")
        # A number of the browser has no type.
        whole = self._options[name].kind is int and isinstance(value, float)
        return self._options[name].read(as_text(value)) if whole else value

    def _say(self, problem: str, *, wrong: str = "") -> None:
        """Say what is wrong, and with which setting, and name beside the fold what differs from the usual."""
        self.usable = not wrong
        for name, field in self._fields.items():
            field.props(add="error") if name == wrong else field.props(remove="error")
        said = _with_labels(problem, self._options)
        # What a rig calls a setting may be another name.
        said = said if _label(wrong) in said else f"{_label(wrong)}: {said}"
        self._problem.set_text(with_minus(said))
        self._problem.set_visibility(bool(problem))
        changed = [
            f"{_label(name)} {_CHOICES.get(name, {}).get(value, '' if value is True else value)}".strip()
            for name, value in self._values.items()
            if name in self._fields and name != "seed" and value != self._usual.values[name]
        ]
        self._summary.set_text("settings" + (f": {', '.join(changed)}" if changed else ""))


class RunControls:
    """Start, Go on and the settings of the search, or of the registration, of a page."""

    def __init__(self, shell: PageShell, usual: AnyRequest, query: Mapping[str, str]) -> None:
        self._searches = shell.searches
        self._shown: ChildSearch | None = None
        with ui.element("div").classes("ms-controls"):
            self._start = ui.button("Start", icon="play_arrow", color=None).classes("ms-go")
            self._go_on = ui.button("Go on", icon="play_arrow").props("outline")
            for each in (self._start, self._go_on):
                each.props("dense padding='6px 10px'")
            simulated = self._searches.rig.simulated
            self._settings = Settings(usual, query, simulated=simulated, prefix=shell.prefix)
            other = "registration" if isinstance(usual, SearchRequest) else "search"
            self._elsewhere = ui.label(f"a {other} runs on the other page").classes("ms-note")
        shell.on_click(self._start, lambda: self._searches.start(self._settings.asked, asked_by=shell.viewer))
        shell.on_click(self._go_on, lambda: self._searches.go_on(self._shown, asked_by=shell.viewer))

    def update(self, live: ChildSearch | None) -> None:
        """Show what can be pressed now, and the settings of the run that is shown."""
        busy = self._searches.busy
        is_here = live is not None and live.outcome is None
        if live is not None and live is not self._shown and (is_here or not self._settings.linked):
            self._settings.follow(live.asked)
        self._shown = live
        self._start.set_enabled(not busy and self._settings.usable)
        self._go_on.set_visibility(not busy and live is not None and live.can_go_on)
        # A run that follows is on the page of the registration whose session it follows with.
        self._elsewhere.set_visibility(any(each is not live for each in self._searches.searching))


def _with_labels(message: str, options: Mapping[str, Option]) -> str:
    """A message with the labels of the page in place of the names of settings, and of their options."""
    message = plain(message, label=_label)
    for name, option in options.items():
        message = re.sub(rf"(?<![\w-])({option.flag}|{name})(?![\w-])", _label(name), message)
    return message


def _label(name: str) -> str:
    return _LABELS.get(name, name.replace("_", " "))
