"""All figures and tables by name; what several of them share is computed once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path

from markerseek.core import ConfigError
from markerseek.studies.paper.banks import OfflineBank, as_intensities, simulated_banks
from markerseek.studies.paper.consistency import consistency
from markerseek.studies.paper.failures import failures
from markerseek.studies.paper.fig5 import fig5
from markerseek.studies.paper.fig9 import fig9
from markerseek.studies.paper.offline import OfflineSearch, fig6, offline_searches, table1
from markerseek.studies.paper.online import OnlineSearch, fig7, fig8, online_searches, table2
from markerseek.studies.paper.options import RunOptions
from markerseek.studies.paper.section import Section
from markerseek.studies.paper.travel import travel

OFFLINE = ("fig6", "table1")
"""What can be made from a user's own bank."""


class Reproduction:
    """Makes the sections of the report, one by one.

    ``folder``: where banks are written. ``own_bank``: a user's bank instead of the simulated ones; None for those.
    """

    def __init__(self, *, options: RunOptions, folder: Path, own_bank: OfflineBank | None = None) -> None:
        self._options = options
        self._folder = folder
        self._own_bank = own_bank

    @cached_property
    def _offline(self) -> list[OfflineSearch]:
        own, folder, options = self._own_bank, self._folder / "banks", self._options
        banks = simulated_banks(folder, options) if own is None else [as_intensities(own, folder, options)]
        return offline_searches(banks, options)

    @cached_property
    def _online(self) -> list[OnlineSearch]:
        return online_searches(self._options)

    @property
    def makers(self) -> dict[str, Callable[[], Section]]:
        """Functions that make the sections, by name, in the order of the report.

        Each function of a section gets what it may use (`RunOptions`), or the searches that several sections share.
        """
        return {
            "fig5": lambda: fig5(self._options),
            "fig6": lambda: fig6(self._offline),
            "table1": lambda: table1(self._offline),
            "table2": lambda: table2(self._online),
            "fig7": lambda: fig7(self._online),
            "fig8": lambda: fig8(self._online),
            "fig9": lambda: fig9(self._options),
            "travel": lambda: travel(self._options),
            "consistency": lambda: consistency(self._options),
            "failures": lambda: failures(self._options),
        }

    def sections(self, names: Sequence[str]) -> Iterator[Section]:
        """Sections of these names, in this order.

        Raises `ConfigError` if a name is unknown, or cannot be made from a user's own bank; nothing is made then.
        """
        makers = self.makers
        for name in names:
            if name not in makers:
                raise ConfigError(f"reproduce: {name!r} is unknown; there are: {', '.join(makers)}, all")
            if self._own_bank is not None and name not in OFFLINE:
                raise ConfigError(f"reproduce: {name} uses no bank; give --bank with {' or '.join(OFFLINE)}")
        # Not `yield`: the names are checked at the call, before the first section takes its minutes.
        return (makers[name]() for name in names)
