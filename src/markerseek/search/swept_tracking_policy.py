"""A `Tracker` as a policy that turns the probe to and fro about a marker that moves, in light.

Which sweep is next, and whether the present one goes on, is decided by the information in its frames. Of markers drawn
from the posterior, each with its curve and its motion, any two are told apart by the intensities that they would give
along the path of the probe: D is the squared difference of these, in units of their noise. What is left of the
posterior's variance at a time is about

    V = Σ_ij (x_i − x_j)²·exp(−D_ij/4)/N²                                                                        (1)

with x the marker's angle then. The path is taken for which the mean of ln V over the next `AHEAD_S` is least, over more
where the marker is lost: in the usual time no sweep could turn round and reach it, and the probe would go on away from
it. So the probe crosses a slow marker, goes with a fast one, a little faster or slower than it, and turns when it does;
a marker that is lost is searched for over the range, without a rule for any of this.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from markerseek.core import (
    Bool,
    ConfigError,
    Estimate,
    Float64,
    Interval,
    NotFound,
    Reading,
    Sample,
    SearchError,
    Sweep,
)
from markerseek.search.policy import check_sample
from markerseek.search.posterior.likelihood import STRONG_SNR
from markerseek.search.posterior.sources import NEAR_M, POINT_M, Source
from markerseek.search.tracking import Markers, Tracker
from markerseek.search.tracking_policy import TrackPoint, found_at, require_later

AHEAD_S, STEP_S, CHECKED = 1.6, 0.05, 4
"""How far it looks ahead, in which steps, and how many times of that count in the mean of ln V."""

LOST_TIMES = 3
"""How many times as far it looks ahead, in as many steps, for a marker that is lost: the range takes a sweep 5 s."""

DRAWN = 64
"""Markers drawn from the posterior."""

SPEEDS = 6
"""Speeds of a sweep in either direction, evenly spaced up to the fastest."""

REST_S, LATE_S = 0.3, 0.1
"""Time between two sweeps in which the probe is at rest, and by which frames come after their pulse."""

LEAST_ROOM_DEG = 0.5
"""Least way from rest to an end of the range for a sweep towards it."""

LIT_SHARE = 0.2
"""Share of the speed of a sweep from which the probe is lit."""

JUDGED_EVERY_S = 0.09
"""Time between two judgements of a sweep."""

GAIN = 0.08
"""Least gain in the mean of −½·ln V for which a sweep is ended."""

NOISE_FLOOR = 3.0
"""Intensity over the noise below which frames say nothing."""

ENERGY_ERROR = 0.12
"""Relative error of a frame by which markers are told apart: what frames say of it varies, and plans need not."""

LEAST_DEG = 0.03
"""Standard deviation below which nothing is gained."""

TURNS_AT = (-0.5, 0.5, 0.0, 0.0, -0.25, 0.25, 0.0)
"""Acceleration that the drawn markers, one after the other, may get on the way, over the largest that is expected."""

TURNS_FROM_S, TURNS_UNTIL_S, TURNED_S = 0.3, 1.3, 0.5
"""When that acts, and how long an acceleration goes on that a marker already has."""

SWEEP_S = 4.0
"""Longest sweep at its speed: its end lies so far ahead, or at the end of the range."""

GIVEN_UP_RANGES = 2.0
"""Sweeps over the whole range, in time, after which a marker that is lost is given up."""

DEEPER_DEG = 15.0
"""Angle off the plane up to which the marker is looked up in the image, which shows it deeper there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweptRig:
    """What a policy must know of a rig to plan its sweeps."""

    fastest_deg_s: float
    acceleration_deg_s2: float
    period_s: float
    """Time from pulse to pulse."""
    noise_sigma: float
    """Noise of the frame of a single pulse."""


