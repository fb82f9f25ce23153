"""Optimisers of other packages as search policies, for comparison: SciPy, scikit-optimize, BoTorch.

Each maximises the intensity without a model of its curve. Their packages are imported where they are used.
"""

from __future__ import annotations

from markerseek.adapters.optimiser import BoTorch, BoundedMinimiser, OptimiserPolicy, ScikitOptimize
from markerseek.core import PAPER_RANGE, ConfigError, Interval, Policy
from markerseek.search import CheckedPolicy, Method

_OPTIMISERS: dict[str, type[OptimiserPolicy]] = {
    optimiser.name: optimiser for optimiser in (BoundedMinimiser, ScikitOptimize, BoTorch)
}

ADAPTERS: tuple[Method, ...] = tuple(
    Method(name=each.name, summary=each.summary, acquisitions=16, least=each.least) for each in _OPTIMISERS.values()
)
"""The adapters, in the form of `markerseek.search.METHODS`."""


def build_adapter(
    method: str, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16, as_published: bool = False
) -> Policy:
    """Return a policy that runs another package's optimiser.

    ``method``: name of one of `ADAPTERS`. ``as_published``: the bare optimiser, which always answers; otherwise with
    the checks of all methods (`CheckedPolicy`).
    """
    if method not in _OPTIMISERS:
        raise ConfigError(f"method: {method!r} is not an adapter; adapters are {', '.join(_OPTIMISERS)}")
    optimiser = _OPTIMISERS[method](limits=limits, acquisitions=acquisitions)
    return optimiser if as_published else CheckedPolicy(optimiser, limits=limits)
