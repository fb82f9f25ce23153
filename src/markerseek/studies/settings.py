"""What a study is made of: ways to search, curves, settings that take several values, and the world of a cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from markerseek.core import MOST_ACQUISITIONS, ConfigError
from markerseek.sim import SimulatedSettings
from markerseek.sim.curves import PowerCurve
from markerseek.studies.policies import method_of

Value: TypeAlias = str | float | int | bool | None
"""A setting that can be varied."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicySettings:
    """One way to search, as for `markerseek.search.build`.

    Attributes
    ----------
    method
        Name of the method.
    acquisitions
        Most acquisitions; None: the method's own.
    as_published
        The paper's form, which always answers.
    early_end
        Whether a weighted average or a posterior may end before its last angle.
    cues
        What of a reading a posterior may use, as for `markerseek.search.posterior.Posterior`; None: all.
    """

    method: str
    acquisitions: int | None = None
    as_published: bool = False
    early_end: bool = True
    cues: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        least = method_of(self.method).least
        if self.acquisitions is not None and not self.acquisitions >= least:
            raise ConfigError(f"{self.method}: acquisitions is {self.acquisitions}, at least {least} are needed")
        if self.acquisitions is not None and self.acquisitions > MOST_ACQUISITIONS:
            raise ConfigError(
                f"{self.method}: acquisitions is {self.acquisitions}, at most {MOST_ACQUISITIONS} can be made"
            )
        if self.cues is not None and self.method != "posterior":
            raise ConfigError(f"{self.method}: cues is {list(self.cues)}, only the posterior has any; leave it out")

    @property
    def most(self) -> int:
        """Most acquisitions that it makes."""
        return self.acquisitions or method_of(self.method).acquisitions

    def __str__(self) -> str:
        form = " as published" if self.as_published else ""
        end = "" if self.early_end or self.method not in ("weighted-average", "posterior") else ", no early end"
        cues = "" if self.cues is None else f", {' and '.join(self.cues)} only"
        return f"{self.method}{form}, {self.most}{end}{cues}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CurveSettings:
    """Where the intensities of the level "curves" come from; at the level "frames" only the acoustics count.

    Attributes
    ----------
    family
        From the acoustics of the rig, or a closed form (`markerseek.sim.curves`).
    fwhm_deg, power
        Full width at half maximum in degrees and exponent of the tails, for the closed forms.
    draws
        Number of spots of a tissue that are drawn and whose curves are computed; a trial takes one of them.
    """

    family: Literal["acoustic", "gaussian", "sech", "power"] = "acoustic"
    fwhm_deg: float = 10.0
    power: float = 1.0
    draws: int = 4

    def __post_init__(self) -> None:
        # The closed forms know their own bounds.
        PowerCurve(fwhm_deg=self.fwhm_deg, power=self.power)
        if not 1 <= self.draws <= 1000:
            raise ConfigError(f"curve: draws is {self.draws}, it must lie between 1 and 1000")


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """A setting that takes several values.

    Attributes
    ----------
    key
        Its name with the parts in front, as in ``rig.noise.peak_snr_db`` or ``curve.fwhm_deg``.
    values
        The values.
    """

    key: str
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise ConfigError(f"vary: {self.key} has no values; give at least one, or leave it out")
        if len(set(self.values)) < len(self.values):
            raise ConfigError(f"vary: {self.key} names a value twice: {list(self.values)}; the cells would be the same")


@dataclass(frozen=True, slots=True, kw_only=True)
class World:
    """Everything that one cell's searches have in common."""

    curve: CurveSettings
    rig: SimulatedSettings
