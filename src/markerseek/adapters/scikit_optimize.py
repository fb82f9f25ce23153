"""scikit-optimize's Bayesian optimiser as a policy (extra ``optimizers``)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from markerseek.adapters.optimiser import OptimiserPolicy
from markerseek.core import PAPER_RANGE, Interval, MissingExtraError

INITIAL = 4
"""Angles of the first, space-filling design."""


class ScikitOptimize(OptimiserPolicy):
    """`skopt.Optimizer` on the intensity, turned over: a Gaussian process with noise, acquisition by its "gp_hedge".

    Its settings are those of the package, save the first design, which is shortened to the budget.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    seed
        Seed of its random choices; the same samples and seed give the same angles.

    Raises
    ------
    MissingExtraError
        If scikit-optimize is not installed.
    """

    name = "scikit-optimize"

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16, seed: int = 1) -> None:
        super().__init__(limits=limits, acquisitions=acquisitions)
        try:
            from skopt import Optimizer
        except ImportError as missing:
            raise MissingExtraError(
                package="scikit-optimize", extra="optimizers", purpose="the method scikit-optimize"
            ) from missing
        self._optimizer: Any = Optimizer(
            [(limits.low_deg, limits.high_deg)],
            base_estimator="GP",
            n_initial_points=min(INITIAL, acquisitions),
            initial_point_generator="lhs",
            random_state=seed,
        )
        self._heard = 0

    def _propose(self, asked_deg: Sequence[float], values: Sequence[float]) -> float | None:
        # It warns of angles that come back and of a fit at the edge of its bounds; neither is the user's to mend.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for angle_deg, value in zip(asked_deg[self._heard :], values[self._heard :], strict=True):
                self._optimizer.tell([angle_deg], -value)
                self._heard += 1
            return float(self._optimizer.ask()[0])
