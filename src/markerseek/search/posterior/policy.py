"""The policy: ask, tell, and answers that name what they know."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
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
    Found,
    Interval,
    NotFound,
    SearchError,
    Unsure,
)
from markerseek.core.reading import Sample
from markerseek.search.curve import check_acquisitions, check_sample
from markerseek.search.evidence import UNKNOWN_RATIO, missing_evidence
from markerseek.search.floor import Noise, noise_of
from markerseek.search.guarded import SIGMA_LIMIT_DEG
from markerseek.search.posterior.belief import Belief
from markerseek.search.posterior.choice import PLANNED_ANGLES, most_audible_deg, most_telling_deg, planned_deg
from markerseek.search.posterior.gathering import Evidence
from markerseek.search.posterior.modes import modes_deg, rival_deg
from markerseek.search.posterior.reach import hiding_deg
from markerseek.search.posterior.reasons import doubt, missed
from markerseek.search.posterior.shapes import Shapes, family
from markerseek.search.posterior.warm import load_kernels

CUES = frozenset({"intensity", "arrival", "lateral"})
"""What of a reading may count."""

TARGET_SIGMA_DEG = 0.1
"""Standard deviation at which a search ends where nothing else is said, in degrees."""

LEAST_ACQUISITIONS = 4
"""Acquisitions before which a search does not end for being sure."""

UNRESOLVED_BEYOND = 0.1
"""Probability of lying beyond an end from which an angle that is not known is said to be at that end."""

PARTICLES, SCOUTS = 48, 4000
"""Markers that are drawn from the posterior to choose the next angle, and while nothing was heard."""

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
    belief: Belief
    hiding_deg: float | None


class Posterior:
    """Searches by a posterior over the marker's angle.

    Parameters
    ----------
    limits
        Range to search.
    acquisitions
        Most acquisitions.
    target_sigma_deg
        The search ends once the middle of the curve is known to this standard deviation, in degrees, and the marker is
        found; 0: only with the last acquisition.
    start_deg
        Where the probe stands, in degrees; the search begins at the nearer end. None: at the low end.
    cues
        Which of `CUES` count: "intensity", "arrival", "lateral" (where the peak lies along the array).

    Raises
    ------
    ConfigError
        If an argument cannot be used.
    """

    def __init__(
        self,
        *,
        limits: Interval = PAPER_RANGE,
        acquisitions: int = 16,
        target_sigma_deg: float = TARGET_SIGMA_DEG,
        start_deg: float | None = None,
        cues: Iterable[str] = CUES,
    ) -> None:
        check_acquisitions(acquisitions, least=2, method="posterior")
        if not 0 <= target_sigma_deg < math.inf:
            raise ConfigError(
                f"posterior: target_sigma_deg is {target_sigma_deg} deg, it must be finite and not negative; "
                "0 uses every acquisition"
            )
        if start_deg is not None and not math.isfinite(start_deg):
            raise ConfigError(f"posterior: start_deg is {start_deg} deg, it must be finite")
        chosen = frozenset(cues)
        if not chosen or not chosen <= CUES:
            raise ConfigError(f"posterior: cues are {sorted(chosen)}, choose at least one of {sorted(CUES)}")
        load_kernels(_family(), cues=CUES, floor=FLOOR_SNR)
        self._limits = limits
        self._budget = acquisitions
        self._target_deg = target_sigma_deg
        self._falling = start_deg is not None and start_deg > limits.centre_deg
        self._evidence = Evidence(limits=limits, shapes=_family(), cues=chosen)
        self._lit: list[Sample] = []
        self._dark: list[Sample] = []
        self._known: _State | None = None
        self._next: tuple[float | None] | None = None

    def ask(self) -> float | None:
        """Next angle in degrees; None once the budget is spent or the angle is known well enough."""
        if self._next is None:
            self._next = (self._decide(),)
        return self._next[0]

    def tell(self, sample: Sample) -> None:
        """Take in one sample: a dark one for the noise floor, a lit one for the posterior.

        Raises
        ------
        SearchError
            If the sample is not usable (`check_sample`), or is lit and the search is over.
        """
        check_sample(sample)
        if sample.dark:
            self._dark.append(sample)
            self._known = self._next = None
            return
        if self.ask() is None:
            raise SearchError(f"posterior: it is over after {len(self._lit)} acquisitions; begin a new search")
        self._lit.append(sample)
        self._known = self._next = None

    def estimate(self) -> Estimate:
        """Answer as far as the samples prove it; `NotFound` before the first."""
        if not self._lit:
            return NotFound(mean_deg=self._limits.centre_deg, reason="nothing has been measured yet")
        state = self._state()
        belief, floor = state.belief, state.noise.floor
        mean_deg = min(max(belief.mean_deg, self._limits.low_deg), self._limits.high_deg)
        if state.missing is not None:
            return NotFound(
                mean_deg=mean_deg, reason=state.missing + missed(self._lit, state.noise, self._limits), floor=floor
            )
        side = self._side(belief)
        if side is not None:
            return AtBound(mean_deg=mean_deg, side=side, floor=floor)
        modes = modes_deg(belief, limits=self._limits)
        rival = rival_deg(self._lit, level=floor.level or 0.0, marker_m=belief.marker_m)
        if rival is not None:
            modes = (mean_deg, rival)
        if len(modes) > 1:
            return Ambiguous(mean_deg=modes[0], modes_deg=modes, floor=floor)
        interval = Interval(low_deg=belief.quantile_deg(0.025), high_deg=belief.quantile_deg(0.975))
        if belief.sigma_deg <= SIGMA_LIMIT_DEG and state.hiding_deg is None:
            return Found(
                mean_deg=mean_deg,
                sigma_deg=belief.sigma_deg,
                interval95_deg=interval,
                interval_kind="posterior",
                floor=floor,
            )
        return Unsure(
            mean_deg=mean_deg,
            sigma_deg=belief.sigma_deg,
            interval95_deg=interval,
            interval_kind="posterior",
            reason=doubt(belief, state.hiding_deg),
            floor=floor,
        )

    def _state(self) -> _State:
        if self._known is None:
            noise = noise_of(self._lit, dark=self._dark)
            missing = missing_evidence(self._lit, dark=self._dark, noise=noise)
            particles = PARTICLES if self._heard_anything() else SCOUTS
            belief = self._evidence.belief(self._lit, noise, particles=particles)
            self._known = _State(noise=noise, missing=missing, belief=belief, hiding_deg=self._hiding(belief, noise))
        return self._known

    def _hiding(self, belief: Belief, noise: Noise) -> float | None:
        """Where a much louder marker than the one known may be unheard; None while none is known, or no noise."""
        if noise.floor.level is None or noise.sigma is None or belief.sigma_deg > SIGMA_LIMIT_DEG:
            return None
        heard_deg = [sample.angle_deg for sample in self._lit]
        peak = noise.sigma * math.exp(float(np.mean(belief.log_snr)))
        return hiding_deg(heard_deg, self._limits, level=noise.floor.level, peak=peak, fwhm_deg=belief.fwhm_deg)

    def _decide(self) -> float | None:
        count = len(self._lit)
        if count >= self._budget:
            return None
        heard_deg = [sample.angle_deg for sample in self._lit]
        if not self._lit or not self._heard_anything():
            return self._unheard_deg(heard_deg)
        state = self._state()
        if count >= LEAST_ACQUISITIONS and self._knows_enough(state.belief):
            return None
        if state.hiding_deg is not None:
            return state.hiding_deg
        return most_telling_deg(state.belief, _family(), heard_deg, limits=self._limits, floor=FLOOR_SNR)

    def _unheard_deg(self, heard_deg: Sequence[float]) -> float:
        """Where to listen next while nothing was heard."""
        noise = noise_of(self._lit, dark=self._dark)
        if len(heard_deg) < PLANNED_ANGLES or noise.floor.level is None or not noise.sigma:
            return planned_deg(heard_deg, limits=self._limits, falling=self._falling)
        level = noise.floor.level / noise.sigma
        return most_audible_deg(self._state().belief, _family(), heard_deg, limits=self._limits, level=level)

    def _knows_enough(self, belief: Belief) -> bool:
        """Whether the marker is found to the target; or is not, and more samples could not help."""
        if belief.middle_sigma_deg > self._target_deg:
            return False
        answer = self.estimate()
        return isinstance(answer, Found) or (
            isinstance(answer, Unsure) and belief.middle_sigma_deg <= self._target_deg / 2
        )

    def _heard_anything(self) -> bool:
        """Whether a sample exceeds what noise reaches; where that is unknown, whether one stands out."""
        intensities = [sample.reading.intensity for sample in self._lit]
        level = noise_of(self._lit, dark=self._dark).floor.level
        if level is None:
            return len(intensities) > 1 and max(intensities) > UNKNOWN_RATIO / 3 * min(intensities)
        return max(intensities) > level

    def _side(self, belief: Belief) -> Literal["low", "high"] | None:
        """The end beyond which the marker lies: more likely than not, or perhaps, where its angle is not known."""
        least = 0.5 if belief.sigma_deg <= SIGMA_LIMIT_DEG else UNRESOLVED_BEYOND
        below = float(belief.share[belief.angle_deg < self._limits.low_deg].sum())
        above = float(belief.share[belief.angle_deg > self._limits.high_deg].sum())
        if max(below, above) <= least:
            return None
        return "low" if below > above else "high"
