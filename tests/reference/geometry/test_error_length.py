"""The length of an error vector, against SciPy's noncentral chi squared and against vectors that are drawn."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import ncx2

from markerseek.geometry import ErrorLength

ONE = np.ones(1)


@pytest.mark.parametrize("off_m", [0.0, 0.5e-3, 3e-3])
def test_with_equal_variances_it_is_the_noncentral_chi_squared_distribution(off_m: float) -> None:
    sigma_m = 1e-3
    mean_m = off_m * np.array([0.6, 0.0, 0.8])
    length = ErrorLength.of(ONE, sigma_m**2 * np.eye(3)[None], mean_m=mean_m)
    exact = ncx2(3, (off_m / sigma_m) ** 2) if off_m else ncx2(3, 1e-12)
    assert length.rms_m == pytest.approx(np.sqrt(3 * sigma_m**2 + off_m**2), rel=1e-12)
    # About another mean than zero the gamma distribution is an approximation.
    assert length.quantile_m(0.95) == pytest.approx(sigma_m * np.sqrt(exact.ppf(0.95)), rel=0.01 if off_m else 1e-9)
    for share in (0.5, 0.05, 1e-3):
        there_m = sigma_m * np.sqrt(exact.isf(share))
        assert length.exceeded(there_m) == pytest.approx(share, rel=(0.1 if share > 0.01 else 0.8) if off_m else 1e-6)


def test_of_a_mixture_of_ellipsoids_the_share_below_a_quantile_is_what_drawn_vectors_show() -> None:
    rng = np.random.default_rng(1)
    weights = np.array([0.7, 0.3])
    roots = rng.standard_normal((2, 3, 3)) * np.array([0.4e-3, 1.2e-3])[:, None, None]
    mean_m = np.array([0.3e-3, -0.2e-3, 0.5e-3])
    length = ErrorLength.of(weights, roots @ np.swapaxes(roots, 1, 2), mean_m=mean_m)
    parts = rng.choice(2, size=200_000, p=weights)
    drawn_m = np.linalg.norm(mean_m + np.einsum("nij,nj->ni", roots[parts], rng.standard_normal((200_000, 3))), axis=1)
    assert length.rms_m == pytest.approx(np.sqrt(np.mean(drawn_m**2)), rel=0.01)
    for share in (0.5, 0.95):
        assert np.mean(drawn_m <= length.quantile_m(share)) == pytest.approx(share, abs=0.03)
        assert length.exceeded(length.quantile_m(share)) == pytest.approx(1 - share, abs=1e-4)


def test_an_error_that_cannot_be_has_no_length() -> None:
    length = ErrorLength.of(ONE, np.zeros((1, 3, 3)))
    assert (length.rms_m, length.quantile_m(0.95)) == (0.0, 0.0)
