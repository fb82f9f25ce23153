"""scikit-optimize's Bayesian optimiser as a policy (extra ``optimizers``)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

from markerseek.adapters.optimiser import INITIAL, SEED, OptimiserPolicy
from markerseek.core import PAPER_RANGE, Interval


class ScikitOptimize(OptimiserPolicy):
    """`skopt.Optimizer` on the negative intensity: a Gaussian process with noise, acquisition function "gp_hedge".

    The package's defaults, except that the first design is no longer than the budget. The same samples give the same
    angles.
    """

    name = "scikit-optimize"
    summary = "scikit-optimize's Gaussian process with its own choice of the next angle"
    package, extra = "skopt", "optimizers"

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16) -> None:
        super().__init__(limits=limits, acquisitions=acquisitions)
        from skopt import Optimizer

        self._optimizer: Any = Optimizer(
            [(limits.low_deg, limits.high_deg)],
            base_estimator="GP",
            n_initial_points=min(INITIAL, self._budget),
            initial_point_generator="lhs",
            random_state=SEED,
        )
        self._passed_on = 0

    def _propose(self, angles_deg: Sequence[float], values: Sequence[float]) -> float | None:
        # It warns of repeated angles and of a fit at the edge of its bounds; the user can change neither.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for angle_deg, value in zip(angles_deg[self._passed_on :], values[self._passed_on :], strict=True):
                self._optimizer.tell([angle_deg], -value)
                self._passed_on += 1
            return float(self._optimizer.ask()[0])
