"""Delay of the laser's stamps and backlash of the stage, from sweeps there and back over one marker.

Each way has a curve whose centre is, by the stage's readings, at

    c = θ − v·d + sign(v)·a·b,                                                                                 (1)

with the marker at θ, the light d after its stamp, and the backlash b, both beyond what the rig states. a is 1 for ways
against the direction of approach, in which the probe lags, and 0 for the others. Two speeds tell the delay from the
backlash.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from msgspec.structs import replace

from markerseek.core import (
    AcquisitionError,
    ConfigError,
    Estimate,
    Event,
    NotFound,
    RunPlan,
    Sample,
    Sweep,
    SweepTiming,
)
from markerseek.guard import FiringLimits
from markerseek.rigs import Rig
from markerseek.scan import run

SLOW = 0.2
SLOW_SHARE = 1 / 3
"""Speed of the slow sweeps over the fastest of the stage, and how many there are for each fast one: at a fifth of the
speed the delay shifts by little, and what is left of the difference is the backlash."""

LONGEST = 0.8
"""Longest sweep over the lifetime of its permit: a slow one is as fast as that needs."""

LEAST_SIGMA_S = 0.2e-3
"""Least standard deviation that is stated of a delay, in seconds: clocks are compared no better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredDelay:
    """Delay and backlash of a rig; standard deviations are of the scatter of the ways."""

    stamp_delay_s: float
    """Time from the stamp of a pulse to its light, in seconds."""
    stamp_delay_sigma_s: float
    """Standard deviation of it, in seconds."""
    backlash_deg: float
    """Backlash between encoder and probe, in degrees."""
    backlash_sigma_deg: float
    """Standard deviation of it, in degrees."""
    marker_deg: float
    """Angle of the marker, in degrees."""
    ways: int
    """Ways over the marker that were used."""


class ThereAndBack:
    """A `markerseek.core.SweepingPolicy` that sweeps over the range, there and back, and keeps the samples."""

    name = "delay"

    def __init__(self, sweeps: Sequence[Sweep]) -> None:
        self._left = list(sweeps)
        self.number = len(self._left)
        self.samples: list[Sample] = []

    def ask(self) -> Sweep | None:
        """Return the next sweep; None after the last."""
        return self._left[0] if self._left else None

    def tell(self, sample: Sample) -> None:
        """Keep a sample, without its frame."""
        self.samples.append(replace(sample, frame=None))

    def end_sweep(self) -> None:
        """Go on to the next sweep."""
        del self._left[0]

    def estimate(self) -> Estimate:
        """Nothing: the delay is asked for, and no angle."""
        return NotFound(mean_deg=0.0, reason="the delay of the stamps is measured, and no marker searched")


