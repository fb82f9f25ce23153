"""The page of a registration session: camera images, fan, expected error, markers, and what to do now."""

from __future__ import annotations

from nicegui import ui

from markerseek.bridges.asked import AskedRegistration
from markerseek.bridges.page.child_registration import ChildRegistration
from markerseek.bridges.page.controls import USUAL_REGISTRATION, SettingsRow, hold_in_link, start_button
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import RunPanels, VerdictPanel, panel
from markerseek.bridges.page.registration_state import RegistrationState, Side
from markerseek.bridges.page.run_history import RunHistory
from markerseek.registration import REGISTRATION
from markerseek.runs import Verdict

SIDES: tuple[Side, Side] = ("left", "right")

LEGEND = (
    ("ms-key-spot", "spot"),
    ("ms-key-place", "next spot"),
    ("ms-key-target", "target, 95 %"),
    ("ms-key-marker", "markers"),
)
"""What is drawn over the images: class of its key, and its meaning."""


class RegistrationPanels:
    """Cameras, fan, curve, expected error and markers; each is sent again only if it has changed."""

    def __init__(self, searches: PageSearches) -> None:
        self._images: dict[Side, ui.html] = {}
        self._marks: dict[Side, ui.html] = {}
        with ui.element("div").classes("ms-registration") as self._grid:
            for side in SIDES:
                with panel(f"{side} camera", side):
                    with ui.element("div").classes("ms-camera"):
                        self._images[side] = ui.html(sanitize=False)
                        self._marks[side] = ui.html(sanitize=False).classes("ms-marks")
                    with ui.element("ul").classes("ms-legend"):
                        for key, meaning in LEGEND:
                            with ui.element("li"):
                                ui.element("span").classes(f"ms-key {key}")
                                ui.label(meaning)
            self._run = RunPanels(searches.rig.search, charts=True)
            with panel("expected error, marker by marker", "tre"):
                self._chart = ui.html(sanitize=False).classes("ms-chart").mark("tre")
            with panel("markers", "markers"):
                self._table = ui.html(sanitize=False).classes("ms-table").props("tabindex=0")
        self._shown: tuple[RegistrationState | None, int] | None = None
        self.show(RegistrationState(), 0, None)

    def show(self, state: RegistrationState, images_ns: int, run: RunHistory | None) -> None:
        """Show a session; ``images_ns``: when its images were written, ``run``: the search that goes on."""
        if run is None:
            self._run.clear()
        else:
            self._run.show(run, run.last, reveal=False)
        if self._shown is not None and self._shown[0] is state and self._shown[1] == images_ns:
            return
        self._shown = (state, images_ns)
        self._grid.classes(add="" if state.begun else "ms-empty", remove="ms-empty" if state.begun else "")
        for side in SIDES:
            image = f'<img src="/camera/{side}.jpg?{images_ns}" alt="newest image of the {side} camera">'
            self._images[side].set_content(image if images_ns else "")
            self._marks[side].set_content(state.marks(side))
        self._chart.set_content(state.chart())
        self._table.set_content(state.table())


def build_registration_page(searches: PageSearches, link: tuple[AskedRegistration, tuple[str, ...]]) -> None:
    """Build the page for one viewer; ``link``: settings of its link, and what is wrong with those left out."""
    frame = PageShell(searches, "/")
    with ui.element("div").classes("ms-session"):
        verdict = VerdictPanel()
    simulated = searches.rig.simulated
    with ui.element("div").classes("ms-controls"):
        start = start_button("Start").mark("start")
        go_on = ui.button("Go on", icon="play_arrow").props("dense outline padding='6px 10px'")
        names = ("seed", "tre_mm", "markers", "sweep", "pace") if simulated else ("tre_mm", "markers", "sweep")
        on_change = hold_in_link("/", USUAL_REGISTRATION)
        row = SettingsRow(link[0], names, usual=USUAL_REGISTRATION, problems=link[1], on_change=on_change)
        save = ui.button("registration JSON", icon="download").props("flat dense")
    panels = RegistrationPanels(searches)
    frame.on_click(start, lambda: searches.register(row.settings))
    frame.on_click(go_on, searches.go_on_registering)
    save.on_click(lambda: _download(searches.registration))
    shown: ChildRegistration | None = None

    def update() -> None:
        nonlocal shown
        live = searches.registration
        start.set_enabled(not searches.busy and row.usable)
        go_on.set_visibility(live is not None and live.can_go_on)
        if live is not None and live is not shown:
            row.follow(live.asked)
        shown = live
        save.set_visibility(live is not None and live.state.registered)
        said = session_verdict(live, simulated=simulated)
        verdict.show(said)
        elsewhere = searches.busy and (live is None or live.status == "ended")
        status = "a search runs on the other page" if elsewhere else "ready" if live is None else said.word.lower()
        frame.show_status(status, alarms=live is not None and live.failed)
        if live is not None:
            panels.show(live.state, live.images_ns, live.run)

    frame.run(update)


def session_verdict(live: ChildRegistration | None, *, simulated: bool) -> Verdict:
    """What a session says in large letters, and what a person has to do."""
    if live is None:
        return Verdict(next_step="press Start: light spots where the page says, until the error is small enough")
    if live.status != "ended":
        if live.status == "stopping":
            return Verdict(word="STOPPING", kind="busy")
        return live.state.verdict(next_step="" if simulated else "answer in the terminal where the page was started")
    if live.state.ended is not None and not live.failed:
        return live.state.verdict(next_step=f"recorded in {live.journal}")
    goes_on = f"Start begins a new session, Go on continues this one; in a terminal: {live.goes_on}"
    if live.failed:
        return Verdict(word="FAULT", kind="fault", problem=live.message, next_step=goes_on)
    return Verdict(word="STOPPED", kind="stopped", reason=live.message, next_step=goes_on)


def _download(live: ChildRegistration | None) -> None:
    """Give the registration as `markerseek igtl` and `ros2` read it."""
    path = None if live is None or live.journal is None else live.journal / REGISTRATION
    if path is not None and path.exists():
        ui.download.content(path.read_bytes(), REGISTRATION)
