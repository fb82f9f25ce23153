"""The tracker against plain importance sampling of the same model, and on markers whose motion is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.tracking import track
from markerseek.core import (
    MAX_ACQUISITIONS,
    ConfigError,
    Finished,
    Found,
    FrameHeader,
    Interval,
    MarkerCurve,
    Measured,
    NotFound,
    Reading,
    ReadingFrame,
    Sample,
    SearchError,
)
from markerseek.guard import State
from markerseek.rigs import rig_in_world
from markerseek.runs import quality_of, stage_period_s, track_run, tracking, tracking_policy
from markerseek.search import Tracker, TrackingPolicy, flank_deg
from markerseek.search.posterior.likelihood import TABLE_LOW, TABLE_STEP, log_tables
from markerseek.search.tracking import (
    BEGINS_PER_S,
    ENERGY_ERRORS,
    FORMS,
    HEIGHT_ERROR,
    MOST_TIMES,
    WANDER,
    WIDTH_ERROR,
)
from markerseek.search.tracking import TURN_S as TURNS_S
from markerseek.signals import IntensityReader
from markerseek.sim import (
    CurveWorld,
    LaserSettings,
    MovingWorld,
    OscillatingMotion,
    PowerCurve,
    ReceiverSettings,
    SimulatedSettings,
    StageMotion,
    VirtualClock,
    swing_deg,
)

FWHM_DEG, PEAK = 5.0, 100.0


def tracker(**changes):
    values = {"angle_deg": 2.0, "sigma_deg": 0.3, "fwhm_deg": FWHM_DEG, "peak": PEAK, **changes}
    return Tracker(rng=np.random.default_rng(5), **values)


def told(one, probe_deg, intensity, *, after_s):
    one.tell(probe_deg, intensity, after_s=after_s, noise_sigma=1.0, cells=10)


def test_the_curves_of_its_markers_have_their_width_and_tails():
    drawn = tracker().drawn(500)
    height = drawn.curve(
        np.stack([drawn.width_deg / 2, 0 * drawn.width_deg, 2000 + drawn.width_deg, 2 * (2000 + drawn.width_deg)])
    )
    assert height[0] / height[1] == pytest.approx(0.5)
    assert height[2] / height[3] == pytest.approx(2**drawn.tail, rel=1e-2)
    assert {(tail, knee) for tail, knee in zip(drawn.tail, drawn.knee, strict=True)} == set(FORMS)
    assert np.std(np.log(drawn.width_deg / FWHM_DEG)) == pytest.approx(WIDTH_ERROR, rel=0.15)


def test_it_is_the_posterior_of_its_model():
    """Many markers drawn once, each weighed by all frames: no resampling, nothing that drifts."""
    rng, after_s, number = np.random.default_rng(1), 0.1, 400_000
    ours = tracker(most_speed_deg_s=6.0, acceleration_deg_s2=4.0, particles=40_000)
    angle, speed = rng.normal(2.0, 0.3, number), rng.uniform(-6, 6, number)
    acceleration = np.zeros(number)
    tail, knee = np.array(FORMS)[rng.integers(len(FORMS), size=number)].T
    height = PEAK * np.exp(HEIGHT_ERROR * rng.standard_normal(number))
    width = FWHM_DEG * np.exp(WIDTH_ERROR * rng.standard_normal(number))
    log_weight, log_error = np.zeros(number), np.zeros((len(ENERGY_ERRORS), number))
    for frame in range(1, 9):
        truth = 2.0 + 3.0 * after_s * frame
        probe = truth + (1.5 if frame % 2 else -1.5)
        intensity = PEAK * PowerCurve(fwhm_deg=FWHM_DEG, power=1.6).peaks(probe - truth)[0] * (1 + 0.05 * rng.normal())
        told(ours, probe, intensity, after_s=after_s)
        chance = rng.random(number)
        begins = (acceleration == 0) & (chance < 1 - math.exp(-after_s * BEGINS_PER_S))
        acceleration[(acceleration != 0) & (chance < 1 - math.exp(-after_s / TURNS_S))] = 0.0
        acceleration[begins] = rng.uniform(-MOST_TIMES * 4.0, MOST_TIMES * 4.0, int(begins.sum()))
        former = speed + WANDER * 4.0 * math.sqrt(after_s) * rng.standard_normal(number)
        faster = former + acceleration * after_s
        acceleration[np.abs(faster) > 6.0] = 0.0
        speed = np.clip(faster, -6.0, 6.0)
        angle = angle + (former + speed) / 2 * after_s
        off = 2 * np.abs(probe - angle) / width
        expected = height * (1 + (2 ** (knee / tail) - 1) * off**knee) ** (-tail / knee)
        tables = log_tables(noise=1.0 / intensity, cells=10, errors=ENERGY_ERRORS)
        place = np.log(expected / intensity)
        grid = TABLE_LOW + TABLE_STEP * np.arange(tables.shape[1])
        log_error += [np.interp(place, grid, row) for row in tables]
        # Which error a frame has is the same in all frames, and unknown.
        log_weight = np.logaddexp.reduce(log_error, axis=0)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        mean = weight @ angle
        sigma = math.sqrt(weight @ (angle - mean) ** 2)
        assert ours.mean_deg == pytest.approx(mean, abs=0.25 * sigma + 0.02), frame
        assert ours.sigma_deg == pytest.approx(sigma, rel=0.25), frame
        assert ours.speed_deg_s == pytest.approx(weight @ speed, abs=0.4), frame


def followed(speed_deg_s, period_s, seed=1):
    return track(
        PowerCurve(fwhm_deg=FWHM_DEG, power=1.2),
        fwhm_deg=FWHM_DEG,
        peak_snr_db=40.0,
        speed_deg_s=speed_deg_s,
        period_s=period_s,
        duration_s=12.0,
        rng=np.random.default_rng(seed),
    )


@pytest.mark.parametrize("speed_deg_s", [1.0, 5.0, 10.0])
def test_ten_frames_a_second_follow_each_speed(speed_deg_s):
    found = followed(speed_deg_s, 0.1)
    assert not found.lost
    assert found.quality.rms_deg < 0.4
    assert abs(found.quality.lag_s) < 0.05


def test_a_fast_marker_at_a_frame_a_second_is_lost_and_is_said_to_be():
    assert all(followed(10.0, 1.0, seed).lost for seed in range(4))


def test_two_frames_a_second_are_followed_without_a_lag():
    """Motion noise grows with the root of the interval: a filter in which it grows with the interval lags by 0.2 s."""
    runs = [followed(1.0, 0.5, seed).quality for seed in range(4)]
    assert np.sqrt(np.mean([run.rms_deg**2 for run in runs])) < 0.17
    assert abs(np.mean([run.lag_s for run in runs])) < 0.08
    assert np.mean([run.covered for run in runs]) > 0.9


def test_it_looks_at_both_flanks_in_turn_and_stays_in_its_range():
    one = tracker(limits=Interval(low_deg=-5.0, high_deg=5.0), angle_deg=4.5)
    assert flank_deg(one, after_s=0.1, side=1.0) == flank_deg(one, after_s=0.1, side=-1.0)
    assert -5 <= flank_deg(one, after_s=0.1, side=1.0) <= 4.5 - 1
    middle = tracker()
    above, below = (flank_deg(middle, after_s=0.1, side=side) - 2.0 for side in (1.0, -1.0))
    assert above == pytest.approx(0.3 * FWHM_DEG, abs=0.1)
    assert below == pytest.approx(-0.3 * FWHM_DEG, abs=0.1)


def test_a_marker_that_goes_on_is_expected_farther_and_no_farther_than_its_range():
    one = tracker(most_speed_deg_s=6.0, acceleration_deg_s2=4.0)
    for number in range(1, 30):
        truth = 2.0 + 3.0 * 0.1 * number
        probe = truth + (1.5 if number % 2 else -1.5)
        told(one, probe, PEAK * PowerCurve(fwhm_deg=FWHM_DEG, power=1.6).peaks(probe - truth)[0], after_s=0.1)
    assert one.expected_deg(1.0) == pytest.approx(truth + 3.0, abs=0.6)
    assert one.expected_deg(60.0) <= 35.0


def test_one_frame_that_fits_nowhere_does_not_end_the_track():
    one = tracker()
    before = one.mean_deg
    told(one, flank_deg(one, after_s=0.05, side=1.0), 50 * PEAK, after_s=0.05)
    assert abs(one.mean_deg - before) < 0.5
    assert not one.lost


@pytest.mark.parametrize(("intensity", "noise_sigma"), [(1e300, 1.0), (5.0, 1e-200)])
def test_an_intensity_may_be_any_number_of_times_the_noise(intensity, noise_sigma):
    one = tracker()
    one.tell(2.0, intensity, after_s=0.1, noise_sigma=noise_sigma, cells=10)
    assert one.mean_deg == pytest.approx(2.0, abs=0.5)


@pytest.mark.parametrize("intensity", [-1.0, math.nan, math.inf])
def test_what_is_no_intensity_is_refused(intensity):
    with pytest.raises(SearchError, match="it must be finite and at least 0"):
        told(tracker(), 2.0, intensity, after_s=0.1)


@pytest.mark.parametrize(
    ("name", "value"),
    [("angle_deg", 40.0), ("angle_deg", math.nan), ("sigma_deg", 0.0), ("fwhm_deg", math.nan), ("peak", -1.0)],
)
def test_settings_that_cannot_be_are_refused(name, value):
    with pytest.raises(ConfigError, match="tracker: "):
        tracker(**{name: value})
    with pytest.raises(ConfigError, match="tracker: after_s"):
        tracker().expected_deg(0.0)


def test_the_marker_keeps_its_speed_and_turns_smoothly():
    time_s = np.arange(0, 60, 1e-3)
    angle = np.array([swing_deg(t, 5.0) for t in time_s])
    speed = np.diff(angle) / 1e-3
    assert np.abs(speed).max() == pytest.approx(5.0, rel=1e-3)
    assert np.abs(np.diff(speed)).max() / 1e-3 == pytest.approx(10.0, rel=0.05)
    assert np.mean(np.abs(speed) > 4.99) == pytest.approx(4 / 5, abs=0.03)


def test_a_stage_s_frame_rate_is_that_of_its_moves():
    period_s = stage_period_s(StageMotion(), fwhm_deg=5.0, speed_deg_s=0.0, frame_s=0.2)
    # 3 deg from rest to rest at 10 deg/s², 2·sqrt(d/a), then 0.1 s of rest and the frame.
    assert period_s == pytest.approx(2 * math.sqrt(0.3) + 0.1 + 0.2)
    # The way of a moving marker is longer by its speed times the period: the period solves that equation.
    moving_s = stage_period_s(StageMotion(), fwhm_deg=5.0, speed_deg_s=5.0, frame_s=0.2)
    assert moving_s == pytest.approx(0.3 + StageMotion().duration_s(3.0 + 5.0 * moving_s), rel=1e-3)
    assert stage_period_s(StageMotion(), fwhm_deg=5.0, speed_deg_s=10.0, frame_s=0.2) == math.inf


def rig_of_intensities(swing, *, stage):
    """A moving marker on a rig of intensities: the stage, the laser and the guard are those of a rig with frames."""
    settings = SimulatedSettings(
        stage=stage, laser=LaserSettings(pulses=4), receiver=ReceiverSettings(readout_s=0.02), start_deg=1.0
    )
    rng = np.random.default_rng(1)
    world = CurveWorld.of_settings(
        settings, curve=PowerCurve(fwhm_deg=FWHM_DEG, power=1.2), marker_deg=1.0, cells=1000, rng=rng
    )
    return rig_in_world(
        MovingWorld(world, swing),
        settings,
        clock=VirtualClock(),
        reader=IntensityReader(),
        description="",
        truth_deg=1.0,
        rng=rng,
    )


def on_rig(speed_deg_s, *, stage, duration_s=10.0):
    swing = OscillatingMotion(speed_deg_s=speed_deg_s)
    rig = rig_of_intensities(swing, stage=stage)
    confirmation = rig.scanner.measure(1.0)
    found = Found(
        mean_deg=1.0,
        sigma_deg=0.1,
        interval95_deg=Interval(low_deg=0.8, high_deg=1.2),
        interval_kind="posterior",
        curve=MarkerCurve(fwhm_deg=FWHM_DEG, peak=confirmation.reading.intensity),
    )
    policy = tracking_policy(rig, found, confirmation, speed_deg_s=speed_deg_s, duration_s=duration_s, period_s=0.1)
    events = list(track_run(rig, policy, swing))
    return rig, policy, events, quality_of(policy, swing, rest_deg=1.0)


DIRECT = StageMotion(speed_deg_s=360.0, acceleration_deg_s2=5000.0, backlash_deg=0.0, settle_s=0.02)


@pytest.mark.parametrize("speed_deg_s", [1.0, 10.0])
def test_a_rig_with_a_fast_stage_follows_through_guard_and_laser(speed_deg_s):
    rig, policy, events, quality = on_rig(speed_deg_s, stage=DIRECT)
    assert not policy.lost
    assert quality.rms_deg < 0.4
    assert abs(quality.lag_s) < 0.05
    measured = [each for each in events if isinstance(each, Measured)]
    assert len(measured) == len(policy.track) > 60
    assert isinstance(events[-1], Finished)
    assert isinstance(events[-1].estimate, Found)
    assert rig.scanner.guard.state is State.DISARMED


def test_a_rig_that_is_too_slow_loses_the_marker_and_stops():
    rig, policy, events, _ = on_rig(10.0, stage=StageMotion(), duration_s=30.0)
    assert policy.lost
    assert isinstance(events[-1].estimate, NotFound)
    assert "was lost after" in events[-1].estimate.reason
    assert rig.scanner.guard.state is State.DISARMED


def test_a_track_has_a_limit_of_its_own(monkeypatch):
    assert tracking.MAX_FRAMES > MAX_ACQUISITIONS
    monkeypatch.setattr(tracking, "MAX_FRAMES", 5)
    with pytest.raises(SearchError, match="asked for more than 5 acquisitions"):
        on_rig(1.0, stage=DIRECT, duration_s=3.0)


def test_a_moving_world_is_seen_where_it_is_at_the_flash():
    """The intensity of a frame is that of a world at rest with the marker at the moved angle."""
    swing = OscillatingMotion(speed_deg_s=5.0)
    rig = rig_of_intensities(swing, stage=DIRECT)
    swing.begin(rig.scanner.clock.now_s())
    for _ in range(8):
        sample = rig.scanner.measure(3.0)
        now_deg = 1.0 + swing.moved_deg(sample.frame.header.started_s)
        expected = 100 * PowerCurve(fwhm_deg=FWHM_DEG, power=1.2).peaks(3.0 - now_deg)[0]
        assert sample.reading.intensity == pytest.approx(expected, abs=0.06 * expected + 5)
    # In closed form: at rest until it begins, then from the middle of the swing upwards at an even speed.
    one = OscillatingMotion(speed_deg_s=5.0)
    one.begin(7.0)
    assert [one.moved_deg(at_s) for at_s in (0.0, 7.0, 7.4, 8.2)] == pytest.approx([0.0, 0.0, 2.0, 6.0])
    assert max(one.moved_deg(7 + 0.01 * step) for step in range(2000)) == pytest.approx(one.reach_deg, abs=1e-3)


def test_a_sample_without_time_is_refused():
    policy = TrackingPolicy(tracker(), began_s=5.0, until_s=9.0, period_s=0.2, noise_sigma=1.0)
    sample = Sample(angle_deg=2.0, reading=Reading(intensity=10.0))
    with pytest.raises(SearchError, match="has no time"):
        policy.tell(sample)
    header = FrameHeader(sequence=1, token="a", pulses=4, commanded_deg=2.0, started_s=4.0, ended_s=4.1)
    with pytest.raises(SearchError, match="it must be later"):
        policy.tell(replace(sample, frame=ReadingFrame(header=header, intensity=10.0)))


def test_a_dark_frame_says_nothing_of_the_marker():
    """A rig takes some before its policy is asked: each would say that the marker is not where it was found."""
    one = tracker()
    policy = TrackingPolicy(one, began_s=5.0, until_s=9.0, period_s=0.2, noise_sigma=1.0)
    header = FrameHeader(sequence=1, token="a", pulses=0, commanded_deg=2.0, started_s=6.0, ended_s=6.1)
    dark = Sample(
        angle_deg=2.0,
        reading=Reading(intensity=4.0, noise_sigma=1.0, cells=1000),
        dark=True,
        frame=ReadingFrame(header=header, intensity=4.0),
    )
    before = policy.ask(), policy.estimate()
    policy.tell(dark)
    assert (policy.ask(), policy.estimate()) == before
    assert not policy.track