class SweptTrackingPolicy:
    """Follows a marker by sweeps until a time, or until it is lost for good; a `SweepingPolicy`.

    Parameters
    ----------
    tracker
        Knows the angle and the curve that a search found.
    rig
        Stage and laser.
    began_s
        Time on the rig's clock to which the angle belongs, in seconds.
    until_s
        No sweep begins after this time, and the last one ends then.
    probe_deg
        Where the probe is.
    place
        Reading with the probe on the marker: it is looked up at that place of each image. None, or one without a place,
        takes the largest peak of each image.

    Raises
    ------
    ConfigError
        If the tracker's limits leave no room for a sweep.
    """

    def __init__(
        self,
        tracker: Tracker,
        *,
        rig: SweptRig,
        began_s: float,
        until_s: float,
        probe_deg: float,
        place: Reading | None = None,
    ) -> None:
        require_room(tracker.limits)
        self._tracker, self._rig = tracker, rig
        self.began_s = began_s
        self._last_s, self._until_s = began_s, until_s
        self._source = None if place is None else _source(place, angle_deg=probe_deg)
        self._sweep: Sweep | None = None
        self._ending = False
        self._has_frames = self._blind = False
        self._judged_s = -math.inf
        # Where it will be at rest, and how long after the last frame.
        self._rest_deg, self._rest_after_s = probe_deg, LATE_S
        self._lost_since_s: float | None = None
        self.searched_again = 0
        """How often the marker was lost and searched for."""
        self.track: list[TrackPoint] = []

    @property
    def lost(self) -> bool:
        """Whether the marker is lost: at the end, or given up, also for want of frames."""
        return self._blind or self._lost_since_s is not None

    def ask(self) -> Sweep | None:
        """Next sweep, or that which goes on; None at the end, while it brakes, or once the marker is given up."""
        if self._ending or self._blind or self._last_s > self._until_s or self._given_up():
            return None
        if self._sweep is None:
            self._sweep, self._has_frames = self._planned(), False
        return self._sweep

    def tell(self, sample: Sample) -> None:
        """Take the frame of one pulse; a dark frame says nothing of the marker.

        Raises
        ------
        SearchError
            If it has no frame, and so no time, is not of a sweep, or is not later than the one before.
        """
        check_sample(sample)
        if sample.dark:
            return
        if sample.frame is None or sample.sweep is None:
            raise SearchError("a sample without a frame and a sweep has no time: a marker cannot be followed with it")
        now_s = sample.frame.header.started_s
        require_later(now_s, self._last_s)
        intensity, cells = self._looked_up(sample)
        tracker, timing = self._tracker, sample.sweep
        noise_sigma = sample.reading.noise_sigma or self._rig.noise_sigma
        tracker.tell(
            sample.angle_deg,
            intensity,
            after_s=now_s - self._last_s,
            noise_sigma=noise_sigma,
            cells=cells,
        )
        self._last_s, self._has_frames = now_s, True
        self._note_lost(clear=intensity >= STRONG_SNR * noise_sigma)
        # The delay of the stamps and the play are the same in all frames of a sweep: no number of them averages it.
        shared_deg = math.hypot(timing.speed_deg_s * timing.delay_sigma_s, timing.play_sigma_deg)
        self.track.append(
            TrackPoint(
                time_s=now_s,
                probe_deg=sample.angle_deg,
                intensity=intensity,
                angle_deg=tracker.mean_deg,
                sigma_deg=math.hypot(tracker.sigma_deg, shared_deg),
                speed_deg_s=tracker.speed_deg_s,
            )
        )
        brake_s = abs(timing.speed_deg_s) / self._rig.acceleration_deg_s2
        self._rest_deg = sample.angle_deg + timing.speed_deg_s * brake_s / 2
        self._rest_after_s = brake_s + REST_S - STEP_S
        self._judge(sample.angle_deg, timing.speed_deg_s)

    def end_sweep(self) -> None:
        """Plan again: the probe is at rest. Without a frame the plan would be the same, and the track ends."""
        self._blind = self._sweep is not None and not self._has_frames
        self._sweep, self._ending = None, False

    def estimate(self) -> Estimate:
        """The angle at the last frame; `NotFound` while the marker is lost, and before the first."""
        if self.lost or not self.track:
            if self._blind:
                reason = f"no frame of a sweep was admitted, after {len(self.track)} frames; look at those refused"
            elif self.lost:
                reason = f"the marker was lost after {len(self.track)} frames"
            else:
                reason = "no frame has been measured yet"
            return NotFound(mean_deg=self._tracker.mean_deg, reason=reason)
        last = self.track[-1]
        return found_at(last.angle_deg, sigma_deg=last.sigma_deg)

    def _note_lost(self, *, clear: bool) -> None:
        """Note whether it is lost; it is found again by a frame that is clear of the noise only."""
        if not self._tracker.lost:
            self._lost_since_s = None if clear else self._lost_since_s
        elif self._lost_since_s is None:
            self._lost_since_s = self._last_s
            self.searched_again += 1

    def _given_up(self) -> bool:
        width_deg = self._tracker.limits.width_deg
        most_s = GIVEN_UP_RANGES * width_deg / self._rig.fastest_deg_s
        return self._lost_since_s is not None and self._last_s - self._lost_since_s > most_s

    def _looked_up(self, sample: Sample) -> tuple[float, int]:
        """Intensity at the marker's place, and of how many cells of noise it may be the largest."""
        reading, source = sample.reading, self._source
        everywhere = reading.intensity, reading.cells or 1
        if source is None or reading.local_maxima is None:
            return everywhere
        deepest_m = source.depth_m + NEAR_M + source.moveout_m(source.angle_deg + DEEPER_DEG)
        near = reading.local_maxima.near(
            lateral_m=source.lateral_m,
            low_depth_m=source.depth_m - NEAR_M,
            high_depth_m=deepest_m,
            within_m=NEAR_M,
        )
        if near is None:
            return everywhere
        # The largest peak is refined between the pixels, and is the better value where it is the marker's.
        if reading.lateral_m is not None and reading.depth_m is not None:
            beside_m = abs(reading.lateral_m - source.lateral_m)
            if beside_m <= POINT_M and source.depth_m - NEAR_M <= reading.depth_m <= deepest_m:
                return reading.intensity, near[1]
        return near

    def _planned(self) -> Sweep:
        """The sweep of which the most is expected, from rest."""
        markers = self._tracker.drawn(DRAWN)
        speeds, paths = self._sweeps(self._rest_deg, after_s=self._rest_after_s)
        speed_deg_s = float(speeds[np.argmax(self._worth(paths, markers))])
        limits = self._tracker.limits
        to_deg = limits.nearest(self._rest_deg + speed_deg_s * SWEEP_S)
        return Sweep(to_deg=to_deg, speed_deg_s=abs(speed_deg_s), lit_braking=True)

    def _judge(self, probe_deg: float, speed_deg_s: float) -> None:
        """End the sweep where another one after it promises more than going on."""
        sweep = self._sweep
        if sweep is None or self._ending or self._last_s - self._judged_s < JUDGED_EVERY_S:
            return
        self._judged_s = self._last_s
        forward, now_deg_s = math.copysign(1.0, speed_deg_s), abs(speed_deg_s)
        time_s, acceleration = self._times(), self._rig.acceleration_deg_s2
        limits = self._tracker.limits
        on_deg = probe_deg + forward * _run_up(time_s, now_deg_s, sweep.speed_deg_s, acceleration)
        inside = (on_deg > limits.low_deg) & (on_deg < limits.high_deg)
        goes_on = _Paths(probe_deg=np.clip(on_deg, limits.low_deg, limits.high_deg)[None], lit=inside[None])
        # It goes on until the laser has heard of it, brakes in light, rests, and begins again.
        top_deg_s = min(sweep.speed_deg_s, now_deg_s + acceleration * LATE_S)
        begun_deg = probe_deg + forward * (now_deg_s + top_deg_s) / 2 * LATE_S
        brake_s = top_deg_s / acceleration
        rest_deg = limits.nearest(begun_deg + forward * top_deg_s * brake_s / 2)
        _, others = self._sweeps(rest_deg, after_s=LATE_S + brake_s + REST_S)
        braking_s = np.clip(time_s - LATE_S, 0.0, brake_s)
        braked_deg = np.where(
            time_s <= LATE_S,
            probe_deg + forward * now_deg_s * time_s,
            begun_deg + forward * (top_deg_s * braking_s - acceleration * braking_s**2 / 2),
        )
        early = time_s <= LATE_S + brake_s + REST_S
        # The light ends a reading before the probe is too slow.
        still_lit = top_deg_s - acceleration * (braking_s + STEP_S) >= LIT_SHARE * sweep.speed_deg_s
        ends = _Paths(
            probe_deg=np.where(early, braked_deg, others.probe_deg), lit=np.where(early, still_lit, others.lit)
        )
        markers = self._tracker.drawn(DRAWN)
        if float(self._worth(ends, markers).max()) > float(self._worth(goes_on, markers)[0]) + GAIN:
            self._ending = True

    def _sweeps(self, rest_deg: float, *, after_s: float) -> tuple[Float64[np.ndarray, " paths"], _Paths]:
        """All sweeps that may begin from rest then: their speeds with their signs, and the paths of the probe."""
        rig, limits = self._rig, self._tracker.limits
        up = rig.fastest_deg_s * np.arange(1, SPEEDS + 1) / SPEEDS
        speeds = np.concatenate([-up[::-1], up])
        # Not where there is no room for one.
        room_deg = np.where(speeds < 0, rest_deg - limits.low_deg, limits.high_deg - rest_deg)
        speeds = speeds[room_deg >= LEAST_ROOM_DEG]
        turning_s = np.maximum(self._times() - after_s, 0.0)
        gone_deg = np.array([_run_up(turning_s, 0.0, abs(speed), rig.acceleration_deg_s2) for speed in speeds])
        probe_deg = rest_deg + np.sign(speeds)[:, None] * gone_deg
        inside = (probe_deg > limits.low_deg) & (probe_deg < limits.high_deg)
        # The speed is known at the next reading only, a step later.
        fast = rig.acceleration_deg_s2 * (turning_s - STEP_S) >= LIT_SHARE * np.abs(speeds)[:, None]
        return speeds, _Paths(probe_deg=np.clip(probe_deg, limits.low_deg, limits.high_deg), lit=inside & fast)

    def _worth(self, paths: _Paths, markers: Markers) -> Float64[np.ndarray, " paths"]:
        """Mean of −½·ln V of (1) over `_times`, for each path."""
        angle_deg = self._expected_deg(markers)
        height = self._tracker.peak / self._rig.noise_sigma * markers.curve(paths.probe_deg[:, :, None] - angle_deg)
        # Of even variance, from var = 1 + (εμ)²; a step holds a number of pulses.
        stable = np.arcsinh(ENERGY_ERROR * np.maximum(height, NOISE_FLOOR)) / ENERGY_ERROR
        stable *= np.sqrt(paths.lit * self._step_s / self._rig.period_s)[:, :, None]
        step = angle_deg.shape[0] // CHECKED
        apart, worth = 0.0, np.zeros(paths.lit.shape[0])
        for begin in range(0, step * CHECKED, step):
            part = stable[:, begin : begin + step]
            square = (part**2).sum(axis=1)
            apart = apart + square[:, :, None] + square[:, None, :] - 2 * part.transpose(0, 2, 1) @ part
            then_deg = angle_deg[begin + step - 1]
            confused = (then_deg[:, None] - then_deg) ** 2 * np.exp(-np.clip(apart, 0.0, 200.0) / 4)
            worth -= 0.5 * np.log(confused.mean(axis=(1, 2)) + LEAST_DEG**2)
        return np.asarray(worth / CHECKED)

    @property
    def _step_s(self) -> float:
        """Time between two steps of what lies ahead."""
        return STEP_S * (LOST_TIMES if self._tracker.lost else 1)

    def _times(self) -> Float64[np.ndarray, " times"]:
        return self._step_s * np.arange(1, round(AHEAD_S / STEP_S) + 1)

    def _expected_deg(self, markers: Markers) -> Float64[np.ndarray, "times markers"]:
        """Angles of the markers at `_times`, if some turn on the way."""
        most_deg_s, angle_deg, speed_deg_s = self._tracker.most_speed_deg_s, markers.angle_deg, markers.speed_deg_s
        turns = np.resize(TURNS_AT, angle_deg.size) * self._tracker.acceleration_deg_s2
        turning = markers.acceleration_deg_s2 != 0
        rows = []
        step_s = self._step_s
        for time_s in self._times() - step_s:
            now = markers.acceleration_deg_s2 if time_s < TURNED_S else 0.0
            later = turns if TURNS_FROM_S <= time_s < TURNS_UNTIL_S else 0.0
            next_deg_s = speed_deg_s + np.where(turning, now, later) * step_s
            next_deg_s = np.clip(next_deg_s, -most_deg_s, most_deg_s)
            angle_deg = angle_deg + (speed_deg_s + next_deg_s) / 2 * step_s
            speed_deg_s = next_deg_s
            rows.append(angle_deg)
        return np.array(rows)


