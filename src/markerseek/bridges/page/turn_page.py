"""The page on which a person turns the probe, names the angle, and then sees the posterior do it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from nicegui import run, ui
from nicegui.events import KeyEventArguments

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.page.controls import USUAL, SettingsRow, start_button
from markerseek.bridges.page.elements import Slider
from markerseek.bridges.page.page_searches import PageSearches
from markerseek.bridges.page.page_shell import PageShell
from markerseek.bridges.page.panels import Panels, VerdictPanel
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.state import Snapshot, with_minus
from markerseek.bridges.page.verdict import Verdict
from markerseek.core import Asked, LimitError, MarkerseekError, Measured, SearchError, SearchPlan, Started, counted
from markerseek.rigs import simulated
from markerseek.runs import new_session
from markerseek.sim import SimulatedSettings, with_options

HELP = (
    "Turn the probe with the slider or the arrow keys, press Measure (Enter), and find where the signal is strongest."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """How a person did."""

    named_deg: float
    truth_deg: float | None
    """``named_deg`` and ``truth_deg``: the angle that was named, and the marker's."""
    acquisitions: int
    travel_deg: float
    elapsed_s: float
    """``acquisitions``, ``travel_deg`` and ``elapsed_s``: the time on the rig's clock."""

    @property
    def error_deg(self) -> float | None:
        """Distance from the marker in degrees; None where there is none."""
        return None if self.truth_deg is None else abs(self.named_deg - self.truth_deg)


class ManualSearch:
    """One search by hand.

    ``chosen``: seed, tissue, noise and receiver; method and speed do not matter.
    """

    def __init__(self, base: SimulatedSettings, chosen: AskedSearch) -> None:
        simulation = chosen.simulation
        self.rig = simulated(seed=simulation.seed or 0, settings=with_options(base, simulation))
        self.chosen = chosen
        # The plan names a method because every plan does; no policy decides here.
        session = new_session(self.rig, SearchPlan(method="exhaustive", stay=True))
        self.run = RunHistory(session.configuration, has_policy=False)
        self._add(Started(start_deg=self.rig.scanner.angle_deg, limits=self.rig.limits.search))
        self._count = 0

    def measure(self, angle_deg: float) -> None:
        """Turn the probe to an angle in degrees, fire, and acquire.

        Raises `LimitError` if it is outside the search range.
        """
        self.rig.limits.require_search(angle_deg)
        self._count += 1
        self._add(Asked(role="search", index=self._count, angle_deg=angle_deg))
        sample = self.rig.scanner.measure(angle_deg)
        self._add(Measured(role="search", index=self._count, sample=sample))

    def name(self, angle_deg: float) -> Score:
        """Name the angle of the marker in degrees, and learn how far off it is.

        Raises `SearchError` if nothing has been measured.
        """
        if self._count == 0:
            raise SearchError("measure at least once before you name an angle")
        last = self.run.snapshots[-1]
        return Score(
            named_deg=angle_deg,
            truth_deg=self.rig.facts.truth_deg,
            acquisitions=self._count,
            travel_deg=last.travel_deg,
            elapsed_s=last.elapsed_s,
        )

    def _add(self, event: Started | Asked | Measured) -> None:
        self.run.add(event, clock_s=self.rig.scanner.clock.now_s())


