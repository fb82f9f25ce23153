"""Optimisers of other packages as policies, for comparison: SciPy's bounded minimiser, scikit-optimize and BoTorch.

Each maximises the intensity without a model of its curve, and answers with its strongest sample. A study takes them as
policies of one's own, from the root of the repository: ``method = "benchmarks.optimisers:ScikitOptimize"``. The package
must be installed: ``pip install scikit-optimize``, ``pip install botorch``.
"""

from __future__ import annotations

import importlib
import math
import warnings
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

from markerseek.core import PAPER_RANGE, Found, Interval
from markerseek.search import CheckedPolicy, SearchPolicy, check_acquisitions

CLEARLY_WEAKER = 3.0
"""Standard deviations of the noise by which a sample must be weaker than the strongest to bound the maximum."""

INITIAL = 4
"""Angles of the first, space-filling design of the Bayesian optimisers."""

SEED = 1
"""Seed of their random choices."""


class OptimiserPolicy(SearchPolicy):
    """A maximiser of one variable as a policy, which always answers with the angle of its strongest sample.

    The interval reaches to the nearest weaker samples on either side; where the noise is known, to the nearest that
    are weaker by `CLEARLY_WEAKER`. The maximum of a curve with one peak lies between them. The interval is a bracket
    and has no probability.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.

    Raises
    ------
    ConfigError
        If there are too few acquisitions.
    ImportError
        If the package is not installed.
    """

    least: ClassVar[int] = 2
    """Fewest acquisitions."""

    package: ClassVar[str | None] = None
    """Package that it imports."""

    def __init__(self, *, limits: Interval = PAPER_RANGE, acquisitions: int = 16) -> None:
        super().__init__()
        self._budget = check_acquisitions(acquisitions, least=self.least, method=self.name)
        if self.package is not None:
            # Before the first acquisition, not at the end of the first design.
            importlib.import_module(self.package)
        self._limits = limits

    @abstractmethod
    def _propose(self, angles_deg: Sequence[float], values: Sequence[float]) -> float | None:
        """Return the next angle in degrees inside the range, or None to end.

        ``angles_deg`` are the angles of the samples, moved to the nearer end of the range where they lie outside;
        ``values`` are the intensities divided by the first that is not 0.
        """

    def estimate(self) -> Found:
        """Angle of the strongest sample; the middle of the range before the first."""
        return self.answer(noise_sigma=None)

    def answer(self, *, noise_sigma: float | None) -> Found:
        """The same angle, bounded by samples that are weaker by more than the noise explains.

        Parameters
        ----------
        noise_sigma
            Standard deviation of the intensity, in the intensity's unit; None: any weaker sample bounds it.
        """
        if not self._lit:
            return self._found(self._limits.centre_deg, self._limits)
        best = max(self._lit, key=lambda sample: sample.reading.intensity)
        level = best.reading.intensity
        if noise_sigma is not None:
            level -= CLEARLY_WEAKER * noise_sigma
        weaker = [self._inside(sample.angle_deg) for sample in self._lit if sample.reading.intensity < level]
        mean_deg = self._inside(best.angle_deg)
        low_deg = max((angle_deg for angle_deg in weaker if angle_deg < mean_deg), default=self._limits.low_deg)
        high_deg = min((angle_deg for angle_deg in weaker if angle_deg > mean_deg), default=self._limits.high_deg)
        return self._found(mean_deg, Interval(low_deg=low_deg, high_deg=high_deg))

    def _found(self, mean_deg: float, bracket: Interval) -> Found:
        return Found(
            mean_deg=mean_deg,
            sigma_deg=bracket.width_deg / math.sqrt(12),
            interval95_deg=bracket,
            interval_kind="bracket",
        )

    def _next_deg(self) -> float | None:
        if len(self._lit) >= self._budget:
            return None
        # The next angle must not depend on the unit of the intensities.
        unit = next((s.reading.intensity for s in self._lit if s.reading.intensity > 0), 1.0)
        angle_deg = self._propose(
            [self._inside(sample.angle_deg) for sample in self._lit],
            [sample.reading.intensity / unit for sample in self._lit],
        )
        return None if angle_deg is None else self._inside(angle_deg)

    def _inside(self, angle_deg: float) -> float:
        """The angle, or the nearer end of the range if the stage went beyond it: the optimisers accept no other."""
        return self._limits.nearest(angle_deg)


TOLERANCE_DEG = 1e-3
"""Change of the angle at which it ends, in degrees."""


class _NotMeasuredError(Exception):
    """The minimiser evaluates an angle that has not been measured yet."""

    def __init__(self, angle_deg: float) -> None:
        super().__init__(angle_deg)
        self.angle_deg = angle_deg


class BoundedMinimiser(OptimiserPolicy):
    """`scipy.optimize.minimize_scalar(method="bounded")` on the negative intensity.

    Where the stage stops next to the requested angle, the minimiser uses the value as that of the requested angle.
    """

    name = "bounded-minimiser"
    least = 1

    def _propose(self, angles_deg: Sequence[float], values: Sequence[float]) -> float | None:
        from scipy.optimize import minimize_scalar

        measured: Iterator[float] = iter(values)

        def negative_intensity(angle_deg: float) -> float:
            value = next(measured, None)
            if value is None:
                raise _NotMeasuredError(float(angle_deg))
            return -value

        # `minimize_scalar` runs its own loop. It is therefore restarted for each acquisition and replays the measured
        # values: the method draws nothing at random and takes microseconds, so that it requests the same angles again.
        try:
            minimize_scalar(
                negative_intensity,
                bounds=(self._limits.low_deg, self._limits.high_deg),
                method="bounded",
                options={"xatol": TOLERANCE_DEG, "maxiter": len(angles_deg) + 1},
            )
        except _NotMeasuredError as wanted:
            return wanted.angle_deg
        return None


def checked_minimiser(*, limits: Interval = PAPER_RANGE, acquisitions: int = 16) -> CheckedPolicy:
    """`BoundedMinimiser` with the checks that the paper's methods have here: it claims only what it knows."""
    return CheckedPolicy(BoundedMinimiser(limits=limits, acquisitions=acquisitions), limits=limits)


class ScikitOptimize(OptimiserPolicy):
    """`skopt.Optimizer` on the negative intensity: a Gaussian process with noise, acquisition function "gp_hedge".

    The package's defaults, except that the first design is no longer than the budget. The same samples give the same
    angles.
    """

    name = "scikit-optimize"
    package = "skopt"

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


class BoTorch(OptimiserPolicy):
    """Gaussian process with inferred noise (`SingleTaskGP`) and log noisy expected improvement.

    BoTorch's parts with their defaults: inputs scaled to 0–1, outputs standardised, hyperparameters by the marginal
    likelihood, `qLogNoisyExpectedImprovement` maximised by `optimize_acqf`. The same samples give the same angles.
    """

    name = "botorch"
    package = "botorch"

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
