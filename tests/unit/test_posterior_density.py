"""The density of the posterior that a picture shows."""

from __future__ import annotations

import numpy as np
import pytest

from markerseek.rigs import simulated
from markerseek.search.posterior import Posterior


def test_the_density_integrates_to_one_and_has_the_mean_of_the_answer() -> None:
    policy = Posterior(acquisitions=8)
    assert policy.density() is None
    rig = simulated(seed=2, marker_deg=4.0)
    for angle_deg in (-12.0, 3.0, 5.0, 6.0):
        policy.tell(rig.scanner.measure(angle_deg))
        found = policy.density()
        assert found is not None
        angles, per_deg = found
        # The trapezoidal rule as the second opinion for the sum of the steps; the ends of the grid are negligible.
        assert np.trapezoid(per_deg, angles) == pytest.approx(1.0, abs=0.02)
    mean_deg = np.trapezoid(angles * per_deg, angles)
    assert mean_deg == pytest.approx(policy.estimate().mean_deg, abs=0.02)
