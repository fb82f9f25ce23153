"""Error and lag of `Tracker` on a simulated marker that moves, against its speed and the rate of the frames."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import FrameHeader, require_range
from markerseek.runs import TrackQuality
from markerseek.search import Tracker
from markerseek.sim import SWING_DEG, TURN_S, CurveWorld, Flash, IntensityCurve, swing_deg

_HEADER = FrameHeader(sequence=0, token="", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0)

_MOMENT_S = 1e-6
_SETTLED_S = 2.0
"""Time after the start that does not count, in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """How well one marker was followed."""

    quality: TrackQuality
    lost: bool
    """Whether the tracker called the marker lost, or was off by more than half the width of the curve at the end."""
    covered: float
    """Share of the frames at which the truth was within 1.96 standard deviations of the angle."""


def track(
    curve: IntensityCurve,
    *,
    fwhm_deg: float,
    peak_snr_db: float,
    speed_deg_s: float,
    period_s: float,
    duration_s: float,
    rng: np.random.Generator,
) -> Track:
    """Follow one simulated marker; the probe is at the angle asked for when each frame is taken.

    ``curve``: True intensity curve, without noise. ``fwhm_deg``: its full width at half maximum, as the tracker knows
    it. ``peak_snr_db``: peak over noise. ``period_s``: time from one frame to the next. ``duration_s``: how long it is
    followed.
    """
    require_range("track: duration_s", duration_s, low=2 * _SETTLED_S, high=3600, unit="s")
    peak = 10 ** (peak_snr_db / 20)
    world = CurveWorld(
        curve=curve,
        marker_deg=0.0,
        peak=peak,
        noise_sigma=1.0,
        cells=1000,
        energy_jitter=0.03,
        start_deg=0.0,
        rng=rng,
    )
    start_s = float(rng.uniform(0, 2 * (SWING_DEG / speed_deg_s + TURN_S)))
    # It is told how fast the marker may be and may turn: with more than that it is lost sooner at a low rate.
    tracker = Tracker(
        angle_deg=swing_deg(start_s, speed_deg_s),
        sigma_deg=0.1,
        fwhm_deg=fwhm_deg,
        peak=peak,
        noise_sigma=1.0,
        most_speed_deg_s=1.5 * speed_deg_s,
        acceleration_deg_s2=2 * speed_deg_s / TURN_S,
    )
    errors, speeds, sigmas = [], [], []
    for number in range(1, math.ceil(duration_s / period_s) + 1):
        now_s = start_s + number * period_s
        truth_deg = swing_deg(now_s, speed_deg_s)
        probe_deg = tracker.ask(period_s)
        # Only the angle between probe and marker counts: the world's own marker stays at 0.
        world.angle_deg = probe_deg - truth_deg
        frame = world.frame(Flash(at_s=now_s, pulses=1, energy=1 + 0.03 * rng.standard_normal()), header=_HEADER)
        tracker.tell(probe_deg, frame.intensity, after_s=period_s)
        if number * period_s >= _SETTLED_S:
            errors.append(tracker.mean_deg - truth_deg)
            sigmas.append(tracker.sigma_deg)
            speeds.append((swing_deg(now_s + _MOMENT_S, speed_deg_s) - truth_deg) / _MOMENT_S)
    return Track(
        quality=TrackQuality.of(errors, speeds),
        lost=tracker.lost or abs(errors[-1]) > fwhm_deg / 2,
        covered=float(np.mean(np.abs(errors) <= 1.96 * np.array(sigmas))),
    )
