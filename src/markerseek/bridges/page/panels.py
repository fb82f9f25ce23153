"""The panels of a run: verdict, fan, curve, image, numbers, log. Each is sent again only if it has changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict

from nicegui import ui

from markerseek.bridges.page.elements import Fan, Heading, Image, Slider
from markerseek.bridges.page.models import fan_model, image_model, image_texts
from markerseek.bridges.page.run_history import RunHistory, is_image_of
from markerseek.core import Interval, RigFacts, SearchPlan
from markerseek.runs import RunView, Verdict, curve_of, numbers_of, verdict_of

LOG_LINES = 10
"""Lines of the log that are shown."""

LEGEND = (
    ("ms-key-glow", "probability"),
    ("ms-key-dot", "acquisition (outer: stronger)"),
    ("ms-key-square", "confirmation"),
    ("ms-key-arc", "95 %, or bracket"),
    ("ms-key-tick", "possible next (longer: better)"),
)
"""What is drawn in the fan: class of its key, and its meaning."""

HINTS = {
    "fan": "The probe turns here. The glow shows where the marker probably is.",
    "curve": "Each acquisition becomes a dot: how strong the signal is at that angle. The blue area is the probability "
    "of the marker, and a small picture shows ± 2° about the answer.",
    "image": "The image at each angle. The marker is a bright spot.",
    "numbers": "How many acquisitions, how much rotation and time, the noise, and other sources.",
    "left": "The image of the left camera, with the spot, the place for the next one, and the target.",
    "right": "The same for the right camera.",
    "tre": "The expected error at the target, which falls with each marker to its goal.",
    "markers": "One line for each marker: its angle, its distance from where the others expect it, and its use.",
    "log": "One line for each move and each acquisition.",
}
"""What will appear in each panel, shown while there is no run."""


class VerdictPanel:
    """The verdict of a run, large enough to be read from two metres."""

    def __init__(self) -> None:
        self._shown: Verdict | None = None
        self._labels: dict[str, ui.label] = {}
        with ui.element("section").props('aria-label="verdict"') as self._band:
            self._label("word", "badge").props('role="status"')
            with ui.element("div").classes("ms-angles"):
                for name in ("lead", "angle", "sigma"):
                    self._label(name, name)
            with ui.element("div").classes("ms-where"):
                for name, css in (("problem", "fault"), ("turn", "turn"), ("interval", "interval")):
                    self._label(name, css)
                for name, css in (("reason", "answer"), ("next_step", "next")):
                    self._label(name, css)
        self.show(Verdict())

    def _label(self, name: str, css: str) -> ui.label:
        self._labels[name] = ui.label("").classes(f"ms-{css}").mark(css)
        return self._labels[name]

    def show(self, verdict: Verdict) -> None:
        """Show another verdict."""
        if verdict == self._shown:
            return
        self._shown = verdict
        self._band.classes(replace=f"ms-verdict ms-verdict-{verdict.kind}")
        texts = asdict(verdict)
        texts["lead"] = verdict.lead if verdict.angle not in {"", "–"} else ""
        for name, label in self._labels.items():
            label.set_text(texts[name])
        # Some lines of it are seen; the pointer shows the rest.
        self._labels["reason"].props["title"] = verdict.reason


class RunPanels:
    """All panels of one run at a time, in a grid; those of a registration are fan and curve only.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval, *, charts: bool = False) -> None:
        facts = RigFacts(kind="simulated", description="", fingerprint="", search=search, probe="")
        self._nothing = RunView(plan=SearchPlan(method="posterior"), facts=facts)
        self._charts = charts
        self._rows: dict[str, ui.label] = {}
        with ui.element("div").classes("ms-run" if charts else "ms-panels") as self._grid:
            with panel("probe, from its end", "fan"):
                self._fan = Fan().classes("ms-fan")
                with ui.element("ul").classes("ms-legend"):
                    for key, meaning in LEGEND:
                        with ui.element("li"):
                            ui.element("span").classes(f"ms-key {key}")
                            ui.label(meaning)
            with panel("intensity and probability; dashed: detection threshold", "curve"):
                self._curve = ui.html(sanitize=False).classes("ms-chart").mark("curve")
            if not charts:
                with panel("photoacoustic image", "image") as self._image_title:
                    self._image = Image().classes("ms-image")
                    self._image_note = ui.label("").classes("ms-note")
                with panel("what is known", "numbers"):
                    self._table = ui.element("dl").classes("ms-rows").props("tabindex=0")
                with panel("log", "log"):
                    self._log = ui.label("").classes("ms-log").props("tabindex=0").mark("log")
        self.clear()

    def clear(self) -> None:
        """Show what will appear in each panel."""
        self._keys: dict[str, tuple[object, ...]] = {}
        self._grid.classes("ms-empty")
        self._draw(None, self._nothing, reveal=False)
        if not self._charts:
            self._rows.clear()
            self._table.clear()
            self._log.set_text("")

    def show(self, run: RunHistory, view: RunView, *, reveal: bool) -> None:
        """Show a run after one of its events; the true angle only if it is to be revealed."""
        self._grid.classes(remove="ms-empty")
        self._draw(run, view, reveal=reveal)
        if not self._charts and self._has_changed("numbers", run, view):
            self._show_rows(numbers_of(view, name=run.name, pulse_j=run.pulse_j))
            self._log.set_text("\n".join(run.lines(view, most=LOG_LINES)))

    def _draw(self, run: RunHistory | None, view: RunView, *, reveal: bool) -> None:
        if self._has_changed("fan", run, view, reveal):
            self._fan.show(view=fan_model(view, duration_s=run.move_s(view) if run else 0.0, reveal=reveal))
        # While the probe moves, only the needle changes.
        if self._has_changed("curve", run, len(view.points), view.belief, reveal):
            self._curve.set_content(curve_of(view, reveal=reveal).svg())
        if self._charts:
            return
        picture = run.picture(view) if run else None
        elsewhere = picture is not None and not is_image_of(picture, view)
        if self._has_changed("image", run, picture, view.floor_level, elsewhere):
            imaged = view.facts.probe is not None
            self._image.show(view=image_model(picture, floor=view.floor_level, imaged=imaged))
            title, note = image_texts(picture, elsewhere=elsewhere)
            self._image_title.set_text(title)
            self._image_title.classes(replace="ms-title" if picture is None else "ms-image-title")
            self._image_title.classes(add="ms-elsewhere" if elsewhere else "")
            self._image_note.set_text(note)

    def _has_changed(self, name: str, *key: object) -> bool:
        if self._keys.get(name) == key:
            return False
        self._keys[name] = key
        return True

    def _show_rows(self, rows: list[tuple[str, str]]) -> None:
        for name in self._rows.keys() - dict(rows).keys():
            self._rows[name].set_text("–")
        for name, value in rows:
            if name not in self._rows:
                with self._table:
                    with ui.element("dt"):
                        ui.label(name)
                    with ui.element("dd"):
                        self._rows[name] = ui.label(value).mark(name)
            self._rows[name].set_text(value)


