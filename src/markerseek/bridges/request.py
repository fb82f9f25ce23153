"""A search or registration that a page or a program asks for: what it may choose, and the command that this becomes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Self, TypeAlias
from urllib.parse import urlencode

import msgspec
from msgspec import structs

from markerseek.core import (
    ConfigError,
    Option,
    SceneOptions,
    SearchPlan,
    SimulationOptions,
    arguments_of,
    as_text,
    options_of,
)
from markerseek.following import FollowPlan
from markerseek.registration import SessionPlan
from markerseek.search import require_plan
from markerseek.sim import SimulatedSettings, with_options

OPTIONS = {each.name: each for each in (*options_of(SearchPlan), *options_of(SimulationOptions))}
"""All that can be chosen of a search, by name: never a file, a rig, or whether a rig is armed."""


class RunRequest(msgspec.Struct, frozen=True, kw_only=True):
    """What is asked for: a plan, and the simulated rig that it is for."""

    plan: SearchPlan | SessionPlan | FollowPlan
    """What is chosen of the search, of the session, or of the run that follows."""
    simulation: SceneOptions
    """What is chosen of a simulated rig."""

    @property
    def options(self) -> Mapping[str, Option]:
        """All that can be chosen, by name."""
        return {each.name: each for each in (*options_of(type(self.plan)), *options_of(type(self.simulation)))}

    @property
    def values(self) -> dict[str, Any]:
        """All values by their names in `options`."""
        chosen = structs.asdict(self.plan) | structs.asdict(self.simulation)
        return {name: chosen[name] for name in self.options if name in chosen}

    def changed(self, **values: Any) -> Self:
        """The same with other values, by their names in `options`; `ConfigError` if they cannot be used."""
        names = [each.name for each in options_of(type(self.plan)) if each.name in values]
        of_plan = {name: values.pop(name) for name in names}
        return structs.replace(
            self, plan=structs.replace(self.plan, **of_plan), simulation=structs.replace(self.simulation, **values)
        )

    def arguments(self, *, simulated: bool = True) -> list[str]:
        """Options of the command; for a rig of devices only those of the plan."""
        return [*arguments_of(self.plan), *(arguments_of(self.simulation) if simulated else ())]

    def query(self, *, usual: RunRequest) -> str:
        """The values that differ from the usual ones, as the query of a link."""
        return urlencode({name: as_text(value) for name, value in self.values.items() if value != usual.values[name]})

    def with_query(self, query: Mapping[str, str]) -> tuple[Self, tuple[str, ...]]:
        """The same with the values of a link, and what is wrong with each of those that are left out."""
        options = self.options
        names = ", ".join(options)
        problems = [f"{name[:40]!r} is no setting; settings are {names}" for name in query if name not in options]
        asked = self
        # In their order: what else is possible depends on the method.
        for name, chosen in options.items():
            if name in query:
                try:
                    asked = asked.changed(**{name: chosen.read(query[name])})
                except ConfigError as problem:
                    problems.append(str(problem))
        return asked, tuple(problems)


class SearchRequest(RunRequest, frozen=True, kw_only=True):
    """The plan of a search, and the simulated rig that it is for.

    Raises
    ------
    ConfigError
        If ``markerseek search`` would refuse them.
    """

    plan: SearchPlan = SearchPlan()
    """What is chosen of the search."""
    simulation: SimulationOptions = SimulationOptions()
    """What is chosen of a simulated rig."""

    def __post_init__(self) -> None:
        require_plan(self.plan)
        with_options(SimulatedSettings(), self.simulation)


class SessionRequest(RunRequest, frozen=True, kw_only=True):
    """The plan of a registration session, and the simulated rig that it is for.

    Raises
    ------
    ConfigError
        If ``markerseek register`` would refuse them.
    """

    plan: SessionPlan = SessionPlan()
    """What is chosen of the session."""
    simulation: SceneOptions = SceneOptions()
    """What is chosen of a simulated rig."""

    def __post_init__(self) -> None:
        with_options(SimulatedSettings(), self.simulation)

    @property
    def options(self) -> Mapping[str, Option]:
        """All that can be chosen, by name; the target is one text."""
        return {**super().options, TARGET.name: TARGET}

    @property
    def values(self) -> dict[str, Any]:
        """All values by their names in `options`."""
        target_m = self.plan.target_trus_m
        target = None if target_m is None else " ".join(f"{1e3 * value:g}" for value in target_m)
        return {**super().values, TARGET.name: target}

    def changed(self, **values: Any) -> Self:
        """The same with other values, by their names in `options`; `ConfigError` if they cannot be used."""
        if TARGET.name not in values:
            return super().changed(**values)
        target_trus_m = _target_m(values.pop(TARGET.name))
        other = super().changed(**values)
        return structs.replace(other, plan=structs.replace(other.plan, target_trus_m=target_trus_m))

    def arguments(self, *, simulated: bool = True) -> list[str]:
        """Options of the command; for a rig of devices only those of the plan."""
        target = self.values[TARGET.name]
        words = [*super().arguments(simulated=simulated), *([] if target is None else [TARGET.flag, *target.split()])]
        return ["--simulate", *words] if simulated else words


TARGET = Option(
    name="target_mm",
    kind=str,
    default=None,
    shown="20 mm under the middle of the markers",
    least=None,
    help="Point at which the error counts: X Y Z in the TRUS frame, in mm.",
)
"""The target of a session."""


def _target_m(text: str | None) -> tuple[float, float, float] | None:
    """Return the target of a text; None if it is empty, for the usual one."""
    words = [] if text is None else text.replace(",", " ").split()
    if not words:
        return None
    try:
        x, y, z = (float(word) / 1e3 for word in words)
    except ValueError:
        x = y = z = math.nan
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        reason = "it must be three finite numbers, such as 0 0 40"
        raise ConfigError(f"{TARGET.name} is {text!r:.40}, {reason}")
    return x, y, z


class FollowRequest(RunRequest, frozen=True, kw_only=True):
    """What a person permits of a run that follows, and what it follows."""

    plan: FollowPlan = FollowPlan()
    """What is chosen of following: its speed, its duration, its range."""
    simulation: SceneOptions = SceneOptions()
    """What was chosen of a simulated rig."""
    folder: str
    """Folder of the session whose registration is used."""
    pixel: tuple[float, float] | None = None
    """Pixel of the left image at which somebody points; None: the laser spot."""
    still_valid: bool = False
    """Whether the person says that neither probe nor camera were switched off, nor was the probe moved."""
    endoscope_held: bool = False
    """Whether the endoscope is held so that it cannot move."""

    def arguments(self, *, simulated: bool = True) -> list[str]:
        """Options of the command; for a rig of devices only those of the plan."""
        what = ["--spot"] if self.pixel is None else ["--pixel", *(f"{value:.1f}" for value in self.pixel)]
        words = [*super().arguments(simulated=simulated), "--registration", self.folder, *what]
        if self.still_valid:
            words.append("--still-valid")
        if simulated:
            # A simulated run ends after half a minute if nobody says how long it lasts: here its permit says it.
            return ["--simulate", *words, "--seconds", f"{60 * self.plan.minutes + 1:g}"]
        return [*words, "--endoscope-held"] if self.endoscope_held else words


AnyRequest: TypeAlias = SearchRequest | SessionRequest | FollowRequest
"""What a page can ask for."""
