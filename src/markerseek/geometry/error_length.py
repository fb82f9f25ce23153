"""Length of an error that is a mixture of Gaussian vectors: its root mean square, its quantiles, how rare a length is.

The square of a Gaussian vector's length is a sum of chi squares; its distribution is taken for the gamma distribution
with the same mean and variance (Satterthwaite). That is exact for equal variances about a mean of zero, and for one
direction only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammainc, gammaincc, gammaincinv

from markerseek.core import Float64


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorLength:
    """Distribution of the length of an error vector."""

    weights: Float64[np.ndarray, " parts"]
    """Probability of each part of the mixture; the sum is 1."""
    means_m2: Float64[np.ndarray, " parts"]
    """Mean of the squared length in each part."""
    half_variances_m4: Float64[np.ndarray, " parts"]
    """Half the variance of the squared length in each part."""

    @classmethod
    def of(
        cls,
        weights: Float64[np.ndarray, " parts"],
        covariances_m2: Float64[np.ndarray, "parts n n"],
        *,
        mean_m: Float64[np.ndarray, " n"] | None = None,
    ) -> ErrorLength:
        """Return the distribution for parts with these covariances and one mean; None: a mean of zero.

        For a Gaussian vector of mean m and covariance C the mean of its squared length is m·m + tr C, and the variance
        2 tr C² + 4 m·C m.
        """
        means_m2 = np.trace(covariances_m2, axis1=1, axis2=2)
        half_variances_m4 = np.sum(covariances_m2**2, axis=(1, 2))
        if mean_m is not None:
            means_m2 = means_m2 + mean_m @ mean_m
            half_variances_m4 = half_variances_m4 + 2 * np.einsum("i,kij,j->k", mean_m, covariances_m2, mean_m)
        return cls(weights=weights, means_m2=means_m2, half_variances_m4=half_variances_m4)

    @property
    def rms_m(self) -> float:
        """Root mean square."""
        return math.sqrt(float(self.weights @ self.means_m2))

    def quantile_m(self, share: float) -> float:
        """Return the length that this share of the errors does not exceed."""
        if not self.means_m2.any():
            return 0.0
        shapes, scales = self._gammas
        quantiles = scales * gammaincinv(shapes, share)
        if np.ptp(quantiles) <= 1e-9 * quantiles.max():
            return math.sqrt(float(quantiles[0]))
        square_m2 = brentq(
            lambda square: float(self.weights @ gammainc(shapes, square / scales)) - share,
            quantiles.min(),
            quantiles.max(),
            xtol=1e-6 * quantiles.max(),
        )
        return math.sqrt(square_m2)

    def exceeded(self, length_m: float) -> float:
        """Return the share of the errors that are as long as this, or longer."""
        shapes, scales = self._gammas
        return float(self.weights @ gammaincc(shapes, length_m**2 / scales))

    @property
    def _gammas(self) -> tuple[Float64[np.ndarray, " parts"], Float64[np.ndarray, " parts"]]:
        """Shape and scale of the gamma distribution of the squared length, in each part."""
        # The mean is shape times scale, half the variance is shape times scale² / 2.
        shapes = self.means_m2**2 / self.half_variances_m4 / 2
        return shapes, self.means_m2 / shapes
