"""The policies that a study can name: those of `markerseek.search`, and other people's optimisers as policies."""

from __future__ import annotations

from typing import TYPE_CHECKING

from markerseek.adapters import ADAPTERS, build_adapter
from markerseek.core import ConfigError, Interval, Policy
from markerseek.search import METHODS, Method, build, method_named

if TYPE_CHECKING:
    from markerseek.studies.settings import PolicySettings


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


def build_policy(settings: PolicySettings, *, limits: Interval, start_deg: float | None) -> Policy:
    """Return a policy for one search.

    Parameters
    ----------
    settings
        Which, and how it is set.
    limits
        Range to search.
    start_deg
        Where the probe stands, in degrees.

    Raises
    ------
    ConfigError
        If the settings do not fit together, or (MissingExtraError) an optional package is missing.
    """
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
        )
    # SciPy and the compiled kernels are loaded for whoever wants them.
    from markerseek.search.posterior import TARGET_SIGMA_DEG, Posterior

    return Posterior(
        limits=limits,
        acquisitions=settings.most,
        start_deg=start_deg,
        target_sigma_deg=TARGET_SIGMA_DEG if settings.early_end else 0.0,
        cues=settings.cues,
    )