def require_room(limits: Interval) -> None:
    """Refuse limits by `ConfigError` in which there may be no room for a sweep from rest."""
    if not limits.width_deg >= 2 * LEAST_ROOM_DEG:
        raise ConfigError(
            f"track: the search range is {limits.width_deg:g} deg wide, a marker is followed by sweeps in at least "
            f"{2 * LEAST_ROOM_DEG:g} deg; widen it, or leave --sweep out"
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Paths:
    """Paths that the probe may take, at `_times` from now."""

    probe_deg: Float64[np.ndarray, "paths times"]
    lit: Bool[np.ndarray, "paths times"]


def _run_up(
    time_s: Float64[np.ndarray, " times"], from_deg_s: float, to_deg_s: float, acceleration_deg_s2: float
) -> Float64[np.ndarray, " times"]:
    """Path of a stage in degrees that speeds up to a speed, or has it already."""
    ramp_s = np.minimum(time_s, max(to_deg_s - from_deg_s, 0.0) / acceleration_deg_s2)
    reached_deg_s = from_deg_s + acceleration_deg_s2 * ramp_s
    return np.asarray((from_deg_s + reached_deg_s) / 2 * ramp_s + reached_deg_s * (time_s - ramp_s))


def _source(reading: Reading, *, angle_deg: float) -> Source | None:
    """The marker's place in the image; None where the reading has none."""
    if reading.lateral_m is None or reading.depth_m is None:
        return None
    return Source(
        lateral_m=reading.lateral_m, depth_m=reading.depth_m, angle_deg=angle_deg, intensity=reading.intensity
    )
