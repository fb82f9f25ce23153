"""The panels of a run: verdict, fan, curve, image, numbers and log. Each is sent again only where it has changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from nicegui import ui

from markerseek.bridges.page.curve import curve_options
from markerseek.bridges.page.elements import Chart, Fan, Heading, Image
from markerseek.bridges.page.models import (
    background_model,
    fan_model,
    image_model,
    image_note,
    image_title,
    number_rows,
)
from markerseek.bridges.page.run_history import RunHistory, is_image_of
from markerseek.bridges.page.verdict import Verdict
from markerseek.core import Interval, RigFacts, SearchPlan
from markerseek.runs import RunView

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


def nothing_on(search: Interval) -> RunView:
    """The view of a rig on which nothing has happened."""
    facts = RigFacts(kind="simulated", description="", fingerprint="", search=search)
    return RunView(plan=SearchPlan(method="posterior"), facts=facts)


class VerdictPanel:
    """The verdict of a run, large enough to be read from two metres."""

    def __init__(self) -> None:
        self._shown: Verdict | None = None
        with ui.element("section").props('aria-label="verdict"') as self._band:
            self._word = ui.label("").classes("ms-badge").props('role="status"').mark("badge")
            with ui.element("div").classes("ms-angles"):
                self._lead = ui.label("").classes("ms-lead")
                self._angle = ui.label("").classes("ms-angle").mark("angle")
                self._sigma = ui.label("").classes("ms-sigma")
            with ui.element("div").classes("ms-where"):
                self._problem = ui.label("").classes("ms-fault").mark("fault")
                self._turn = ui.label("").classes("ms-turn")
                self._interval = ui.label("").classes("ms-interval")
                self._reason = ui.label("").classes("ms-answer").mark("answer")
                self._next_step = ui.label("").classes("ms-next")
        self.show(Verdict())

    def show(self, verdict: Verdict) -> None:
        """Show another verdict."""
        if verdict == self._shown:
            return
        self._shown = verdict
        self._band.classes(replace=f"ms-verdict ms-verdict-{verdict.kind}")
        for label, text in (
            (self._word, verdict.word),
            (self._lead, verdict.lead if verdict.angle not in {"", "–"} else ""),
            (self._angle, verdict.angle),
            (self._sigma, verdict.sigma),
            (self._problem, verdict.problem),
            (self._turn, verdict.turn),
            (self._interval, verdict.interval),
            (self._reason, verdict.reason),
            (self._next_step, verdict.next_step),
        ):
            label.set_text(text)
        # Some lines of it are seen; the pointer shows the rest.
        self._reason.props["title"] = verdict.reason


class FanPanel:
    """The fan, and what is drawn in it.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval) -> None:
        self._search = search
        self.fan = Fan({}).classes("ms-fan")
        with ui.element("ul").classes("ms-legend"):
            for key, meaning in LEGEND:
                with ui.element("li"):
                    ui.element("span").classes(f"ms-key {key}")
                    ui.label(meaning)
        self.clear()

    def clear(self) -> None:
        """Show the fan alone."""
        self._shown: tuple[object, ...] = ()
        self.fan.show(fan_model(nothing_on(self._search), self._search, duration_s=0.0, known_deg=None))

    def aim(self, snapshot: RunView, angle_deg: float) -> None:
        """Draw the needle where a person will turn the probe."""
        self.fan.show(fan_model(snapshot, self._search, duration_s=0.0, known_deg=None, aim_deg=angle_deg))

    def show(self, run: RunHistory, snapshot: RunView, *, reveal: bool) -> None:
        """Show a snapshot; the true angle only where it is to be revealed."""
        key = (run, snapshot.number, reveal)
        if key == self._shown:
            return
        self._shown = key
        facts = run.configuration.facts
        self.fan.show(
            fan_model(
                snapshot,
                facts.search,
                duration_s=run.move_s(snapshot),
                known_deg=facts.known_deg if reveal else None,
            )
        )


class CurvePanel:
    """Intensity and probability over the angle.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval) -> None:
        self._search = search
        self._chart = Chart({}, said="intensity and probability over the angle").mark("curve")
        self.clear()

    def clear(self) -> None:
        """Show the axes alone."""
        self._shown: tuple[object, ...] = ()
        self._chart.show(curve_options(nothing_on(self._search), self._search, unit="counts", known=None))

    def show(self, run: RunHistory, snapshot: RunView, *, reveal: bool) -> None:
        """Show a snapshot; the true angle only where it is to be revealed."""
        # While the probe moves, only the needle changes.
        key = (run, len(snapshot.points), snapshot.belief, reveal)
        if key == self._shown:
            return
        self._shown = key
        facts = run.configuration.facts
        known = None if facts.known_deg is None or not reveal else (run.known_name, facts.known_deg)
        self._chart.show(curve_options(snapshot, facts.search, unit=run.unit, known=known))


class Panels:
    """All panels of one run at a time, in a grid.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval) -> None:
        with ui.element("div").classes("ms-panels"):
            with panel("probe, from its end", "fan"):
                self.fan = FanPanel(search)
            with panel("intensity and probability; dashed: noise floor", "curve"):
                self._curve = CurvePanel(search)
            with panel("photoacoustic image", "image") as title:
                self._image_title = title
                self._image = Image(image_model(None, floor=None)).classes("ms-image")
                self._image_note = ui.label("").classes("ms-note")
            with panel("what is known", "numbers"):
                self._rows: dict[str, ui.label] = {}
                self._table = ui.element("dl").classes("ms-rows")
            with panel("log", "log"):
                self._log = ui.label("").classes("ms-log").props("tabindex=0").mark("log")
        self.clear()

    def clear(self) -> None:
        """Show the panels alone."""
        self._shown: tuple[object, ...] = ()
        self._image_key: tuple[object, ...] = ()
        self.fan.clear()
        self._curve.clear()
        self._image.show(image_model(None, floor=None), {})
        self._image_title.set_text(image_title(None, elsewhere=False))
        self._image_note.set_text("")
        self._rows.clear()
        self._table.clear()
        self._log.set_text("")

    def show(self, run: RunHistory, snapshot: RunView, *, reveal: bool) -> None:
        """Show a snapshot; the true angle only where it is to be revealed."""
        self.fan.show(run, snapshot, reveal=reveal)
        self._curve.show(run, snapshot, reveal=reveal)
        self._show_image(run, snapshot)
        key = (run, snapshot.number)
        if key == self._shown:
            return
        self._shown = key
        self._show_rows(number_rows(snapshot, name=run.name, unit=run.unit, pulse_j=run.pulse_j))
        self._log.set_text("\n".join(run.lines(snapshot, most=LOG_LINES)))

    def _show_image(self, run: RunHistory, snapshot: RunView) -> None:
        picture = run.picture(snapshot)
        elsewhere = picture is not None and not is_image_of(picture, snapshot)
        key = (run, picture, snapshot.floor_level, elsewhere)
        if key == self._image_key:
            return
        self._image_key = key
        self._image.show(image_model(picture, floor=snapshot.floor_level, imaged=run.imaged), background_model(picture))
        self._image_title.set_text(image_title(picture, elsewhere=elsewhere))
        self._image_title.classes(replace="ms-title" if picture is None else "ms-image-title")
        self._image_title.classes(add="ms-elsewhere" if elsewhere else "")
        self._image_note.set_text(image_note(picture, simulated=snapshot.facts.kind == "simulated"))

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
    """A panel in which what follows is put, with its heading."""
    with ui.element("section").classes(f"ms-panel ms-panel-{name}").props(f'aria-label="{title}"'):
        yield Heading(title, level=2).classes("ms-title")
