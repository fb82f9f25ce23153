"""Follows a marker that moves on a simulated rig, and says how well: error and lag against the truth."""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from markerseek.core import ConfigError, Event, Found, RunPlan, Sample, SearchError
from markerseek.rigs import Rig
from markerseek.scan import RunLimits, SweepingDevices, run
from markerseek.search import (
    FLANK_SHARE,
    SweptRig,
    SweptTrackingPolicy,
    Tracker,
    TrackingPolicy,
    require_room,
)
from markerseek.sim import TURN_S, OscillatingMotion, StageMotion

MAX_FRAMES = 20_000
"""Most frames of one track, or sweeps: more than a search may take; the guard's budget of pulses holds beside it."""

AnyTrackingPolicy: TypeAlias = TrackingPolicy | SweptTrackingPolicy
"""What follows a marker: from rest to rest, or while the probe turns."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackQuality:
    """How well a marker was followed."""

    rms_deg: float
    """Root mean square of the error."""
    within_1_deg: float
    """Share of the frames with an error of at most 1 degree."""
    lag_s: float
    """Time in seconds by which the tracker is behind: that of the line error = −lag · speed."""
    covered: float
    """Share of the frames in which the truth is within 1.96 standard deviations of the angle."""

    @classmethod
    def of(
        cls, errors_deg: Sequence[float], speeds_deg_s: Sequence[float], sigmas_deg: Sequence[float]
    ) -> TrackQuality:
        """Quality of a track.

        ``errors_deg``: estimate less truth at each frame; at least one. ``speeds_deg_s``: speed of the marker then.
        ``sigmas_deg``: standard deviations that the tracker stated.
        """
        errors, speeds = np.array(errors_deg), np.array(speeds_deg_s)
        return cls(
            rms_deg=float(np.sqrt(np.mean(errors**2))),
            within_1_deg=float(np.mean(np.abs(errors) <= 1)),
            # Least squares of error = −lag · speed.
            lag_s=-float(np.dot(errors, speeds) / np.dot(speeds, speeds)),
            covered=float(np.mean(np.abs(errors) <= 1.96 * np.array(sigmas_deg))),
        )


def stage_period_s(motion: StageMotion, *, fwhm_deg: float, speed_deg_s: float, frame_s: float) -> float:
    """Time from frame to frame of a stage that comes to rest at each flank, in seconds; infinite if it is too slow.

    ``fwhm_deg``: full width of the curve at half maximum, which sets how far apart the flanks are. ``frame_s``: time
    for pulses and readout.
    """
    if not motion.speed_deg_s > speed_deg_s:
        return math.inf
    period_s = frame_s
    # The way grows with the time that it takes: the fixed point, by iteration. Every second move is the longer one.
    for _ in range(50):
        way_deg = 2 * FLANK_SHARE * fwhm_deg + speed_deg_s * period_s
        period_s = frame_s + motion.duration_s(way_deg) + motion.settle_s
    return period_s


def tracking_policy(
    rig: Rig, found: Found, confirmation: Sample, *, speed_deg_s: float, duration_s: float, period_s: float
) -> TrackingPolicy:
    """Policy that follows a marker from now on.

    ``found``: the answer of the search, with the marker's intensity curve. ``confirmation``: the acquisition at the
    angle found, for its noise. ``speed_deg_s``: speed of the marker: half as much again, and turns within `TURN_S`, are
    followed. ``duration_s``: how long it is followed. ``period_s``: time from frame to frame, as a first guess.
    """
    tracker, noise_sigma = _tracker(rig, found, confirmation, speed_deg_s=speed_deg_s)
    now_s = rig.scanner.clock.now_s()
    return TrackingPolicy(
        tracker,
        began_s=now_s,
        until_s=now_s + duration_s,
        period_s=period_s,
        noise_sigma=noise_sigma,
    )


def _tracker(rig: Rig, found: Found, confirmation: Sample, *, speed_deg_s: float) -> tuple[Tracker, float]:
    """The tracker of that marker, and the noise of a frame at rest."""
    noise_sigma = confirmation.reading.noise_sigma
    if found.curve is None or noise_sigma is None:
        raise SearchError("the search states no curve, or its frames no noise; search with the method posterior")
    tracker = Tracker(
        angle_deg=found.mean_deg,
        sigma_deg=found.sigma_deg,
        fwhm_deg=found.curve.fwhm_deg,
        peak=found.curve.peak,
        # Not the simulation's own draws.
        rng=np.random.default_rng([0 if rig.facts.seed is None else rig.facts.seed, 68]),
        limits=rig.limits.search,
        # With more than that it would be lost sooner at a low rate of frames.
        most_speed_deg_s=1.5 * speed_deg_s,
        acceleration_deg_s2=2 * speed_deg_s / TURN_S,
    )
    return tracker, noise_sigma


def require_streaming(rig: Rig) -> SweepingDevices:
    """The devices of a rig that can follow a marker by sweeps; `ConfigError` says what it lacks."""
    require_room(rig.limits.search)
    devices = rig.scanner.sweeping
    readout_s = devices.receiver.sweep_readout_s
    if readout_s > 0:
        raise ConfigError(
            f"track: the receiver reads its frames for {readout_s:g} s after each sweep, and a marker is followed from "
            "frame to frame; name a rig whose readout_s is at most its frame_period_s, or leave --sweep out"
        )
    return devices


def swept_tracking_policy(
    rig: Rig, found: Found, confirmation: Sample, *, speed_deg_s: float, duration_s: float
) -> SweptTrackingPolicy:
    """Policy that follows a marker by sweeps from now on; arguments as of `tracking_policy`.

    `ConfigError` as of `require_streaming`.
    """
    tracker, noise_sigma = _tracker(rig, found, confirmation, speed_deg_s=speed_deg_s)
    devices = require_streaming(rig)
    now_s = rig.scanner.clock.now_s()
    return SweptTrackingPolicy(
        tracker,
        rig=SweptRig(
            fastest_deg_s=devices.stage.fastest_sweep_deg_s,
            acceleration_deg_s2=devices.stage.acceleration_deg_s2,
            period_s=devices.least_period_s,
            # That of one pulse: the confirmation is the mean of many.
            noise_sigma=noise_sigma * math.sqrt(rig.scanner.pulses),
        ),
        began_s=now_s,
        until_s=now_s + duration_s,
        probe_deg=rig.scanner.angle_deg,
        place=confirmation.reading,
    )


def track_run(rig: Rig, policy: AnyTrackingPolicy, swing: OscillatingMotion) -> Generator[Event, None, None]:
    """Let the marker of a `MovingWorld` oscillate, and track it: the events of `markerseek.scan.run`.

    The guard permits each move and each firing, as in a search.
    """
    swing.begin(rig.scanner.clock.now_s())
    yield from run(policy, rig.scanner, RunPlan(stay=True), limits=RunLimits(acquisitions=MAX_FRAMES))


def quality_of(
    policy: AnyTrackingPolicy, swing: OscillatingMotion, *, rest_deg: float, without_s: float = 0.0
) -> TrackQuality | None:
    """Quality of a track after the run; None if there was no frame.

    ``rest_deg``: the marker's angle at rest. ``without_s``: time after the first frame that does not count.
    """
    track = [each for each in policy.track if each.time_s >= policy.track[0].time_s + without_s]
    if not track:
        return None
    moment_s = 1e-6
    errors = [each.angle_deg - rest_deg - swing.moved_deg(each.time_s) for each in track]
    speeds = [(swing.moved_deg(each.time_s + moment_s) - swing.moved_deg(each.time_s)) / moment_s for each in track]
    return TrackQuality.of(errors, speeds, [each.sigma_deg for each in track])