class TurnPage:
    """The search by hand of one viewer."""

    def __init__(self, searches: PageSearches, base: SimulatedSettings) -> None:
        self._base = base
        self._turn: ManualSearch | None = None
        self._score: Score | None = None
        self._working = False
        self._frame = PageShell(searches, "/turn")
        self._verdict = VerdictPanel()
        limits = base.limits.search
        start_deg = limits.nearest(base.start_deg)
        self._start = Snapshot(rig="simulated", probe_deg=start_deg)
        with ui.element("div").classes("ms-controls"):
            self._measure = start_button("Measure", icon="bolt").on_click(self._fire)
            self._name = ui.button("It is here", icon="flag", on_click=self._name_it)
            self._name.props("dense outline padding='6px 10px'")
            self._show = ui.button("See the posterior do it")
            self._show.props("dense outline padding='6px 10px'")
            self._frame.on_click(self._show, self._let_search)
            ui.button("Begin again", on_click=self._begin).props("dense outline padding='6px 10px'")
            names = ("tissue", "snr_db", "seed", "readout_s")
            # Other settings are another scene.
            self._row = SettingsRow(USUAL.changed(seed=2), names, on_change=lambda _: self._forget())
        with ui.element("div").classes("ms-foot"):
            self._slider = Slider(min=limits.low_deg, max=limits.high_deg, step=0.1, value=start_deg)
            # Else the arrow keys would be the slider's, which turns by a tenth of a degree.
            self._slider.on("change", js_handler="() => document.activeElement?.blur()")
            self._slider.props('aria-label="angle of the probe in degrees"')
        ui.keyboard(on_key=self._key)
        self._panels = Panels(limits)
        self._frame.run(self._update)

    def _forget(self) -> None:
        """Forget the scene; the next acquisition begins a new one."""
        self._turn = self._score = None
        self._panels.clear()

    async def _begin(self) -> ManualSearch | None:
        try:
            self._turn = await run.io_bound(ManualSearch, self._base, self._row.settings)
            self._score = None
        except MarkerseekError as problem:
            ui.notify(str(problem), type="negative", multi_line=True)
        return self._turn

    async def _fire(self) -> None:
        if self._working or self._score is not None:
            return
        self._working = True
        try:
            turn = self._turn or await self._begin()
            if turn is not None:
                await run.io_bound(turn.measure, float(self._slider.value))
        except LimitError as problem:
            ui.notify(str(problem), type="negative")
        finally:
            self._working = False

    async def _key(self, event: KeyEventArguments) -> None:
        """Arrow keys turn by a degree, with Shift by five; Enter measures."""
        if not event.action.keydown:
            return
        if event.key.enter:
            await self._fire()
        step_deg = 5.0 if event.modifiers.shift else 1.0
        turn_deg = {"ArrowLeft": -step_deg, "ArrowRight": step_deg}.get(event.key.name, 0.0)
        limits = self._base.limits.search
        if turn_deg and (wanted_deg := self._slider.value + turn_deg) in limits:
            self._slider.set_value(round(wanted_deg, 1))

    def _name_it(self) -> None:
        if self._turn is None:
            ui.notify("measure first", type="warning")
            return
        try:
            self._score = self._turn.name(float(self._slider.value))
        except MarkerseekError as problem:
            ui.notify(str(problem), type="warning")

    def _let_search(self) -> None:
        chosen = self._row.settings if self._turn is None else self._turn.chosen
        self._frame.searches.start(chosen.changed(method="posterior"), asked_by=self._frame.viewer)
        ui.navigate.to("/?" + chosen.query(usual=USUAL))

    def _update(self) -> None:
        self._name.set_enabled(self._turn is not None and self._score is None)
        self._measure.set_enabled(not self._working and self._score is None and self._row.usable)
        self._show.set_enabled(self._score is not None and not self._frame.searches.busy)
        aim_deg = float(self._slider.value)
        self._verdict.show(aim_verdict(aim_deg) if self._score is None else score_verdict(self._score))
        snapshot = self._start if self._turn is None else self._turn.run.snapshots[-1]
        self._frame.show_status("a scene of its own: nothing is sent to a rig")
        if self._turn is not None:
            # The image is that of the angle that is aimed at, where it has been measured.
            shown = snapshot if self._score is not None else replace(snapshot, probe_deg=aim_deg)
            self._panels.show(self._turn.run, shown, reveal=self._score is not None)
        if self._score is None:
            self._panels.fan.aim(snapshot, aim_deg)


def build_turn_page(searches: PageSearches) -> None:
    """Build the page for one viewer."""
    if isinstance(searches.rig.settings, SimulatedSettings):
        TurnPage(searches, searches.rig.settings)
        return
    frame = PageShell(searches, "/turn")
    ui.label("Turning by hand is for simulated rigs only: start markerseek page without --rig.").classes("ms-help")
    frame.run(lambda: None)


def aim_verdict(aim_deg: float) -> Verdict:
    """Where a person will turn the probe."""
    return Verdict(word="YOUR TURN", kind="busy", lead="turn to", angle=with_minus(f"{aim_deg:z.1f}°"), reason=HELP)


def score_verdict(score: Score) -> Verdict:
    """How a person did."""
    truth = "there is no marker on this rig"
    if score.truth_deg is not None:
        truth = f"the marker is at {score.truth_deg:.2f}°: {score.error_deg:.2f}° off"
    return Verdict(
        word="YOU NAMED",
        kind="idle",
        angle=with_minus(f"{score.named_deg:.1f}°"),
        turn=with_minus(truth),
        reason=f"after {counted(score.acquisitions, 'acquisition')}, {score.travel_deg:.0f}° of rotation and "
        f"{score.elapsed_s:.0f} s (virtual)",
    )
