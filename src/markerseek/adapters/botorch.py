"""BoTorch's Bayesian optimisation as a policy (extra ``botorch``; it brings PyTorch)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from markerseek.adapters.optimiser import OptimiserPolicy
from markerseek.core import PAPER_RANGE, Interval, MissingExtraError

INITIAL = 4
"""Angles of the first design, in the middles of equal parts of the range."""


class BoTorch(OptimiserPolicy):
    """A `SingleTaskGP` of the intensity with inferred noise; next, the largest log expected improvement under noise.

    Made of BoTorch's own parts with their defaults: inputs scaled to 0–1, outputs standardised, hyperparameters by the
    marginal likelihood, `qLogNoisyExpectedImprovement` maximised by `optimize_acqf`.

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
        If BoTorch is not installed.
    """

    name = "botorch"

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16, seed: int = 1) -> None:
        super().__init__(limits=limits, acquisitions=acquisitions)
        try:
            import botorch  # noqa: F401  whether it is there is known before the first acquisition
        except ImportError as missing:
            raise MissingExtraError(package="botorch", extra="botorch", purpose="the method botorch") from missing
        self._seed = seed
        self._initial = min(INITIAL, acquisitions)

    def _propose(self, asked_deg: Sequence[float], values: Sequence[float]) -> float | None:
        if len(asked_deg) < self._initial:
            return self._limits.low_deg + self._limits.width_deg * (len(asked_deg) + 0.5) / self._initial
        import torch
        from botorch.acquisition.logei import qLogNoisyExpectedImprovement
        from botorch.fit import fit_gpytorch_mll
        from botorch.models import SingleTaskGP
        from botorch.models.transforms import Normalize, Standardize
        from botorch.optim import optimize_acqf
        from gpytorch.mlls import ExactMarginalLogLikelihood

        angles = torch.tensor(asked_deg, dtype=torch.float64).unsqueeze(-1)
        heights = torch.tensor(values, dtype=torch.float64).unsqueeze(-1)
        bounds = torch.tensor([[self._limits.low_deg], [self._limits.high_deg]], dtype=torch.float64)
        with warnings.catch_warnings(), torch.random.fork_rng(devices=[]):
            warnings.simplefilter("ignore")
            torch.manual_seed(self._seed + len(asked_deg))
            model = SingleTaskGP(
                angles, heights, input_transform=Normalize(d=1, bounds=bounds), outcome_transform=Standardize(m=1)
            )
            fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
            gain = qLogNoisyExpectedImprovement(model, X_baseline=angles)
            candidate, _ = optimize_acqf(gain, bounds=bounds, q=1, num_restarts=8, raw_samples=64)
        return float(candidate[0, 0])
