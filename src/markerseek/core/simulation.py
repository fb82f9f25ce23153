"""What a person can choose of a simulated rig."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.core.checks import is_whole
from markerseek.core.errors import ConfigError
from markerseek.core.options import arguments_of, option

USUAL_SEED = 1
"""Seed of a simulation, where a person names none."""


MAX_PACE = 100.0
"""Slowest simulation, in real seconds for a virtual one: a search of five minutes takes a working day."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationOptions:
    """Settings of a simulated rig in place of those of its rig file (`markerseek.sim.with_options`).

    None leaves the file's value.

    Raises
    ------
    ConfigError
        If they contradict each other, or a number cannot be used.
    """

    seed: int | None = option(None, shown=str(USUAL_SEED), least=0)
    """Seed of the simulation: the same seed gives the same search."""
    snr_db: float | None = option(None, shown="40")
    """Peak SNR of the simulated image with the probe on the marker, in dB."""
    tissue: str | None = option(None)
    """Simulated material, instead of the rig's; an unknown name lists them all."""
    marker_deg: float | None = option(None, shown="drawn at random")
    """Angle of the simulated marker, in degrees."""
    second_marker_deg: float | None = option(None)
    """Angle of a second simulated marker, as strong, elsewhere along the array."""
    no_marker: bool = option(False)
    """Simulate noise and clutter alone."""
    readout_s: float | None = option(None, shown="10")
    """Seconds to read one acquisition of a simulated rig, instead of the rig's."""
    pace: float = option(0.0)
    """Real seconds per virtual second: 0 does not wait, 1 is real time."""

    def __post_init__(self) -> None:
        if self.no_marker and (self.marker_deg, self.second_marker_deg) != (None, None):
            raise ConfigError("--no-marker contradicts --marker-deg and --second-marker-deg; leave it or them out")
        if self.seed is not None and not (is_whole(self.seed) and 0 <= self.seed < 2**63):
            raise ConfigError(f"seed is {self.seed!r}, it must be a whole number from 0 to 2**63 - 1")
        require_pace(self.pace)

    def given(self) -> list[str]:
        """The options that were given, as they are typed."""
        return [each.replace("=", " ") for each in arguments_of(self)]


def require_pace(pace: float) -> None:
    """Refuse a pace that cannot be meant."""
    if not 0 <= pace <= MAX_PACE:
        raise ConfigError(f"pace is {pace}, it must lie between 0 (does not wait) and {MAX_PACE:g}; 1 is real speed")
