"""The spline through the moments of arrival is SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from markerseek.search.posterior.arrival import _bending, _spline


@pytest.mark.parametrize("knots", [2, 3, 4, 5, 71])
def test_the_spline_is_scipys_beyond_its_ends_too(knots: int) -> None:
    values = np.random.default_rng(knots).normal(size=knots)
    at = np.linspace(-4.0, 12.0, 1001)
    spline = _spline(-3.0, 14.0 / (knots - 1), values, _bending(knots) @ values, at)
    assert spline == pytest.approx(CubicSpline(np.linspace(-3.0, 11.0, knots), values)(at), rel=1e-9, abs=1e-9)
