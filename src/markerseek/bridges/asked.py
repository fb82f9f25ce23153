"""A search that a page or another program asks for: what it may choose, and the command that this becomes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self
from urllib.parse import urlencode

from markerseek.core import ConfigError, SearchPlan, SimulationOptions, arguments_of, as_text, options_of
from markerseek.search import require_plan
from markerseek.sim import SimulatedSettings, with_options

_OF_PLAN, _OF_SIMULATION = options_of(SearchPlan), options_of(SimulationOptions)

OPTIONS = {option.name: option for option in (*_OF_PLAN, *_OF_SIMULATION)}
"""All that can be chosen, by name: never a file, a rig, or whether a rig is armed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AskedSearch:
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

    def query(self, *, usual: AskedSearch) -> str:
        """The values that differ from the usual ones, as the query of a link."""
        return urlencode({name: as_text(value) for name, value in self.values.items() if value != usual.values[name]})

    def with_query(self, query: Mapping[str, str]) -> tuple[Self, tuple[str, ...]]:
        """The search with the values of a link, and what is wrong with each of those that are left out."""
        names = ", ".join(OPTIONS)
        problems = [f"{name[:40]!r} is no setting; settings are {names}" for name in query if name not in OPTIONS]
        asked = self
        # In their order: what else is possible depends on the method.
        for name, option in OPTIONS.items():
            if name in query:
                try:
                    asked = asked.changed(**{name: option.read(query[name])})
                except ConfigError as problem:
                    problems.append(str(problem))
        return asked, tuple(problems)
