"""The policies of a study: those of `markerseek.search`, and the optimisers of `markerseek.adapters`."""

from __future__ import annotations

from dataclasses import dataclass

from markerseek.adapters import ADAPTERS, build_adapter
from markerseek.core import MOST_ACQUISITIONS, ConfigError, Interval, Policy
from markerseek.search import METHODS, Method, build, method_named


def method_of(name: str) -> Method:
    """Return the method of that name.

    Raises
    ------
    ConfigError
        If there is none; the message lists the names.
    """
    for method in ADAPTERS:
        if method.name == name:
            return method
    try:
        return method_named(name)
    except ConfigError as problem:
        raise ConfigError(f"{problem}; in a study also {', '.join(method.name for method in ADAPTERS)}") from problem


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicySettings:
    """Settings of one policy, as for `markerseek.search.build`.

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
    single
        Whether a posterior may take it that there is one source only.
    cues
        Features of a reading that a posterior may use, as for `markerseek.search.posterior.Posterior`; None: all.
    """

    method: str
    acquisitions: int | None = None
    as_published: bool = False
    early_end: bool = True
    single: bool = False
    cues: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        least = method_of(self.method).least
        if self.acquisitions is not None and not self.acquisitions >= least:
            raise ConfigError(f"{self.method}: acquisitions is {self.acquisitions}, at least {least} are needed")
        if self.acquisitions is not None and self.acquisitions > MOST_ACQUISITIONS:
            raise ConfigError(
                f"{self.method}: acquisitions is {self.acquisitions}, at most {MOST_ACQUISITIONS} can be made"
            )
        if self.single and self.method != "posterior":
            raise ConfigError(
                f"{self.method}: single is set, but only the posterior looks for other sources; leave it out"
            )
        if self.cues is not None and self.method != "posterior":
            raise ConfigError(f"{self.method}: cues is {list(self.cues)}, only the posterior has any; leave it out")

    @property
    def most(self) -> int:
        """Most acquisitions that it makes."""
        return self.acquisitions or method_of(self.method).acquisitions

    def __str__(self) -> str:
        form = " as published" if self.as_published else ""
        # Named only where it has an effect: labels are the names of lines in a figure.
        end = "" if self.early_end or self.method not in ("weighted-average", "posterior") else ", no early end"
        single = ", single" if self.single else ""
        cues = "" if self.cues is None else f", {' and '.join(self.cues)} only"
        return f"{self.method}{form}, {self.most}{end}{single}{cues}"


def build_policy(settings: PolicySettings, *, limits: Interval, start_deg: float | None) -> Policy:
    """Return a policy for one search.

    Parameters
    ----------
    settings
        Its method and settings.
    limits
        Range to search.
    start_deg
        Angle of the probe, in degrees.

    Raises
    ------
    ConfigError
        If the settings do not fit together, or (MissingExtraError) an optional package is missing.
    """
    # The adapters are not in `build`, so that a search does not import them.
    if settings.method not in {method.name for method in METHODS}:
        return build_adapter(
            settings.method, limits=limits, acquisitions=settings.most, as_published=settings.as_published
        )
    if settings.cues is None:
        return build(
            settings.method,
            limits=limits,
            acquisitions=settings.acquisitions,
            as_published=settings.as_published,
            start_deg=start_deg,
            early_end=settings.early_end,
            single=settings.single,
        )
    # Imported here, because SciPy and the compiled kernels take half a second to load.
    from markerseek.search.posterior import TARGET_SIGMA_DEG, Posterior

    return Posterior(
        limits=limits,
        acquisitions=settings.most,
        start_deg=start_deg,
        target_sigma_deg=TARGET_SIGMA_DEG if settings.early_end else 0.0,
        cues=settings.cues,
        single=settings.single,
    )
