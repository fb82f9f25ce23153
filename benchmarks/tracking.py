"""Error and lag of the trackers on a simulated marker that moves: at a rate of frames, and by sweeps of a rig."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import Found, FrameHeader, Interval, MarkerCurve, SearchError, Swept, require_range
from markerseek.rigs import rig_in_world
from markerseek.runs import TrackQuality, quality_of, swept_tracking_policy, track_run
from markerseek.search import Tracker, flank_deg
from markerseek.signals import IntensityReader
from markerseek.sim import (
    SWING_DEG,
    TURN_S,
    CurveWorld,
    Flash,
    IntensityCurve,
    MovingWorld,
    OscillatingMotion,
    SimulatedSettings,
    VirtualClock,
    swing_deg,
)

_HEADER = FrameHeader(sequence=0, token="", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0)

_MOMENT_S = 1e-6
CURVE_ERROR = 0.05
"""Relative standard deviation by which the height and the width that a search states are off."""

_CELLS = 1000
"""Cells of noise in an image."""

PLACE_CELLS = 300
"""Cells of noise at the marker's place in an image, where it is looked up."""

_SETTLED_S = 2.0
"""Time after the start that does not count, in seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Track:
    """How well one marker was followed."""

    quality: TrackQuality
    lost: bool
    """Whether the tracker called the marker lost, or was off by more than half the width of the curve at the end."""


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
        cells=_CELLS,
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
        # Not the world's own draws.
        rng=rng.spawn(1)[0],
        most_speed_deg_s=1.5 * speed_deg_s,
        acceleration_deg_s2=2 * speed_deg_s / TURN_S,
    )
    errors, speeds, sigmas = [], [], []
    for number in range(1, math.ceil(duration_s / period_s) + 1):
        now_s = start_s + number * period_s
        truth_deg = swing_deg(now_s, speed_deg_s)
        probe_deg = flank_deg(tracker, after_s=period_s, side=1.0 if number % 2 else -1.0)
        # Only the angle between probe and marker counts: the world's own marker stays at 0.
        world.angle_deg = probe_deg - truth_deg
        frame = world.frame(Flash(at_s=now_s, pulses=1, energy=1 + 0.03 * rng.standard_normal()), header=_HEADER)
        tracker.tell(probe_deg, frame.intensity, after_s=period_s, noise_sigma=1.0, cells=_CELLS)
        if number * period_s >= _SETTLED_S:
            errors.append(tracker.mean_deg - truth_deg)
            sigmas.append(tracker.sigma_deg)
            speeds.append((swing_deg(now_s + _MOMENT_S, speed_deg_s) - truth_deg) / _MOMENT_S)
    return Track(
        quality=TrackQuality.of(errors, speeds, sigmas),
        lost=tracker.lost or abs(errors[-1]) > fwhm_deg / 2,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptTrack:
    """How well one marker was followed by sweeps."""

    quality: TrackQuality
    """Of all frames."""
    settled: TrackQuality
    """Of those from 2 s after the first on."""
    frames: int
    sweeps: int
    searched_again: int
    """How often it was lost, and searched for."""
    lost: bool
    """Whether it was lost at any time, or the angle was off by more than half the width of the curve at the end."""
    lost_settled: bool
    """The same from 2 s after the first frame on."""


def track_by_sweeps(
    curve: IntensityCurve,
    *,
    fwhm_deg: float,
    settings: SimulatedSettings,
    motion: OscillatingMotion,
    duration_s: float,
    seed: int,
) -> SweptTrack:
    """Follow one simulated marker by sweeps, on a rig whose frames are intensities.

    Stage, play, laser, stamps, receiver and guard are those of a rig with images. All frames count.

    ``curve``: true intensity curve, without noise. ``fwhm_deg``: its full width at half maximum, which the tracker
    knows to `CURVE_ERROR`, as the height. ``settings``: of the rig. ``motion``: of the marker; the tracker knows its
    speed. ``duration_s``: how long it is followed.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    world = CurveWorld.of_settings(settings, curve=curve, marker_deg=0.0, cells=PLACE_CELLS, rng=rng)
    rig = rig_in_world(
        MovingWorld(world, motion),
        settings,
        clock=VirtualClock(),
        reader=IntensityReader(),
        description="",
        truth_deg=0.0,
        seed=seed,
        rng=rng,
    )
    confirmation = rig.scanner.measure(0.0)
    height, width = np.exp(CURVE_ERROR * rng.standard_normal(2)).tolist()
    found = Found(
        mean_deg=0.1 * float(rng.standard_normal()),
        sigma_deg=0.1,
        interval95_deg=Interval(low_deg=-0.2, high_deg=0.2),
        interval_kind="posterior",
        curve=MarkerCurve(fwhm_deg=fwhm_deg * width, peak=10 ** (settings.noise.peak_snr_db / 20) * height),
    )
    policy = swept_tracking_policy(rig, found, confirmation, speed_deg_s=motion.speed_deg_s, duration_s=duration_s)
    sweeps = sum(isinstance(event, Swept) for event in track_run(rig, policy, motion))
    quality = quality_of(policy, motion, rest_deg=0.0)
    settled = quality_of(policy, motion, rest_deg=0.0, without_s=_SETTLED_S)
    if quality is None or settled is None:
        raise SearchError(f"track: no frame was taken after {_SETTLED_S:g} s; follow the marker for longer")
    last = policy.track[-1]
    ends_lost = abs(last.angle_deg - motion.moved_deg(last.time_s)) > fwhm_deg / 2
    wide_s = [each.time_s - policy.track[0].time_s for each in policy.track if each.sigma_deg > fwhm_deg / 2]
    return SweptTrack(
        quality=quality,
        settled=settled,
        frames=len(policy.track),
        sweeps=sweeps,
        searched_again=policy.searched_again,
        lost=policy.searched_again > 0 or ends_lost,
        lost_settled=ends_lost or any(each >= _SETTLED_S for each in wide_s),
    )
