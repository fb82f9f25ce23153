"""A search or registration that a page or a program asks for: what it may choose, and the command that this becomes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self, TypeAlias
from urllib.parse import urlencode

from markerseek.core import (
    ConfigError,
    Option,
    SearchPlan,
    SimulationOptions,
    arguments_of,
    as_text,
    option,
    options_of,
)
from markerseek.search import require_plan
from markerseek.sim import SimulatedSettings, with_options

_OF_PLAN, _OF_SIMULATION = options_of(SearchPlan), options_of(SimulationOptions)

OPTIONS = {each.name: each for each in (*_OF_PLAN, *_OF_SIMULATION)}
"""All that can be chosen of a search, by name: never a file, a rig, or whether a rig is armed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What is asked for, as values by their names."""

    @classmethod
    def options(cls) -> Mapping[str, Option]:
        """All that can be chosen, by name."""
        return {each.name: each for each in options_of(cls)}

    @property
    def values(self) -> dict[str, Any]:
        """All values by their names."""
        return asdict(self)

    def changed(self, **values: Any) -> Self:
        """The same with other values; `ConfigError` if they cannot be used."""
        return replace(self, **values)

    def query(self, *, usual: Asked) -> str:
        """The values that differ from the usual ones, as the query of a link."""
        return urlencode({name: as_text(value) for name, value in self.values.items() if value != usual.values[name]})

    def with_query(self, query: Mapping[str, str]) -> tuple[Self, tuple[str, ...]]:
        """The same with the values of a link, and what is wrong with each of those that are left out."""
        options = self.options()
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


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedSearch(Asked):
    """The plan of a search, and the simulated rig that it is for.

    Raises
    ------
    ConfigError
        If ``markerseek search`` would refuse them.
    """

    plan: SearchPlan = field(default_factory=SearchPlan)
    """What is chosen of the search."""
    simulation: SimulationOptions = field(default_factory=SimulationOptions)
    """What is chosen of a simulated rig."""

    @classmethod
    def options(cls) -> Mapping[str, Option]:
        """All that can be chosen of a search, by name."""
        return OPTIONS

    def __post_init__(self) -> None:
        require_plan(self.plan)
        with_options(SimulatedSettings(), self.simulation)

    def changed(self, **values: Any) -> Self:
        """The search with other values, by their names in `OPTIONS`."""
        of_plan = {each.name: values.pop(each.name) for each in _OF_PLAN if each.name in values}
        return replace(self, plan=replace(self.plan, **of_plan), simulation=replace(self.simulation, **values))

    @property
    def values(self) -> dict[str, Any]:
        """All values by their names in `OPTIONS`."""
        every = asdict(self.simulation) | {each.name: getattr(self.plan, each.name) for each in _OF_PLAN}
        return {name: every[name] for name in OPTIONS}

    def arguments(self, *, simulated: bool = True) -> list[str]:
        """Options of ``markerseek search``; for a rig of devices only those of the plan."""
        return [*arguments_of(self.plan), *(arguments_of(self.simulation) if simulated else ())]


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedRegistration(Asked):
    """What a registration session is to reach, and the simulated rig that it is for.

    Raises
    ------
    ConfigError
        If ``markerseek register`` would refuse them.
    """

    tre_mm: float = option(0.5)
    """Expected error at the target at which the session ends, in mm."""
    markers: int | None = option(None, shown="as many as it takes", least=3)
    """Number of markers after which the session ends, whatever the error."""
    sweep: bool = option(False)
    """Search each marker by sweeps: an answer in seconds."""
    seed: int | None = option(None, shown="1", least=0)
    """Seed of the simulated session: the same seed gives the same session."""
    pace: float = option(0.0)
    """Real seconds per second of the simulated rig: 0 does not wait, 1 is real time."""

    def __post_init__(self) -> None:
        # Imported here: a command line that names this class needs no mathematics of a registration.
        from markerseek.registration import SessionPlan

        SessionPlan(goal_m=1e-3 * self.tre_mm, markers=self.markers)
        SimulationOptions(seed=self.seed, pace=self.pace)

    def arguments(self, *, simulated: bool) -> list[str]:
        """Options of ``markerseek register``; for a rig of devices only those that are not of the simulation."""
        if simulated:
            return ["--simulate", *arguments_of(self)]
        return arguments_of(replace(self, seed=None, pace=0.0))


AnyAsked: TypeAlias = AskedSearch | AskedRegistration
"""What a page can ask for."""