@contextmanager
def panel(title: str, name: str) -> Iterator[Heading]:
    """A panel in which what follows is put, with its heading, and what will appear in it."""
    with ui.element("section").classes(f"ms-panel ms-panel-{name}").props(f'aria-label="{title}"'):
        heading = Heading(title, level=2).classes("ms-title")
        if name in HINTS:
            ui.label(HINTS[name]).classes("ms-hint")
        yield heading


class RunPlayer:
    """Panels of a run, and the slider over its events, which at its end follows a run that goes on.

    ``verdict``: stands above the panels, where the page has put it.
    """

    def __init__(self, search: Interval, verdict: VerdictPanel) -> None:
        self._verdict, self._panels = verdict, RunPanels(search)
        with ui.element("div").classes("ms-foot"):
            self._label = ui.label("").classes("ms-note").style("min-width: 128px")
            self._slider = Slider(min=0, max=1, step=1, value=0, on_change=lambda event: self._choose(int(event.value)))
            self._slider.props('aria-label="event shown" label').mark("timeline")
            self._follow = ui.button("newest", on_click=self._to_newest).props("flat dense")
        self._moving = False
        self.clear()

    def clear(self) -> None:
        """Empty everything, so that facts of one run are not shown as those of the next, which may never begin."""
        self._verdict.show(Verdict())
        self._panels.clear()
        self._run: RunHistory | None = None
        self._key: tuple[RunView, str] | None = None
        self._following, self._chosen = True, 0
        self._move(0, last=1)
        self._label.set_text("event 0 of 0")

    def show(self, run: RunHistory, *, reveal: bool, next_step: str = "") -> None:
        """Show the event that was chosen, or the newest; the true angle only if it is to be revealed."""
        view = self.view(run)
        if self._key != (view, next_step):
            self._key = (view, next_step)
            self._verdict.show(verdict_of(view, next_step=next_step))
        self._panels.show(run, view, reveal=reveal)

    def view(self, run: RunHistory) -> RunView:
        """The view to be shown: the newest, or the one that was chosen."""
        if run is not self._run:
            self._run, self._following = run, True
        last = len(run.views) - 1
        shown = last if self._following else min(self._chosen, last)
        self._move(shown, last=last)
        self._label.set_text(f"event {shown} of {last}")
        self._follow.set_enabled(not self._following)
        return run.views[shown]

    def _move(self, number: int, *, last: int) -> None:
        """Move the slider without choosing an event: a run may have gone on in the meantime."""
        if self._slider.props.get("max") != max(last, 1):
            self._slider.props["max"] = max(last, 1)
        self._moving = True
        self._slider.set_value(number)
        self._moving = False

    def _choose(self, number: int) -> None:
        if not self._moving:
            last = 0 if self._run is None else len(self._run.views) - 1
            self._chosen, self._following = number, number >= last

    def _to_newest(self) -> None:
        self._following = True
