"""Cramér and Rao's bound on the marker's angle, from intensities at chosen angles.

A sample at θ is normal with mean μ = A·S(t) + b, t = θ − θp, and variance v = σ² + (jμ)²: noise of the receiver and
jitter of the laser. (The peak of an envelope carries less information, because near the noise the largest peak is
somewhere else; the bound holds for it, too.) The nuisances beside θp (Van Trees, Detection, Estimation, and Modulation
Theory I, section 2.4) change μ by

    amplitude   ∂μ/∂ln A = A·S          width   ∂μ/∂ln F = −A·t·S'(t)
    tail        ∂μ/∂ε    = A·S·ln S, of S^(1+ε)        floor   ∂μ/∂b = 1

The information of one sample is ∇μ∇μᵀ/v + ∇v∇vᵀ/2v². A prior adds its own: 1/variance of each. The bound is the root of
the angle's element of the inverse.
"""

from __future__ import annotations

import math
from dataclasses import asdict, astuple, dataclass
from typing import Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np

from markerseek.core import ConfigError, Float64

Nuisance: TypeAlias = Literal["amplitude", "width", "tail", "floor"]
"""What may be unknown beside the angle."""

NUISANCES: tuple[Nuisance, ...] = ("amplitude", "width", "tail", "floor")
"""All nuisances, in the order of the information matrix behind the angle."""


_SINGULAR = 1e12
"""Condition number from which an information matrix counts as singular: the inverse has no correct digit left."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IntensityNoise:
    """Noise of the receiver and jitter of the laser."""

    snr: float
    """Amplitude A over σ, the noise of one quadrature: 100 is a peak SNR of 40 dB."""
    jitter: float = 0.0
    """Relative standard deviation j of the pulse energy from one acquisition to the next."""

    def __post_init__(self) -> None:
        if not 0 < self.snr < math.inf:
            raise ConfigError(f"intensity noise: snr is {self.snr}, it must be positive and finite")
        if not 0 <= self.jitter < 1:
            raise ConfigError(f"intensity noise: jitter is {self.jitter}, it is a share between 0 and 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """Standard deviations of the prior; infinite for no prior knowledge."""

    angle_deg: float = math.inf
    log_amplitude: float = math.inf
    log_width: float = math.inf
    """``log_amplitude`` and ``log_width``: of the natural logarithms of amplitude and width."""
    tail: float = math.inf
    """Of the exponent's relative change ε."""
    floor: float = math.inf
    """Of the floor, over σ."""

    def __post_init__(self) -> None:
        for name, deviation in asdict(self).items():
            if not deviation > 0:
                raise ConfigError(f"prior: {name} is {deviation}, a standard deviation is positive")

    def information(self) -> Float64[np.ndarray, "5 5"]:
        """Information of the prior."""
        return np.diag([deviation**-2 for deviation in astuple(self)])


TABLE_PRIOR = Prior(
    angle_deg=70 / math.sqrt(12),
    log_amplitude=math.log(100) / math.sqrt(12),
    log_width=math.log(17 / 3) / math.sqrt(12),
    tail=math.log(0.39 / 0.04) / math.sqrt(12) / -math.log(math.sqrt(0.39 * 0.04)),
    floor=5.0,
)
"""Spread of the physics table's ranges, each that of an even distribution: angles in ±35°, peak SNR from 20 to 60 dB,
widths from 3 to 17°. The tail's is that of ln S(10°) from 4 to 39 % of the peak, over its middle; the floor's the
height of the largest noise in an image."""


@runtime_checkable
class SlopedCurve(Protocol):
    """Noise-free intensity S over the angle t off the marker, 1 at t = 0."""

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""


