"""Other people's optimisers as policies, for comparison on equal terms: scikit-optimize, BoTorch, SciPy.

Each maximises the intensity and knows nothing of its curve. The packages are imported where they are used.
"""

from __future__ import annotations

from markerseek.core import PAPER_RANGE, ConfigError, Interval, Policy
from markerseek.search import Guarded, Method

ADAPTERS: tuple[Method, ...] = (
    Method(
        name="bounded-minimiser",
        summary="SciPy's bounded minimiser (Brent) on the intensity",
        acquisitions=16,
        least=1,
    ),
    Method(
        name="scikit-optimize",
        summary="scikit-optimize's Gaussian process with its own choice of the next angle",
        acquisitions=16,
        least=2,
    ),
    Method(
        name="botorch",
        summary="BoTorch's Gaussian process, next the largest expected improvement",
        acquisitions=16,
        least=2,
    ),
)
"""The adapters, as `markerseek.search.METHODS` lists the methods."""


def build_adapter(
    method: str, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16, as_published: bool = False
) -> Policy:
    """Return a policy that runs another package's optimiser.

    Parameters
    ----------
    method
        Name of one of `ADAPTERS`.
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    as_published
        The bare optimiser, which always answers; else it must prove its answer, as every method must (`Guarded`).

    Raises
    ------
    ConfigError
        If there is no such adapter, or (MissingExtraError) its package is not installed.
    """
    # Each module is loaded for whoever wants it.
    if method == "bounded-minimiser":
        from markerseek.adapters.bounded_minimiser import BoundedMinimiser as Optimiser
    elif method == "scikit-optimize":
        from markerseek.adapters.scikit_optimize import ScikitOptimize as Optimiser  # type: ignore[assignment]
    elif method == "botorch":
        from markerseek.adapters.botorch import BoTorch as Optimiser  # type: ignore[assignment]
    else:
        names = ", ".join(each.name for each in ADAPTERS)
        raise ConfigError(f"method: {method!r} is no adapter; adapters are {names}")
    inner = Optimiser(limits=limits, acquisitions=acquisitions)
    return inner if as_published else Guarded(inner, limits=limits)
