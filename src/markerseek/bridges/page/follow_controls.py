"""The controls of following: what is followed, and the permit that a person gives for it."""

from __future__ import annotations

from msgspec import structs
from nicegui import ui

from markerseek.bridges.page.children import ChildFollowing, ChildRegistration
from markerseek.bridges.page.page_shell import Heading, PageShell
from markerseek.bridges.request import FollowRequest, SessionRequest
from markerseek.core import ConfigError, SceneOptions
from markerseek.following import FollowPlan

VALID = (
    "Since the registration neither probe nor camera were switched off, nor was the probe moved: it holds before a "
    "spot has confirmed it."
)
"""What a person says with the permit; without light nothing else confirms the registration."""


class FollowControls:
    """Offers to follow once a registration holds, asks for the permit, and takes places in the left image."""

    def __init__(self, shell: PageShell) -> None:
        self._shell = shell
        self._searches = shell.searches
        with ui.element("div").classes("ms-controls ms-follow") as self._bar:
            spot = ui.button("Follow the spot", icon="my_location")
            place = ui.button("Follow a place", icon="ads_click")
            for each in (spot, place):
                each.props("outline dense padding='6px 10px'")
            ui.label("or click into the left image: the probe turns there").classes("ms-note")
        shell.on_click(spot, lambda: self._ask(None))
        shell.on_click(place, lambda: self._ask(self._middle))

    def update(self, live: ChildRegistration | None) -> None:
        """Show the controls where one can follow now."""
        self._bar.set_visibility(self._is_offered(live))

    def can_point(self, live: ChildRegistration | None, following: ChildFollowing | None) -> bool:
        """Whether a click into the left image means something now."""
        return self._is_offered(live) or (following is not None and following.takes_points)

    def _is_offered(self, live: ChildRegistration | None) -> bool:
        return live is not None and live.can_follow and not self._searches.busy

    def point_at(self, x: float, y: float) -> None:
        """Take a click into the left image: another place for a run that follows one, or the question for a permit."""
        following = self._searches.following
        if following is not None and following.takes_points:
            following.point_at((x, y))
        elif self._is_offered(self._searches.registration):
            self._ask((x, y))

    @property
    def _middle(self) -> tuple[float, float]:
        """Middle of the left image."""
        live = self._searches.registration
        width, height = (0, 0) if live is None or live.view.begun is None else live.view.begun.size_px
        return width / 2, height / 2

    def _ask(self, pixel: tuple[float, float] | None) -> None:
        """Ask a person for the permit; ``pixel``: None for the spot."""
        usual = FollowPlan()
        what = "the laser spot" if pixel is None else "a place of the left image"
        with ui.dialog(value=True).props('aria-label="permit to follow"') as asked, ui.card().classes("ms-permit"):
            Heading(f"Permit to follow {what}", level=2).classes("ms-kept-title")
            ui.label(self._permitted(usual, lit=pixel is None))
            with ui.element("div").classes("ms-controls"):
                speed = _number("speed [°/s]", usual.speed_deg_s)
                minutes = _number("minutes", usual.minutes)
                within = _number("range [± °]", usual.within_deg)
                places = (
                    [] if pixel is None else [_number(name, round(at, 1)) for name, at in zip("xy", pixel, strict=True)]
                )
            valid = ui.checkbox(VALID, value=False).classes("ms-valid")
            with ui.row():
                yes = ui.button("Permit and follow", icon="play_arrow", color=None).classes("ms-go")
                ui.button("cancel", on_click=asked.close).props("flat")
        asked.on("hide", asked.delete)

        def permit() -> None:
            if pixel is not None and not valid.value:
                raise ConfigError("without light nothing confirms the registration: say that it still holds, or cancel")
            plan = FollowPlan(
                speed_deg_s=_value(speed, "speed"),
                minutes=_value(minutes, "minutes"),
                within_deg=_value(within, "range"),
            )
            at = None if pixel is None else (_value(places[0], "x"), _value(places[1], "y"))
            self._begin(plan, at, still_valid=bool(valid.value))
            asked.close()

        self._shell.on_click(yes, permit)

    def _permitted(self, usual: FollowPlan, *, lit: bool) -> str:
        """Return what is permitted, in a sentence."""
        pulses = (
            f"At rest it lights the spot by {usual.pulses} pulses a look, {usual.looks_per_second:g} looks a second."
            if lit
            else "The laser stays dark."
        )
        return (
            f"The probe turns by itself within {self._searches.rig.search}, in the dark, at most 5° from rest to rest, "
            f"where the target is outside of its range. {pulses} STOP and Escape end it."
        )

    def _begin(self, plan: FollowPlan, pixel: tuple[float, float] | None, *, still_valid: bool) -> None:
        live = self._searches.registration
        if live is None:
            return
        session = live.asked if isinstance(live.asked, SessionRequest) else SessionRequest()
        asked = FollowRequest(
            plan=plan,
            simulation=_in_real_time(session),
            folder=str(live.journal),
            pixel=pixel,
            still_valid=still_valid,
            endoscope_held=session.plan.endoscope_held,
        )
        self._searches.follow(asked, asked_by=self._shell.viewer)


def _in_real_time(session: SessionRequest) -> SceneOptions:
    """Return the simulation of a session as a person follows in it: in real time."""
    return structs.replace(session.simulation, pace=1.0)


def _number(label: str, value: float) -> ui.number:
    return ui.number(label, value=value).props("dense outlined options-dense hide-bottom-space")


def _value(field: ui.number, name: str) -> float:
    """Return the number of a field; `ConfigError` if it is empty."""
    if field.value is None:
        raise ConfigError(f"{name} is empty, it needs a number")
    return float(field.value)
