"""All figures and tables by name; what several of them share is made once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

from markerseek.core import ConfigError
from markerseek.studies.paper.consistency import consistency
from markerseek.studies.paper.effort import Effort
from markerseek.studies.paper.failures import failures
from markerseek.studies.paper.fig5 import fig5
from markerseek.studies.paper.fig6 import fig6, table1
from markerseek.studies.paper.fig8 import fig8
from markerseek.studies.paper.offline import Answer, answers
from markerseek.studies.paper.online import fig7, table2
from markerseek.studies.paper.online_runs import OnlineRun, online_runs
from markerseek.studies.paper.recordings import Recording, as_intensities, simulated_banks
from markerseek.studies.paper.reported import reported
from markerseek.studies.paper.section import Section
from markerseek.studies.paper.travel import travel

OFFLINE = ("fig6", "table1")
"""What can be made from a user's own bank."""


class Reproduction:
    """Makes the sections of the report, one by one.

    Parameters
    ----------
    effort
        What may be used.
    folder
        Where banks are written.
    own_bank
        A user's bank in place of the simulated ones; None for those.
    """

    def __init__(self, *, effort: Effort, folder: Path, own_bank: Recording | None = None) -> None:
        self._effort = effort
        self._folder = folder
        self._own_bank = own_bank

    @cached_property
    def _answers(self) -> list[Answer]:
        own, folder, effort = self._own_bank, self._folder / "banks", self._effort
        banks = simulated_banks(folder, effort) if own is None else [as_intensities(own, folder, effort)]
        return answers(banks, effort)

    @cached_property
    def _runs(self) -> list[OnlineRun]:
        return online_runs(self._effort)

    @property
    def makers(self) -> dict[str, Callable[[], Section]]:
        """What can be made, by name, in the order of the report."""
        return {
            "fig5": lambda: fig5(self._effort),
            "fig6": lambda: fig6(self._answers),
            "table1": lambda: table1(self._answers),
            "table2": lambda: table2(self._runs),
            "fig7": lambda: fig7(self._runs),
            "fig8": lambda: fig8(self._runs),
            "travel": lambda: travel(self._effort),
            "consistency": lambda: consistency(self._effort),
            "failures": lambda: failures(self._effort),
        }

    def sections(self, names: Sequence[str]) -> Iterator[Section]:
        """Sections of these names, in this order.

        Raises
        ------
        ConfigError
            If a name is unknown, or cannot be made from a user's own bank; nothing is made then.
        """
        makers = self.makers
        for name in names:
            if name == "fig9":
                raise ConfigError(f"reproduce: fig9 waits. {reported('sensitive').limits}")
            if name not in makers:
                raise ConfigError(f"reproduce: {name!r} is unknown; there are: {', '.join(makers)}, all")
            if self._own_bank is not None and name not in OFFLINE:
                raise ConfigError(f"reproduce: {name} searches on no bank; give --bank with {' or '.join(OFFLINE)}")
        return (makers[name]() for name in names)
