"""The panels of a run: verdict, fan, curve, image, numbers, log, and the slider over what has happened."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from html import escape

from msgspec import structs
from nicegui import ui

from markerseek.bridges.page.page_shell import Fan, Heading, ImageView, Slider
from markerseek.bridges.page.run_history import Picture, RunHistory, fan_model, image_model, image_texts, is_image_of
from markerseek.core import Interval, RigFacts, SearchPlan
from markerseek.following import FollowStep
from markerseek.records.journal import RunView
from markerseek.show import SIGMAS, DrawnAngle, DrawnInterval, Verdict, curve_svg, drawn_curve, numbers_of

LOG_LINES = 10
"""Lines of the log that are shown."""

FAN_LEGEND = (
    ("glow", "probability"),
    ("dot", "acquisition (outer: stronger)"),
    ("square", "confirmation"),
    ("arc", "95 %, or bracket"),
    ("tick", "possible next (longer: better)"),
)
"""What is drawn in the fan: its key, and its meaning."""

VERDICT = {
    "angles": {"lead": "lead", "angle": "angle", "sigma": "sigma"},
    "where": {"problem": "fault", "turn": "turn", "interval": "interval", "reason": "answer", "next_step": "next"},
}
"""Class of each part of a verdict, in the order in which it is read."""

LIVE = {"turn": "polite", "problem": "assertive"}
"""Parts that a screen reader reads when they change: what a person has to do, and what went wrong; and how soon."""


class VerdictPanel:
    """The verdict of a run, large enough to be read from two metres."""

    def __init__(self) -> None:
        with ui.element("section").props('aria-label="verdict"') as self._band:
            self._labels = {"word": ui.label("").classes("ms-badge").props('role="status"')}
            for group, names in VERDICT.items():
                with ui.element("div").classes(f"ms-{group}") as part:
                    self._labels |= {name: ui.label("").classes(f"ms-{css}") for name, css in names.items()}
            # A long message is scrolled, with the keyboard too.
            part.props("tabindex=0")
            for name, how in LIVE.items():
                self._labels[name].props(f'aria-live="{how}"')

    def show(self, verdict: Verdict) -> None:
        """Show another verdict."""
        self._band.classes(replace=f"ms-verdict ms-verdict-{verdict.kind}")
        texts = asdict(verdict) | ({"lead": ""} if verdict.angle in {"", "–"} else {})
        for name, label in self._labels.items():
            label.set_text(texts[name])


@contextmanager
def panel(title: str, name: str, *, hint: str) -> Iterator[Heading]:
    """Make a panel with its heading; what follows is put into it.

    ``name``: of its class and its place in ``page.css``. ``hint``: what will appear in it, shown while there is no run.
    """
    with ui.element("section").classes(f"ms-panel ms-panel-{name}").props(f'aria-label="{title}"'):
        heading = Heading(title, level=2).classes("ms-title")
        ui.label(hint).classes("ms-hint")
        yield heading


def add_legend(keys: Iterable[tuple[str, str]]) -> None:
    """Say what is drawn: a key, and its meaning."""
    with ui.element("ul").classes("ms-legend"):
        for key, meaning in keys:
            with ui.element("li"):
                ui.element("span").classes(f"ms-key ms-key-{key}")
                ui.label(meaning)


def show_hints(grid: ui.element, *, are_shown: bool) -> None:
    """Show what will appear in each panel of a grid, or what has appeared."""
    grid.classes(add="ms-empty" if are_shown else None, remove=None if are_shown else "ms-empty")


class RunCharts:
    """Fan and curve of a run, two panels.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval) -> None:
        facts = RigFacts(kind="simulated", description="", fingerprint="", search=search, probe="")
        self._nothing = RunView(plan=SearchPlan(method="posterior"), facts=facts)
        self._shown: RunView | None = None
        fan_hint = "The probe turns here. The glow shows where the marker probably is."
        with panel("probe, from its end", "fan", hint=fan_hint):
            self._fan = Fan().classes("ms-fan")
            add_legend(FAN_LEGEND)
        curve_hint = (
            "Each acquisition becomes a dot: how strong the signal is at that angle. The blue area is the probability "
            "of the marker, and a small picture shows ± 2° about the answer."
        )
        with panel("intensity and probability; dashed: detection threshold", "curve", hint=curve_hint):
            self._curve = ui.html(sanitize=False).classes("ms-chart")
        self.show(None)

    def show_target(self, step: FollowStep) -> None:
        """Show probe and target of a run that follows in the fan, the target with its 95 % interval."""
        goes_deg = step.target_deg if step.turning else None
        self._shown = view = replace(self._nothing, probe_deg=step.probe_deg, target_deg=goes_deg)
        curve = drawn_curve(view, reveal=False)
        if step.target_deg is not None and step.sigma_deg is not None:
            half_deg = SIGMAS * step.sigma_deg
            low_deg = step.target_deg - half_deg
            text = f"target {step.target_deg:.1f}° ± {half_deg:.1f}°"
            curve = structs.replace(
                curve,
                answers=(DrawnAngle(angle_deg=step.target_deg, text=text),),
                answer_text=text,
                is_claimed=step.word == "there",
                interval=DrawnInterval(low_deg=low_deg, high_deg=low_deg + 2 * half_deg, text=text),
            )
        self._fan.show(view=fan_model(view, curve))

    def show(self, view: RunView | None) -> None:
        """Show a run after one of its events; None for no run."""
        view = view or self._nothing
        if view is not self._shown:
            self._shown = view
            curve = drawn_curve(view, reveal=view.phase == "finished")
            self._fan.show(view=fan_model(view, curve))
            self._curve.set_content(curve_svg(curve))


