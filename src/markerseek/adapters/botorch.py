"""BoTorch's Bayesian optimisation as a policy (extra ``botorch``, with PyTorch)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

from markerseek.adapters.optimiser import INITIAL, SEED, OptimiserPolicy


class BoTorch(OptimiserPolicy):
    """Gaussian process with inferred noise (`SingleTaskGP`) and log noisy expected improvement.

    BoTorch's parts with their defaults: inputs scaled to 0–1, outputs standardised, hyperparameters by the marginal
    likelihood, `qLogNoisyExpectedImprovement` maximised by `optimize_acqf`. The same samples give the same angles.
    """

    name = "botorch"
    summary = "BoTorch's Gaussian process, next the largest expected improvement"
    package, extra = "botorch", "botorch"

    def _propose(self, angles_deg: Sequence[float], values: Sequence[float]) -> float | None:
        initial = min(INITIAL, self._budget)
        if len(angles_deg) < initial:
            # The first design: the centres of equal parts of the range.
            return self._limits.low_deg + self._limits.width_deg * (len(angles_deg) + 0.5) / initial
        import torch
        from botorch.acquisition.logei import qLogNoisyExpectedImprovement
        from botorch.fit import fit_gpytorch_mll
        from botorch.models import SingleTaskGP
        from botorch.models.transforms import Normalize, Standardize
        from botorch.optim import optimize_acqf
        from gpytorch.mlls import ExactMarginalLogLikelihood

        angles = torch.tensor(angles_deg, dtype=torch.float64).unsqueeze(-1)
        heights = torch.tensor(values, dtype=torch.float64).unsqueeze(-1)
        bounds = torch.tensor([[self._limits.low_deg], [self._limits.high_deg]], dtype=torch.float64)
        # BoTorch draws from PyTorch's global generator: its state is restored for other code that uses it.
        with warnings.catch_warnings(), torch.random.fork_rng(devices=[]):
            warnings.simplefilter("ignore")
            torch.manual_seed(SEED + len(angles_deg))
            model = SingleTaskGP(
                angles, heights, input_transform=Normalize(d=1, bounds=bounds), outcome_transform=Standardize(m=1)
            )
            fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model))
            gain = qLogNoisyExpectedImprovement(model, X_baseline=angles)
            candidate, _ = optimize_acqf(gain, bounds=bounds, q=1, num_restarts=8, raw_samples=64)
        return float(candidate[0, 0])
