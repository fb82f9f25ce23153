"""The page of a registration session: camera images, fan, expected error, markers, and what to do now."""

from __future__ import annotations

from collections.abc import Mapping

from nicegui import ui

from markerseek.bridges.page.controls import USUAL_REGISTRATION, RunControls
from markerseek.bridges.page.page_searches import ChildRegistration, PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import RunCharts, VerdictPanel, add_legend, panel, show_hints
from markerseek.bridges.page.report_buttons import report_button
from markerseek.bridges.page.reports import make_session_report
from markerseek.bridges.page.session_display import session_chart, session_marks, session_table
from markerseek.core import Interval, Side
from markerseek.registration import REGISTRATION_FILE, SessionView
from markerseek.show import Verdict

_SIDES: tuple[Side, Side] = ("left", "right")

MARKS = (
    ("spot", "spot"),
    ("place", "next spot"),
    ("target", "target, 95 %"),
    ("marker", "markers"),
    ("check", "checks"),
)
"""What is drawn over the images: its key, and its meaning."""

_FIRST = Verdict(next_step="press Start: light spots where the page says, until the error is small enough")


class RegistrationPanels:
    """Cameras, fan, curve, expected error and markers, in a grid; ``prefix``: in front of all paths of the page."""

    def __init__(self, search: Interval, *, prefix: str) -> None:
        self._prefix = prefix
        self._images: dict[Side, ui.html] = {}
        self._marks: dict[Side, ui.html] = {}
        with ui.element("div").classes("ms-registration") as self._grid:
            for side in _SIDES:
                with panel(f"{side} camera", side):
                    with ui.element("div").classes("ms-camera"):
                        self._images[side] = ui.html(sanitize=False)
                        self._marks[side] = ui.html(sanitize=False).classes("ms-marks")
                    add_legend(MARKS)
            self._charts = RunCharts(search)
            with panel("expected error, marker by marker", "tre"):
                self._chart = ui.html(sanitize=False).classes("ms-chart")
            with panel("markers", "markers"):
                self._table = ui.html(sanitize=False).classes("ms-table").props("tabindex=0")
        self._shown: tuple[SessionView, int] | None = None

    def show(self, live: ChildRegistration | None) -> None:
        """Show a session, and the search that goes on in it."""
        run = live.run if live else None
        self._charts.show(run.last if run else None)
        view, images_ns = (live.view, live.images_ns) if live else (ChildRegistration.view, 0)
        if self._shown == (view, images_ns):
            return
        self._shown = (view, images_ns)
        show_hints(self._grid, are_shown=view.begun is None)
        for side in _SIDES:
            image = f'<img src="{self._prefix}/camera/{side}.jpg?{images_ns}" alt="newest image of the {side} camera">'
            self._images[side].set_content(image if images_ns else "")
            self._marks[side].set_content(session_marks(view, side))
        self._chart.set_content(session_chart(view))
        self._table.set_content(session_table(view))


def build_registration_page(searches: PageSearches, query: Mapping[str, str]) -> None:
    """Build the page for one viewer; ``query``: of its link."""
    shell = PageShell(searches, "/")
    with ui.element("div").classes("ms-session"):
        verdict = VerdictPanel()
    spot_is_set = ui.button("Spot is set", icon="flare")
    shell.on_click(spot_is_set, lambda: _say_set(searches.registration))
    controls = RunControls(shell, USUAL_REGISTRATION, query)
    panels = RegistrationPanels(searches.rig.search, prefix=shell.prefix)
    with ui.element("div").classes("ms-foot"):
        save = ui.button("registration JSON", icon="download").props("flat dense")
        reports = [
            report_button(f"report {form.upper()}", f"report.{form}", lambda: _make_report(searches.registration))
            for form in ("html", "pdf")
        ]
    save.on_click(lambda: _download(searches.registration))

    def update() -> None:
        live = searches.registration
        controls.update(live)
        verdict.show(_FIRST if live is None else live.said)
        panels.show(live)
        spot_is_set.set_visibility(live is not None and live.asks_whether_set)
        save.set_visibility(live is not None and live.view.registration is not None)
        for each in reports:
            each.set_visibility(live is not None and live.view.ended is not None)
        shell.show_emulated(live.run if live else None)

    shell.run(update)


def _say_set(live: ChildRegistration | None) -> None:
    """Say that the spot is set: the laser fires some pulses for the cameras."""
    if live is not None:
        live.say_spot_is_set()


def _make_report(live: ChildRegistration | None) -> dict[str, bytes] | None:
    return None if live is None else make_session_report(live.journal)


def _download(live: ChildRegistration | None) -> None:
    """Give the registration as `markerseek igtl` and `ros2` read it."""
    path = None if live is None else live.journal / REGISTRATION_FILE
    if path is not None and path.exists():
        ui.download.content(path.read_bytes(), REGISTRATION_FILE)
