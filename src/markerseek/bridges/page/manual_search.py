"""A search by hand on a simulated rig: a person turns the probe, as an assistant does, and names the angle."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.settings import PageSettings
from markerseek.core import Asked, Measured, SearchError, SearchPlan, Started
from markerseek.rigs import simulated
from markerseek.runs import new_session
from markerseek.sim import SimulatedSettings, changed_settings


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

    def __init__(self, base: SimulatedSettings, chosen: PageSettings) -> None:
        settings = changed_settings(base, tissue=chosen.tissue, snr_db=chosen.snr_db, readout_s=chosen.readout_s)
        self.rig = simulated(seed=chosen.seed, settings=settings)
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
