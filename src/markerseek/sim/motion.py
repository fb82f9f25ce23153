"""Motion of simulated tissue: breathing with a pause at the end of exhalation, the heartbeat, and drift.

The displacement counts from where the tissue is in the pause, on the first second of the rig's clock. That place is the
truth of a simulation: a ventilator can hold the tissue there, and an image taken before the operation shows it there.
Breathing is the usual model of the field (Lujan et al., Med. Phys. 26, 715, 1999),

    d(t) = 2A·cos²ⁿ(π(t/T + φ)),                                                                              (1)

of amplitude A, period T and phase φ: 0 at the end of exhalation, 2A at the end of inhalation. The larger n, the longer
the pause.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from msgspec import structs

from markerseek.acoustics import Absorber
from markerseek.core import ConfigError, Float64, Within, require_fields


class TissueMotion(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How simulated tissue moves, all of it by the same displacement; the defaults are tissue at rest."""

    breathing_mm: Annotated[float, Within(0, 30, "mm")] = 0.0
    """Amplitude A of breathing: half of the path from the end of exhalation to that of inhalation."""
    period_s: Annotated[float, Within(1, 60, "s", cure="3 to 5 s are usual")] = 4.0
    """Time T from breath to breath."""
    power: Annotated[int, Within(1, 10, cure="2 or 3 are usual")] = 2
    """n of the shape cos²ⁿ: 1 is a sine, and the larger it is, the longer the pause."""
    phase: Annotated[float | None, Within(0, 1)] = None
    """φ: share of a cycle that has gone by since an end of inhalation when the clock begins; None draws it."""
    direction: tuple[float, float, float] = (0.3, 0.8, 0.5)
    """Direction in which the tissue moves while breath is drawn in: x, y (along the axis of rotation) and z of the TRUS
    frame, of any length."""
    heart_mm: Annotated[float, Within(0, 5, "mm")] = 0.0
    """Amplitude of the motion by the heartbeat, a sine in the same direction."""
    heart_period_s: Annotated[float, Within(0.2, 5, "s")] = 0.9
    """Time from heartbeat to heartbeat."""
    drift_mm_per_min: Annotated[float, Within(-100, 100, "mm/min")] = 0.0
    """Speed of a drift in the same direction."""
    stated_mm: Annotated[float | None, Within(0, 30, "mm")] = None
    """Amplitude that the rig states of the tissue, as ``tissue.motion_mm`` of a rig of devices does; None: nothing."""

    def __post_init__(self) -> None:
        require_fields(self, "motion")
        if not 0 < math.hypot(*self.direction) < math.inf:
            raise ConfigError(
                f"motion: direction is {self.direction}, it must be three finite numbers that are not all 0"
            )

    @property
    def moves(self) -> bool:
        """Whether the tissue moves at all."""
        return max(self.breathing_mm, self.heart_mm, abs(self.drift_mm_per_min)) > 0

    def drawn(self, rng: np.random.Generator) -> TissueMotion:
        """Return the motion with a phase, drawn where it is left open.

        Nothing is drawn for tissue at rest, and what ``rng`` draws later does not depend on the phase.
        """
        if self.phase is not None or not self.moves:
            return self
        return structs.replace(self, phase=float(rng.spawn(1)[0].random()))

    def way_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, " times"]:
        """Return the displacement along the motion by (1), with heartbeat and drift, at times of the rig's clock."""
        breath = np.cos(np.pi * (at_s / self.period_s + (self.phase or 0.0))) ** (2 * self.power)
        heart = np.sin(2 * np.pi * at_s / self.heart_period_s)
        way_mm = 2 * self.breathing_mm * breath + self.heart_mm * heart + self.drift_mm_per_min * at_s / 60
        return np.asarray(1e-3 * way_mm)

    def displacement_m(self, at_s: Float64[np.ndarray, " times"]) -> Float64[np.ndarray, "times 3"]:
        """Return the displacement in the TRUS frame from the place in the pause, at times of the rig's clock."""
        direction = np.array(self.direction) / math.hypot(*self.direction)
        return np.asarray(self.way_m(at_s)[:, None] * direction)


def displaced(absorber: Absorber, by_m: Float64[np.ndarray, " 3"]) -> Absorber:
    """Return an absorber that has moved by a displacement in the TRUS frame."""
    x_m, y_m, z_m = (at + by for at, by in zip(absorber.position_m, by_m.tolist(), strict=True))
    return Absorber.at(x_m=x_m, y_m=y_m, z_m=z_m, strength=absorber.strength, source=absorber.source)


BLURRED_M = 50e-6
"""Way of the tissue during the pulses of one acquisition from which their frame is blurred: below, one moment stands
for all."""

_MOMENTS = 4, 16
"""Least and largest number of moments at which the frame of such an acquisition is computed."""


def moments_s(motion: TissueMotion, *, first_s: float, pulses: int, period_s: float) -> Float64[np.ndarray, " moments"]:
    """Return the moments that stand for the pulses of one acquisition: their middle, or several where tissue moves.

    ``first_s``: time of the first pulse. ``period_s``: time from pulse to pulse.
    """
    lasts_s = (pulses - 1) * period_s
    way_m = float(np.ptp(motion.way_m(first_s + np.linspace(0.0, lasts_s, 33))))
    if way_m <= BLURRED_M:
        return np.array([first_s + lasts_s / 2])
    least, most = _MOMENTS
    count = min(max(least, math.ceil(way_m / BLURRED_M)), most, pulses)
    return np.asarray(first_s + lasts_s * (np.arange(count) + 0.5) / count)
