"""The page of a registration session: camera images, fan, expected error, markers, and what to do now."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from nicegui import ui

from markerseek.bridges.page.children import ChildFollowing, ChildRegistration
from markerseek.bridges.page.controls import USUAL_REGISTRATION, RunControls
from markerseek.bridges.page.follow_controls import FollowControls
from markerseek.bridges.page.following_display import follow_chart, follow_marks, follow_rows, follow_verdict
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import RunCharts, VerdictPanel, add_legend, panel, show_hints
from markerseek.bridges.page.report_buttons import report_button
from markerseek.bridges.page.reports import make_session_report
from markerseek.bridges.page.session_display import session_chart, session_marks, session_motion, session_table
from markerseek.core import Interval, Side
from markerseek.registration import REGISTRATION_FILE, SessionView, WatchedMotion
from markerseek.show import Verdict

_SIDES: tuple[Side, Side] = ("left", "right")

MARKS = (
    ("spot", "spot"),
    ("place", "next spot"),
    ("target", "target, 95 %"),
    ("marker", "markers"),
    ("check", "checks"),
    ("aim", "followed"),
)
"""What is drawn over the images: its key, and its meaning."""

_FIRST = Verdict(next_step="press Start: light spots where the page says, until the error is small enough")


ANGLES = (
    ("probe", "probe"),
    ("within", "sensitive range"),
    ("target-line", "target"),
    ("band", "target, 95 %"),
    ("stays", "probe stays"),
)
"""What is drawn of angles over time: its key, and its meaning."""


MOTION = (("tissue", "tissue"), ("moved-spot", "spot"), ("pause", "pause of the breath"), ("unknown", "not seen"))
"""What is drawn of motion over time: its key, and its meaning."""


_HINTS = {
    "left": "The image of the left camera, with the spot, the place for the next one, and the target.",
    "right": "The same for the right camera.",
    "tre": "The expected error at the target, which falls with each marker to its goal.",
    "markers": "One line for each marker: its angle, its residual in the registration, and its use.",
    "follow": "The angles of the target and of the probe over time.",
    "holds": "Target, transform, what the image of the probe said, and the permit.",
    "motion": "What the cameras see of the tissue while a marker is searched: how far it is from where it was.",
}
"""What will appear in each panel, shown while there is no session."""


class RegistrationPanels:
    """Cameras, fan, curve, expected error and markers, in a grid; angles over time in place of the last three.

    ``prefix``: in front of all paths of the page.
    """

    def __init__(self, search: Interval, *, prefix: str) -> None:
        self._prefix = prefix
        self._images: dict[Side, ui.html] = {}
        self._marks: dict[Side, ui.html] = {}
        with ui.element("div").classes("ms-registration") as self._grid:
            for side in _SIDES:
                with panel(f"{side} camera", side, hint=_HINTS[side]):
                    with ui.element("div").classes("ms-camera"):
                        self._images[side] = ui.html(sanitize=False)
                        self._marks[side] = ui.html(sanitize=False).classes("ms-marks")
                    add_legend(MARKS)
            with panel("what the cameras see move", "motion", hint=_HINTS["motion"]):
                self._moves = ui.html(sanitize=False).classes("ms-chart")
                self._moves_said = ui.label("").classes("ms-note")
                add_legend(MOTION)
            self._charts = RunCharts(search)
            with panel("expected error, marker by marker", "tre", hint=_HINTS["tre"]):
                self._chart = ui.html(sanitize=False).classes("ms-chart")
            with panel("markers", "markers", hint=_HINTS["markers"]):
                self._table = ui.html(sanitize=False).classes("ms-table").props("tabindex=0")
            with panel("angles of target and probe", "follow", hint=_HINTS["follow"]):
                self._angles = ui.html(sanitize=False).classes("ms-chart")
                add_legend(ANGLES)
            with panel("what holds", "holds", hint=_HINTS["holds"]):
                self._holds = ui.html(tag="dl", sanitize=False).classes("ms-rows").props("tabindex=0")
        self._shown: tuple[SessionView, int] | None = None
        self._moved: WatchedMotion | None = None
        self._stood: tuple[object, ...] | None = None

    @property
    def left_image(self) -> ui.element:
        """What lies over the image of the left camera, and takes clicks."""
        return self._marks["left"]

    def show_following(self, following: ChildFollowing | None, view: SessionView) -> bool:
        """Show a run that follows, if there is one; returns whether there is."""
        self._grid.classes(
            add=None if following is None else "ms-follows", remove="ms-follows" if following is None else None
        )
        if following is None:
            if self._stood is not None:
                self._stood = None
                self._shown = None
            return False
        stands = (following, following.last, following.images_ns, following.outcome)
        if stands == self._stood:
            return True
        self._stood = stands
        for side in _SIDES:
            self._show_image(side, following.images_ns)
            self._marks[side].set_content(follow_marks(following, view, side))
        if following.last is not None:
            self._charts.show_target(following.last)
        self._angles.set_content(follow_chart(following))
        rows = follow_rows(following)
        self._holds.set_content("".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in rows))
        return True

    def _show_motion(self, motion: WatchedMotion | None) -> None:
        """Show what the cameras see move, under the images."""
        if motion is self._moved:
            return
        self._moved = motion
        self._grid.classes(add=None if motion is None else "ms-moves", remove="ms-moves" if motion is None else None)
        if motion is not None:
            said, chart = session_motion(motion)
            self._moves.set_content(chart)
            self._moves_said.set_text(said)

    def _show_image(self, side: Side, images_ns: int) -> None:
        """Show the newest image of a camera."""
        if images_ns:
            source = f"{self._prefix}/camera/{side}.jpg?{images_ns}"
            self._images[side].set_content(f'<img src="{source}" alt="newest image of the {side} camera">')

    def show(self, live: ChildRegistration | None) -> None:
        """Show a session, and the search that goes on in it."""
        run = live.run if live else None
        self._charts.show(run.last if run else None)
        self._show_motion(None if live is None else live.motion)
        view, images_ns = (live.view, live.images_ns) if live else (ChildRegistration.view, 0)
        if self._shown == (view, images_ns):
            return
        self._shown = (view, images_ns)
        show_hints(self._grid, are_shown=view.begun is None)
        for side in _SIDES:
            if images_ns:
                self._show_image(side, images_ns)
            else:
                self._images[side].set_content("")
            self._marks[side].set_content(session_marks(view, side))
        self._chart.set_content(session_chart(view))
        self._table.set_content(session_table(view))


def build_registration_page(searches: PageSearches, query: Mapping[str, str]) -> None:
    """Build the page for one viewer; ``query``: of its link."""
    shell = PageShell(searches, "/")
    with ui.element("div").classes("ms-session"):
        verdict = VerdictPanel()
    spot_is_set = ui.button("Spot is set", icon="flare")
    shell.on_click(spot_is_set, lambda: _say_set(searches))
    with ui.element("div").classes("ms-bars"):
        following_controls = FollowControls(shell)
        controls = RunControls(shell, USUAL_REGISTRATION, query)
    panels = RegistrationPanels(searches.rig.search, prefix=shell.prefix)
    shell.on_point(panels.left_image, following_controls.point_at)
    with ui.element("div").classes("ms-foot"):
        save = ui.button("registration JSON", icon="download").props("flat dense")
        reports = [
            report_button(f"report {form.upper()}", f"report.{form}", lambda: _make_report(searches.registration))
            for form in ("html", "pdf")
        ]
        folder = ui.label().classes("ms-note")
    save.on_click(lambda: _download(searches.registration))

    def update() -> None:
        live = searches.registration
        following = searches.following
        controls.update(live)
        following_controls.update(live)
        view = ChildRegistration.view if live is None else live.view
        if panels.show_following(following, view) and following is not None:
            verdict.show(follow_verdict(following))
        else:
            verdict.show(_FIRST if live is None else live.said)
            panels.show(live)
        can_point = following_controls.can_point(live, following)
        panels.left_image.classes(add="ms-points" if can_point else None, remove=None if can_point else "ms-points")
        asking = [each for each in (live, following) if each is not None and each.asks_whether_set]
        spot_is_set.set_visibility(bool(asking))
        save.set_visibility(live is not None and live.view.registration is not None)
        for each in reports:
            each.set_visibility(live is not None and live.view.ended is not None)
        folder.set_text(f"recorded in {live.journal}" if live is not None and live.view.begun is not None else "")
        shell.show_emulated(live.run if live else None)

    shell.run(update)


def _say_set(searches: PageSearches) -> None:
    """Say that the spot is set: the laser fires some pulses for the cameras."""
    for each in (searches.registration, searches.following):
        if each is not None:
            each.say_spot_is_set()


def _make_report(live: ChildRegistration | None) -> dict[str, bytes] | None:
    return None if live is None else make_session_report(live.journal)


def _download(live: ChildRegistration | None) -> None:
    """Give the registration as `markerseek igtl` and `ros2` read it."""
    path = None if live is None else live.journal / REGISTRATION_FILE
    if path is not None and path.exists():
        ui.download.content(path.read_bytes(), REGISTRATION_FILE)
