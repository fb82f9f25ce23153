"""The panels of a run: fan, curve, image, numbers and log. Each is sent again only where it has changed."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from markerseek.bridges.page.curve import curve_options
from markerseek.bridges.page.elements import Fan, Image
from markerseek.bridges.page.models import (
    angle_text,
    answer_text,
    background_model,
    fan_model,
    image_model,
    number_rows,
)
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.state import Snapshot
from markerseek.core import Interval

LOG_LINES = 10
"""Lines of the log that are shown."""

_NOTHING = Snapshot(rig="simulated")


class FanPanel:
    """The fan alone, with the angle below it.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval) -> None:
        self._empty = fan_model(_NOTHING, search, duration_s=0.0, known_deg=None)
        self.fan = Fan(self._empty).classes("ms-fan")
        self._shown: tuple[object, ...] = ()

    def clear(self) -> None:
        """Show the fan alone."""
        self._shown = ()
        self.fan.show(self._empty)

    def show(self, run: RunHistory, snapshot: Snapshot, *, reveal: bool) -> None:
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


class Panels:
    """All panels of one run at a time, in a grid.

    ``search``: range to show before there is a run.
    """

    def __init__(self, search: Interval) -> None:
        self._search = search
        with ui.element("div").classes("ms-panels"):
            with _panel("probe, from its end", "fan"):
                self._fan = FanPanel(search)
            with _panel("intensity and probability over the angle; dashed: noise floor", "curve"):
                self._curve = ui.echart({}).classes("ms-chart").mark("curve")
            with _panel("photoacoustic image", "image"):
                self._image = Image(image_model(None, floor=None)).classes("ms-image")
                self._image_note = ui.label("").classes("ms-note")
            with _panel("what is known", "numbers"):
                self._angle = ui.label("").classes("ms-angle").mark("angle")
                self._answer = ui.label("").classes("ms-answer").mark("answer")
                self._rows: dict[str, ui.label] = {}
                self._table = ui.element("dl").classes("ms-rows")
            with _panel("log", "log"):
                self._log = ui.label("").classes("ms-log").mark("log")
        self.clear()

    def clear(self) -> None:
        """Show the panels alone."""
        self._shown: tuple[object, ...] = ()
        self._image_key: tuple[object, ...] = ()
        self._curve_key: tuple[object, ...] = ()
        self._fan.clear()
        self._show_curve(curve_options(_NOTHING, self._search, known=None))
        self._image.show(image_model(None, floor=None), {})
        self._image_note.set_text("")
        self._angle.set_text("–")
        self._show_answer("")
        self._rows.clear()
        self._table.clear()
        self._log.set_text("")

    def show(self, run: RunHistory, snapshot: Snapshot, *, reveal: bool) -> None:
        """Show a snapshot; the true angle only where it is to be revealed."""
        self._fan.show(run, snapshot, reveal=reveal)
        self._show_image(run, snapshot)
        key = (run, snapshot.number, reveal)
        if key == self._shown:
            return
        self._shown = key
        facts = run.configuration.facts
        known = None if facts.known_deg is None or not reveal else (run.known_name, facts.known_deg)
        # While the probe moves, only the needle changes.
        curve_key = (run, len(snapshot.points), snapshot.belief, reveal)
        if curve_key != self._curve_key:
            self._curve_key = curve_key
            self._show_curve(curve_options(snapshot, facts.search, known=known))
        self._angle.set_text(angle_text(snapshot))
        self._show_answer(answer_text(snapshot))
        self._show_rows(number_rows(snapshot, name=run.name, pulse_j=run.pulse_j))
        self._log.set_text("\n".join(run.lines(snapshot, most=LOG_LINES)))

    def _show_curve(self, options: dict[str, Any]) -> None:
        self._curve.options.clear()
        self._curve.options.update(options)
        self._curve.update()

    def _show_answer(self, answer: str) -> None:
        if answer != self._answer.text:
            # Three lines of it are seen; the pointer shows the rest.
            self._answer.props["title"] = answer
            self._answer.set_text(answer)

    def _show_image(self, run: RunHistory, snapshot: Snapshot) -> None:
        picture = run.picture(snapshot)
        level = snapshot.floor_level
        key = (run, picture, level)
        if key == self._image_key:
            return
        self._image_key = key
        background, note = background_model(picture, simulated=snapshot.rig == "simulated")
        self._image.show(image_model(picture, floor=level, imaged=run.imaged), background)
        self._image_note.set_text(note)

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


def _panel(title: str, name: str) -> ui.element:
    panel = ui.element("section").classes(f"ms-panel ms-panel-{name}").props(f'aria-label="{title}"')
    with panel:
        ui.label(title).classes("ms-title")
    return panel