class ImagePanel:
    """The photoacoustic image at the angle where the probe is; else the newest."""

    def __init__(self) -> None:
        hint = "The image at each angle. The marker is a bright spot."
        with panel("photoacoustic image", "image", hint=hint) as self._title:
            self._image = ImageView().classes("ms-image")
            self._note = ui.label("").classes("ms-note")

    def show(self, _run: RunHistory | None, view: RunView | None, picture: Picture | None) -> None:
        """Show an image; None for no run, or none yet."""
        elsewhere = picture is not None and view is not None and not is_image_of(picture, view)
        self._image.show(view=image_model(picture, floor=view.floor_level if view else None))
        title, note = image_texts(picture, elsewhere=elsewhere)
        self._title.set_text(title)
        self._title.classes(replace="ms-title" if picture is None else "ms-image-title" + " ms-elsewhere" * elsewhere)
        self._note.set_text(note)


class NumbersPanel:
    """What is known, in rows."""

    def __init__(self) -> None:
        hint = "How many acquisitions, how much rotation and time, the noise, and other sources."
        with panel("what is known", "numbers", hint=hint):
            self._rows = ui.html(tag="dl", sanitize=False).classes("ms-rows").props("tabindex=0")

    def show(self, run: RunHistory | None, view: RunView | None, _picture: Picture | None) -> None:
        """Show the rows; none for no run."""
        rows = numbers_of(view, name=run.name, pulse_j=run.pulse_j) if run and view else []
        self._rows.set_content("".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows))


class LogPanel:
    """What has happened, the newest first."""

    def __init__(self) -> None:
        with panel("log", "log", hint="One line for each move and each acquisition."):
            self._lines = ui.label("").classes("ms-log").props("tabindex=0")

    def show(self, run: RunHistory | None, view: RunView | None, _picture: Picture | None) -> None:
        """Show the last lines; none for no run."""
        self._lines.set_text("\n".join(run.lines(view, most=LOG_LINES)) if run and view else "")


SEARCH_PANELS = (ImagePanel, NumbersPanel, LogPanel)
"""The panels of a search beside its charts, in the order in which they are read; their places are in ``page.css``."""


class SearchPanels:
    """All panels of a search, in a grid."""

    def __init__(self, search: Interval) -> None:
        self._shown: tuple[RunView | None, Picture | None] | None = None
        with ui.element("div").classes("ms-panels") as self._grid:
            self._charts = RunCharts(search)
            self._panels = [each() for each in SEARCH_PANELS]
        self.show(None, None)

    def show(self, run: RunHistory | None, view: RunView | None) -> None:
        """Show a run after one of its events; None for no run."""
        self._charts.show(view)
        picture = run.picture(view) if run and view else None
        if self._shown == (view, picture):
            return
        self._shown = (view, picture)
        show_hints(self._grid, are_shown=run is None)
        for each in self._panels:
            each.show(run, view, picture)


class Timeline:
    """The slider over the events of a run; at its end it follows a run that goes on."""

    def __init__(self) -> None:
        self._run: RunHistory | None = None
        self._last = 0
        """Number of the newest event."""
        self._chosen: int | None = None
        """Number of the event that a person has chosen; None for the newest."""
        with ui.element("div").classes("ms-foot"):
            self._label = ui.label("").classes("ms-note").style("min-width: 128px")
            self._slider = Slider(min=0, max=1, step=1, value=0, on_change=lambda event: self._choose(event.value))
            self._slider.props('aria-label="event shown" label')
            self._newest = ui.button("newest", on_click=lambda: self._choose(None)).props("flat dense")

    def view(self, run: RunHistory | None) -> RunView | None:
        """The view to be shown: the newest, or the one that was chosen; None for no run."""
        if run is not self._run:
            self._run = run
            self._chosen = None
        self._last = len(run.views) - 1 if run else 0
        shown = self._last if self._chosen is None else min(self._chosen, self._last)
        if self._slider.props.get("max") != max(self._last, 1):
            self._slider.props["max"] = max(self._last, 1)
        self._slider.set_value(shown)
        self._label.set_text(f"event {shown} of {self._last}")
        self._newest.set_enabled(shown < self._last)
        return run.views[shown] if run else None

    def _choose(self, number: int | None) -> None:
        # Also when the slider follows the run: then it is at its end, or where it was.
        self._chosen = None if number is None or number >= self._last else number