class DelayRun:
    """The measurement of a delay on a rig: iterate over `events`, then ask for `result`.

    Parameters
    ----------
    rig
        A rig that can sweep, armed, with one marker in its search range.
    times
        Fast sweeps there and back, 3 to 30; the more, the better the delay is known.

    Raises
    ------
    ConfigError
        If the rig cannot sweep, or ``times`` is out of its range.
    """

    def __init__(self, rig: Rig, *, times: int = 9) -> None:
        if not 3 <= times <= 30:
            raise ConfigError(f"times is {times}, it must be from 3 to 30; 9 is usual")
        self._rig = rig
        self._devices = rig.scanner.sweeping
        low_deg = rig.limits.search.low_deg
        high_deg = rig.limits.search.high_deg
        fast = self._devices.stage.fastest_sweep_deg_s
        slow = self._slow_deg_s(low_deg, high_deg)
        self._between_deg_s = (fast + slow) / 2
        speeds = [fast] * times + [slow] * round(SLOW_SHARE * times)
        if self._devices.in_bursts:
            each = [Sweep(from_deg=low_deg, to_deg=high_deg, back_deg=low_deg, speed_deg_s=speed) for speed in speeds]
        else:
            ends = ((low_deg, high_deg), (high_deg, low_deg))
            each = [Sweep(from_deg=at, to_deg=to, speed_deg_s=speed) for speed in speeds for at, to in ends]
        self._policy = ThereAndBack(each)
        stage = self._devices.stage
        self._stated_backlash_deg = max(stage.play_deg(sign) for sign in (1.0, -1.0))
        # Against the direction of approach, which is rising unless the stage says otherwise.
        rules = getattr(stage, "rules", None)
        self._lagging = 1.0 if getattr(rules, "approach_from", "below") == "above" else -1.0

    def _slow_deg_s(self, low_deg: float, high_deg: float) -> float:
        """Return the speed of the slow sweeps: as slow as the permit of one lives long enough."""
        devices = self._devices
        fast = self._devices.stage.fastest_sweep_deg_s
        longest_s = LONGEST * FiringLimits().lifetime_s
        back_deg = low_deg if devices.in_bursts else None
        for per_cent in range(round(100 * SLOW), 100, 2):
            sweep = Sweep(to_deg=high_deg, back_deg=back_deg, speed_deg_s=per_cent / 100 * fast)
            if devices.duration_s(sweep, from_deg=low_deg) <= longest_s:
                return sweep.speed_deg_s
        raise ConfigError(
            f"one sweep over {low_deg:g} to {high_deg:g} deg takes longer than a permit lives, {longest_s:g} s; narrow "
            "the search range about the marker, or raise speed_deg_s of the stage"
        )

    @property
    def sweeps(self) -> int:
        """Number of its sweeps."""
        return self._policy.number

    def events(self) -> Generator[Event, None, None]:
        """Sweep; closing it stops the stage and takes the light away. Raises as `markerseek.scan.run`."""
        yield from run(self._policy, self._rig.scanner, RunPlan(stay=True))

    def result(self) -> MeasuredDelay:
        """Return the delay and backlash by (1).

        Raises
        ------
        AcquisitionError
            If fewer than four ways show a marker with both flanks, or those of one direction or one speed alone.
        """
        from markerseek.search.posterior import with_light

        rows = []
        for _, group in groupby(with_light(self._policy.samples), key=_way):
            way = self._centre(list(group))
            if way is not None:
                rows.append(way)
        table = np.array(rows).reshape(-1, 4)
        speeds = table[:, 1]
        # Three of the four kinds of ways, there and back, fast and slow, tell marker, delay and backlash apart.
        kinds = {(speed > 0, abs(speed) > self._between_deg_s) for speed in speeds}
        if len(table) < 4 or len(kinds) < 3:
            raise AcquisitionError(
                f"{len(table)} ways show a marker with both of its flanks, at least 4 are needed, there and back and "
                "at both speeds; put one marker in mid-range, and raise the laser's energy"
            )
        design = np.stack([np.ones(len(table)), -speeds, np.sign(speeds) * table[:, 3]], axis=1)
        weight = 1 / table[:, 2]
        weighted = design * weight[:, None]
        centre = table[:, 0] * weight
        (marker_deg, delay_s, backlash_deg), *_ = np.linalg.lstsq(weighted, centre, rcond=None)
        rest = centre - weighted @ (marker_deg, delay_s, backlash_deg)
        # Of their scatter: what all curves share, their form, shifts none against another.
        variance = float(rest @ rest) / (len(table) - 3)
        _, delay_sigma_s, backlash_sigma_deg = np.sqrt(np.diag(variance * np.linalg.inv(weighted.T @ weighted)))
        return MeasuredDelay(
            stamp_delay_s=self._devices.laser.stamp_delay_s + float(delay_s),
            stamp_delay_sigma_s=max(float(delay_sigma_s), LEAST_SIGMA_S),
            backlash_deg=max(0.0, self._stated_backlash_deg + float(backlash_deg)),
            backlash_sigma_deg=float(backlash_sigma_deg),
            marker_deg=float(marker_deg),
            ways=len(table),
        )

    def _centre(self, swept: Sequence[Sample]) -> tuple[float, float, float, float] | None:
        """Return the centre in degrees, speed there, standard deviation, and 1 if that way has backlash."""
        from markerseek.search.posterior import Posterior, centre_by, way_of

        way = way_of(swept, lambda samples: centre_by(Posterior(limits=self._rig.limits.search, others=0.0), samples))
        if way is None or not way.whole:
            return None
        # The first pulses of a way back come at rest.
        sign = math.copysign(1.0, statistics.median(_timing(each).speed_deg_s for each in swept))
        return way.centre_deg, sign * way.speed_deg_s, way.sigma_deg, float(sign == self._lagging)


def _timing(sample: Sample) -> SweepTiming:
    if sample.sweep is None:
        raise ValueError("the sample is of no sweep")
    return sample.sweep


def _way(sample: Sample) -> tuple[int, bool]:
    """Return which way a sample is of: its sweep, and the direction."""
    return _timing(sample).number, _timing(sample).speed_deg_s > 0
