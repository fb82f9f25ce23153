"""The policy `Posterior`: asks for the next angle by the posterior, and answers what its samples prove."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from markerseek.core import (
    PAPER_RANGE,
    Ambiguous,
    AtBound,
    ConfigError,
    Estimate,
    Float64,
    Found,
    Interval,
    NotFound,
    Reading,
    Sample,
    Unsure,
)
from markerseek.search.evidence import UNKNOWN_RATIO, missing_evidence
from markerseek.search.floor import Noise, noise_of
from markerseek.search.guarded import SIGMA_LIMIT_DEG
from markerseek.search.policy import SearchPolicy, check_acquisitions, check_start
from markerseek.search.posterior.angle_posterior import AnglePosterior, modes_deg, rival_deg
from markerseek.search.posterior.detectability import missed_marker, undetected_deg
from markerseek.search.posterior.inference import Inference
from markerseek.search.posterior.next_angle import (
    PLANNED_ANGLES,
    most_detectable_deg,
    most_informative_deg,
    planned_deg,
)
from markerseek.search.posterior.shapes import Shapes, family

CUES = frozenset({"intensity", "arrival", "lateral"})
"""Parts of a reading that can be used."""

TARGET_SIGMA_DEG = 0.1
"""Standard deviation at which a search ends unless another is given, in degrees."""

LEAST_ACQUISITIONS = 4
"""Acquisitions before which a search does not end for a small standard deviation."""

UNRESOLVED_BEYOND = 0.1
"""Probability of lying beyond an end of the range from which an uncertain angle is answered as `AtBound`."""

PARTICLES, UNDETECTED_PARTICLES = 48, 4000
"""Markers that are drawn from the posterior to choose the next angle: once one is detected, and before."""

FLOOR_SNR = 4.2
"""Largest of some ten thousand Rayleigh cells over σ, as it usually comes out."""


@lru_cache(maxsize=1)
def _family() -> Shapes:
    return family()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _State:
    """All that follows from the samples so far."""

    noise: Noise
    missing: str | None
    posterior: AnglePosterior
    undetected_deg: float | None


class Posterior(SearchPolicy):
    """Searches by a posterior over the marker's angle.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    target_sigma_deg
        The search ends once the centre of the curve is known to this standard deviation, in degrees, and the marker is
        found; 0: only with the last acquisition.
    start_deg
        Present angle of the probe, in degrees; the search begins at the nearer end. None: at the low end.
    cues
        Which of `CUES` are used: "intensity", "arrival", "lateral" (position of the peak along the array).

    Raises
    ------
    ConfigError
        If an argument cannot be used.
    """

    name = "posterior"

    def __init__(
        self,
        *,
        limits: Interval = PAPER_RANGE,
        acquisitions: int = 16,
        target_sigma_deg: float = TARGET_SIGMA_DEG,
        start_deg: float | None = None,
        cues: Iterable[str] = CUES,
    ) -> None:
        super().__init__()
        check_acquisitions(acquisitions, least=2, method=self.name)
        if not 0 <= target_sigma_deg < math.inf:
            raise ConfigError(
                f"posterior: target_sigma_deg is {target_sigma_deg} deg, it must be finite and not negative; "
                "0 uses every acquisition"
            )
        check_start(start_deg, method=self.name)
        chosen = frozenset(cues)
        if not chosen or not chosen <= CUES:
            raise ConfigError(f"posterior: cues are {sorted(chosen)}, choose at least one of {sorted(CUES)}")
        _load_kernels()
        self._limits = limits
        self._budget = acquisitions
        self._target_deg = target_sigma_deg
        self._descending = start_deg is not None and start_deg > limits.centre_deg
        self._inference = Inference(limits=limits, shapes=_family(), cues=chosen)
        self._cached_noise: Noise | None = None
        self._cached: _State | None = None

    def tell(self, sample: Sample) -> None:
        """Take one sample: a dark one for the noise floor, one with the laser on for the posterior.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`), or the laser was on and the search is over.
        """
        super().tell(sample)
        self._cached_noise = self._cached = None

    def estimate(self) -> Estimate:
        """Answer as far as the samples prove it; `NotFound` before the first."""
        if not self._lit:
            return NotFound(mean_deg=self._limits.centre_deg, reason="nothing has been measured yet")
        state = self._state()
        posterior, floor = state.posterior, state.noise.floor
        mean_deg = min(max(posterior.mean_deg, self._limits.low_deg), self._limits.high_deg)
        if state.missing is not None:
            reason = state.missing + missed_marker(self._lit, state.noise, self._limits)
            return NotFound(mean_deg=mean_deg, reason=reason, floor=floor)
        side = self._side(posterior)
        if side is not None:
            return AtBound(mean_deg=mean_deg, side=side, floor=floor)
        modes = modes_deg(posterior, limits=self._limits)
        rival = rival_deg(self._lit, level=floor.level or 0.0, marker_m=posterior.marker_m)
        # A rival has its own angle: the posterior, of one marker, knows only the stronger one.
        if rival is not None:
            modes = (mean_deg, rival)
        if len(modes) > 1:
            return Ambiguous(mean_deg=modes[0], modes_deg=modes, floor=floor)
        interval = Interval(low_deg=posterior.quantile_deg(0.025), high_deg=posterior.quantile_deg(0.975))
        if posterior.sigma_deg <= SIGMA_LIMIT_DEG and state.undetected_deg is None:
            return Found(
                mean_deg=mean_deg,
                sigma_deg=posterior.sigma_deg,
                interval95_deg=interval,
                interval_kind="posterior",
                floor=floor,
            )
        return Unsure(
            mean_deg=mean_deg,
            sigma_deg=posterior.sigma_deg,
            interval95_deg=interval,
            interval_kind="posterior",
            reason=_why_unsure(posterior, state.undetected_deg),
            floor=floor,
        )

    def density(self) -> tuple[Float64[np.ndarray, " angles"], Float64[np.ndarray, " angles"]] | None:
        """Probability density of the angle as `AnglePosterior.density`; None before the first sample."""
        return self._state().posterior.density() if self._lit else None

    def _noise(self) -> Noise:
        if self._cached_noise is None:
            self._cached_noise = noise_of(self._lit, dark=self._dark)
        return self._cached_noise

    def _state(self) -> _State:
        if self._cached is None:
            noise = self._noise()
            missing = missing_evidence(self._lit, dark=self._dark, noise=noise)
            particles = PARTICLES if self._detected() else UNDETECTED_PARTICLES
            posterior = self._inference.posterior(self._lit, noise, particles=particles)
            self._cached = _State(
                noise=noise,
                missing=missing,
                posterior=posterior,
                undetected_deg=self._undetected_deg(posterior, noise),
            )
        return self._cached

    def _undetected_deg(self, posterior: AnglePosterior, noise: Noise) -> float | None:
        """Where a much stronger marker than the known one may be missed; None while none is known, or no noise."""
        if noise.floor.level is None or noise.sigma is None or posterior.sigma_deg > SIGMA_LIMIT_DEG:
            return None
        peak = noise.sigma * math.exp(float(np.mean(posterior.log_snr)))
        return undetected_deg(
            self._measured_deg(), self._limits, level=noise.floor.level, peak=peak, fwhm_deg=posterior.fwhm_deg
        )

    def _next_deg(self) -> float | None:
        count = len(self._lit)
        if count >= self._budget:
            return None
        if not self._lit or not self._detected():
            return self._detection_deg()
        state = self._state()
        if count >= LEAST_ACQUISITIONS and self._knows_enough(state.posterior):
            return None
        # Clutter found first must not end the search beside a stronger marker.
        if state.undetected_deg is not None:
            return state.undetected_deg
        return most_informative_deg(
            state.posterior, _family(), self._measured_deg(), limits=self._limits, floor=FLOOR_SNR
        )

    def _detection_deg(self) -> float:
        """Next angle while nothing is detected, in degrees."""
        measured_deg = self._measured_deg()
        noise = self._noise()
        if len(measured_deg) < PLANNED_ANGLES or noise.floor.level is None or not noise.sigma:
            return planned_deg(measured_deg, limits=self._limits, descending=self._descending)
        level = noise.floor.level / noise.sigma
        return most_detectable_deg(self._state().posterior, _family(), measured_deg, limits=self._limits, level=level)

    def _measured_deg(self) -> list[float]:
        return [sample.angle_deg for sample in self._lit]

    def _knows_enough(self, posterior: AnglePosterior) -> bool:
        """Whether the marker is found to the target; or is not, and more samples could not help."""
        if posterior.centre_sigma_deg > self._target_deg:
            return False
        answer = self.estimate()
        return isinstance(answer, Found) or (
            isinstance(answer, Unsure) and posterior.centre_sigma_deg <= self._target_deg / 2
        )

    def _detected(self) -> bool:
        """Whether a sample exceeds the noise floor; where that is unknown, whether one stands out."""
        intensities = [sample.reading.intensity for sample in self._lit]
        level = self._noise().floor.level
        if level is None:
            return len(intensities) > 1 and max(intensities) > UNKNOWN_RATIO / 3 * min(intensities)
        return max(intensities) > level

    def _side(self, posterior: AnglePosterior) -> Literal["low", "high"] | None:
        """The end of the range beyond which the marker probably lies, or may lie where its angle is uncertain."""
        least = 0.5 if posterior.sigma_deg <= SIGMA_LIMIT_DEG else UNRESOLVED_BEYOND
        below = float(posterior.share[posterior.angle_deg < self._limits.low_deg].sum())
        above = float(posterior.share[posterior.angle_deg > self._limits.high_deg].sum())
        if max(below, above) <= least:
            return None
        return "low" if below > above else "high"


def _why_unsure(posterior: AnglePosterior, undetected_deg: float | None) -> str:
    """Why a marker that was detected is not found; a stronger one may be missed at ``undetected_deg``."""
    if posterior.sigma_deg <= SIGMA_LIMIT_DEG:
        return (
            "the detected source is weak, and may be clutter of a stronger marker that was missed near "
            f"{undetected_deg:.0f} deg; take more acquisitions"
        )
    limit = f"the standard deviation, {posterior.sigma_deg:.2f} deg, is above {SIGMA_LIMIT_DEG:g} deg"
    if posterior.centre_sigma_deg <= SIGMA_LIMIT_DEG:
        return (
            f"{limit}: the centre of the curve is known to {posterior.centre_sigma_deg:.2f} deg, but the position and "
            "coherence of the peak change with the angle, so the source is not a point and may lie beside that centre"
        )
    return f"{limit}; take more acquisitions or average more pulses"


@lru_cache(maxsize=1)
def _load_kernels() -> None:
    """Decide once on three synthetic samples, so that no decision of a search waits for the compiled kernels."""
    # From disk they take a quarter of a second.
    lit = [
        Sample(
            angle_deg=angle_deg,
            reading=Reading(
                intensity=intensity,
                lateral_m=0.0,
                centroid_s=33e-6,
                spread_s=0.2e-6,
                noise_sigma=1.0,
                cells=10_000,
                coherence=0.9,
            ),
        )
        for angle_deg, intensity in ((-5.0, 20.0), (0.0, 60.0), (5.0, 20.0))
    ]
    inference = Inference(limits=PAPER_RANGE, shapes=_family(), cues=CUES)
    posterior = inference.posterior(lit, noise_of(lit), particles=8)
    measured_deg = [sample.angle_deg for sample in lit]
    most_informative_deg(posterior, _family(), measured_deg, limits=PAPER_RANGE, floor=FLOOR_SNR)