class SampledCurve:
    """A symmetric curve through computed points of one side: monotone cubic interpolation (PCHIP).

    Beyond the last point the curve is constant.

    ``off_deg``: angles t from 0 upwards, rising. ``height``: S at these angles, positive.
    """

    def __init__(self, off_deg: Float64[np.ndarray, " points"], height: Float64[np.ndarray, " points"]) -> None:
        if off_deg.size < 3 or off_deg[0] != 0 or not np.all(np.diff(off_deg) > 0):
            raise ConfigError("sampled curve: off_deg must begin at 0 and rise, with at least three angles")
        if height.shape != off_deg.shape or not np.all((height > 0) & np.isfinite(height)):
            raise ConfigError("sampled curve: height must hold one positive finite number for each angle")
        # Imported here because it takes a third of a second, and searches do not need it.
        from scipy.interpolate import PchipInterpolator

        mirrored = np.concatenate([-off_deg[:0:-1], off_deg])
        self._last_deg = float(off_deg[-1])
        # Monotone pieces: a cubic spline would overshoot beside the peak, and the bound would use slopes that
        # the curve does not have.
        self._value = PchipInterpolator(mirrored, np.concatenate([height[:0:-1], height]) / height[0])
        self._slope = self._value.derivative()

    def value(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """S(t)."""
        return np.asarray(self._value(np.clip(off_deg, -self._last_deg, self._last_deg)))

    def slope(self, off_deg: Float64[np.ndarray, "*shape"]) -> Float64[np.ndarray, "*shape"]:
        """dS/dt in 1/degree."""
        inside = np.abs(off_deg) <= self._last_deg
        return np.asarray(np.where(inside, self._slope(np.clip(off_deg, -self._last_deg, self._last_deg)), 0.0))


def sample_information(
    curve: SlopedCurve, angle_deg: Float64[np.ndarray, " angles"], *, marker_deg: float, noise: IntensityNoise
) -> Float64[np.ndarray, "angles 5 5"]:
    """Return the information of one sample at each angle, on the angle in degrees and on `NUISANCES`."""
    off_deg = angle_deg - marker_deg
    snr = noise.snr
    height = curve.value(off_deg)
    slope = curve.slope(off_deg)
    # ∂μ/∂ε = A·S·ln S goes to 0 with S, where NumPy has 0·(−∞).
    with np.errstate(divide="ignore", invalid="ignore"):
        tail = np.where(height > 0, height * np.log(height), 0.0)
    mean_change = np.stack(
        [-snr * slope, snr * height, -snr * off_deg * slope, snr * tail, np.ones_like(height)], axis=-1
    )
    mean = snr * height
    variance = 1 + (noise.jitter * mean) ** 2
    variance_change = 2 * noise.jitter**2 * mean[..., None] * mean_change
    # Fisher information of a normal sample whose mean and variance both depend on the parameters.
    return np.asarray(
        np.einsum("...i,...j,...->...ij", mean_change, mean_change, 1 / variance)
        + np.einsum("...i,...j,...->...ij", variance_change, variance_change, 1 / (2 * variance**2))
    )


def angle_bound_deg(
    information: Float64[np.ndarray, "*batch 5 5"],
    *,
    unknown: tuple[Nuisance, ...] = NUISANCES,
    prior: Prior | None = None,
) -> Float64[np.ndarray, "*batch"]:
    """Return the least standard deviation of the angle that such information allows, in degrees.

    ``information``: sum over the samples taken (`sample_information`). ``prior``: prior (Van Trees' Bayesian bound);
    None: no prior, and the bound is infinite where the samples do not determine all unknowns.
    """
    total = information if prior is None else information + prior.information()
    kept = [0] + [1 + NUISANCES.index(name) for name in unknown]
    part = total[..., kept, :][..., kept]
    # Scaled to a unit diagonal, because the parameters have different units and the condition number depends on them.
    scale = np.sqrt(np.einsum("...ii->...i", part))
    known = scale > 0
    scale = np.where(known, scale, 1.0)
    relative = part / scale[..., :, None] / scale[..., None, :]
    relative = relative + np.einsum("...i,ij->...ij", (~known).astype(np.float64), np.eye(len(kept)))
    # `inv` raises on the first singular matrix of a batch; here such a matrix means an infinite bound.
    singular = np.linalg.cond(relative) > _SINGULAR
    safe = np.where(singular[..., None, None], np.eye(len(kept)), relative)
    variance = np.linalg.inv(safe)[..., 0, 0] / scale[..., 0] ** 2
    return np.asarray(np.where(singular | ~known[..., 0], math.inf, np.sqrt(np.abs(variance))))
