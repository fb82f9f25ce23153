"""The settings that a person chooses on the page: checked, as a link, and as arguments of the ordinary command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TypeAlias
from urllib.parse import urlencode

import msgspec

from markerseek.core import ConfigError, PolicyPlan, Tolerance, is_whole
from markerseek.search import build, check_acquisitions, method_named, require_sweeping
from markerseek.sim import NoiseSettings, ReceiverSettings, VirtualClock, tissue_named

SONIXDAQ_READOUT_S, REAL_TIME_READOUT_S = 10.0, 0.1
"""Time to read one acquisition in seconds: from the files of a SonixDAQ, and with a receiver that streams."""

USUAL_PACE = 0.05
"""Real seconds for a virtual second: a search of two minutes is shown in six seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSettings:
    """Settings of one search."""

    method: str = "posterior"
    acquisitions: int | None = None
    as_published: bool = False
    tolerance_mm: float | None = None
    """How well the angle of a marker that is found must be known, as in `Tolerance`; None: as usual."""
    sweep: bool = False
    """Whether the probe turns while the laser fires."""
    tissue: str | None = None
    """Simulated material; None: that of the rig."""
    snr_db: float | None = None
    """Peak SNR of a simulated rig, as in `NoiseSettings`; None: that of the rig."""
    readout_s: float | None = None
    """Time to read one acquisition of a simulated rig; None: that of the rig."""
    seed: int = 1
    """Seed of a simulated rig."""
    pace: float = USUAL_PACE
    """Real seconds for a virtual second of a simulated rig."""

    def __post_init__(self) -> None:
        chosen = method_named(self.method)
        if self.acquisitions is not None:
            check_acquisitions(self.acquisitions, least=chosen.least, method=chosen.name)
        if self.as_published:
            # The method itself says whether it was published.
            build(PolicyPlan(method=self.method, as_published=True))
        if self.tolerance_mm is not None:
            Tolerance(mm=self.tolerance_mm)
        if self.sweep:
            require_sweeping(PolicyPlan(method=self.method, as_published=self.as_published))
        if self.tissue is not None:
            tissue_named(self.tissue)
        if self.snr_db is not None:
            NoiseSettings(peak_snr_db=self.snr_db)
        if self.readout_s is not None:
            ReceiverSettings(readout_s=self.readout_s)
        if not (is_whole(self.seed) and 0 <= self.seed < 2**63):
            raise ConfigError(
                f"seed is {'empty' if self.seed is None else self.seed}, it must be a whole number from 0 to 2**63 - 1"
            )
        VirtualClock(pace=self.pace)

    def arguments(self, *, simulated: bool) -> list[str]:
        """Arguments of ``markerseek search``; of a rig of devices only those of the method."""
        given: list[str] = ["--method", self.method]
        if self.acquisitions is not None:
            given += ["--acquisitions", str(self.acquisitions)]
        if self.as_published:
            given.append("--as-published")
        if self.tolerance_mm is not None:
            given += ["--tolerance-mm", _as_text(self.tolerance_mm)]
        if self.sweep:
            given.append("--sweep")
        if not simulated:
            return given
        given += ["--seed", str(self.seed), "--pace", _as_text(self.pace)]
        options = {"--tissue": self.tissue, "--snr-db": self.snr_db, "--readout-s": self.readout_s}
        for name, value in options.items():
            if value is not None:
                given += [name, _as_text(value)]
        return given

    def query(self) -> str:
        """The settings that differ from the usual ones, as the query of a link."""
        usual = PageSettings()
        return urlencode(
            {
                each.name: _as_text(getattr(self, each.name))
                for each in fields(self)
                if getattr(self, each.name) != getattr(usual, each.name)
            }
        )

    @classmethod
    def of_query(cls, query: Mapping[str, str]) -> LinkSettings:
        """Settings of the query of a link, and what is wrong with each of its values that are left out."""
        known = [each.name for each in fields(cls)]
        problems = [
            f"{name[:40]!r} is no setting; settings are {', '.join(known)}" for name in query if name not in known
        ]
        settings, used = cls(), dict[str, str]()
        # In their order: whether a form, or a number of acquisitions, is possible depends on the method.
        for name in (each for each in known if each in query):
            try:
                # Not strict: every value of a link is text.
                settings = msgspec.convert(used | {name: query[name]}, cls, strict=False)
                used[name] = query[name]
            except msgspec.ValidationError as problem:
                # The package's own errors are behind those of the text.
                unread = f"{name} is {query[name][:40]!r}, which cannot be read; correct it, or leave it out"
                problems.append(str(problem.__cause__) if isinstance(problem.__cause__, ConfigError) else unread)
        return settings, tuple(problems)


LinkSettings: TypeAlias = tuple[PageSettings, tuple[str, ...]]
"""Settings of a link, and what is wrong with each of its values that are left out."""


def _as_text(value: object) -> str:
    """A value as it is written, without a loss; a whole number without its zero."""
    return str(int(value)) if isinstance(value, bool) else str(value).removesuffix(".0")
