"""Tracking by sweeps: the tracker on frames of known motion, the policy on a rig, judged by the rig's truth."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.tracking import track_by_sweeps
from markerseek.core import (
    AcquisitionError,
    ConfigError,
    Finished,
    Found,
    FrameHeader,
    Interval,
    Measured,
    NotFound,
    Reading,
    ReadingFrame,
    Refused,
    RunPlan,
    Sample,
    SearchError,
    Sweep,
    SweepTiming,
    Swept,
)
from markerseek.guard import State
from markerseek.runs import require_streaming
from markerseek.search import SweptRig, SweptTrackingPolicy, Tracker
from markerseek.search.tracking import OWN_S
from markerseek.sim import (
    GaussianCurve,
    LaserSettings,
    OscillatingMotion,
    PowerCurve,
    ReceiverSettings,
    SimulatedSettings,
    StageMotion,
)
from tests.unit.scan.sweep_bench import SweepBench

FWHM_DEG, PEAK = 5.0, 25.0
CURVE = PowerCurve(fwhm_deg=FWHM_DEG, power=1.6)


def tracker(**changes):
    values = {"angle_deg": 2.0, "sigma_deg": 0.3, "fwhm_deg": FWHM_DEG, "peak": PEAK, **changes}
    return Tracker(rng=np.random.default_rng(1), **values)


def told(one, probe_deg, truth_deg, *, rng, after_s=0.05, jitter=0.1):
    height = PEAK * CURVE.peaks(probe_deg - truth_deg)[0]
    noisy = math.hypot(height * (1 + jitter * rng.standard_normal()) + rng.standard_normal(), rng.standard_normal())
    one.tell(probe_deg, noisy, after_s=after_s, noise_sigma=1.0, cells=10)


@pytest.mark.parametrize("jitter", [0.02, 0.1])
def test_a_marker_that_is_crossed_again_and_again_is_known_and_so_is_the_error_of_a_pulse(jitter):
    rng, errors, sigmas, speeds = np.random.default_rng(3), [], [], []
    one = tracker(most_speed_deg_s=3.0, acceleration_deg_s2=4.0)
    for number in range(1, 400):
        now_s = 0.05 * number
        truth_deg = 2.0 + 1.0 * now_s
        # A probe that swings by 3 deg to either side.
        told(one, truth_deg + 3 * math.sin(2 * now_s), truth_deg, rng=rng, jitter=jitter)
        if number > 100:
            errors.append(one.mean_deg - truth_deg)
            sigmas.append(one.sigma_deg)
            speeds.append(one.speed_deg_s)
    assert np.sqrt(np.mean(np.square(errors))) < 0.3
    assert np.mean(speeds) == pytest.approx(1.0, abs=0.3)
    assert np.mean(np.abs(errors) <= 1.96 * np.array(sigmas)) > 0.8
    assert one.energy_error == pytest.approx(max(jitter, 0.03), rel=0.5)
    assert not one.lost


def test_a_marker_that_is_nowhere_near_is_said_to_be_lost():
    rng, one = np.random.default_rng(3), tracker()
    for _ in range(40):
        told(one, one.mean_deg, one.mean_deg + 30.0, rng=rng)
        if one.lost:
            break
    assert one.lost


def test_frames_faster_than_the_error_of_a_curve_changes_say_together_what_one_of_them_says():
    widths = {}
    for frames in (1, 8):
        one = tracker(sigma_deg=1.5, most_speed_deg_s=0.01, acceleration_deg_s2=0.01)
        for _ in range(frames):
            one.tell(4.0, 0.6 * PEAK, after_s=OWN_S / frames, noise_sigma=5.0, cells=1)
        widths[frames] = one.sigma_deg
    assert widths[8] == pytest.approx(widths[1], rel=0.05)
    # Slower ones are evidence of their own.
    for _ in range(7):
        one.tell(4.0, 0.6 * PEAK, after_s=OWN_S, noise_sigma=5.0, cells=1)
    assert one.sigma_deg < 0.8 * widths[1]


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_a_marker_is_lost_by_a_quarter_of_a_second_of_outliers_however_fast_the_frames_come(rate_hz):
    one = tracker()
    for _ in range(20):
        one.tell(1.0, PEAK, after_s=1 / rate_hz, noise_sigma=1.0, cells=1)
    outliers = 0
    while not one.lost:
        # Far above the curve: no marker explains it.
        one.tell(1.0, 5 * PEAK, after_s=1 / rate_hz, noise_sigma=1.0, cells=1)
        outliers += 1
    assert 0.15 <= outliers / rate_hz <= 0.3


@pytest.mark.parametrize("intensity", [-1.0, math.nan, math.inf])
def test_what_is_no_intensity_is_refused(intensity):
    with pytest.raises(SearchError, match="it must be finite and at least 0"):
        tracker().tell(2.0, intensity, after_s=0.05, noise_sigma=1.0, cells=10)


@pytest.mark.parametrize(
    ("noise_sigma", "cells"), [(math.nan, 10), (0.0, 10), (-1.0, 10), (math.inf, 10), (1.0, 0), (1.0, -1)]
)
def test_what_is_no_noise_is_refused(noise_sigma, cells):
    one = tracker()
    with pytest.raises(SearchError, match="it must be finite and above 0, of at least 1 cell"):
        one.tell(2.0, 10.0, after_s=0.05, noise_sigma=noise_sigma, cells=cells)
    assert one.mean_deg == pytest.approx(2.0, abs=0.05)


def test_an_angle_that_is_no_number_is_lost():
    one = tracker()
    assert not one.lost
    one._weight[:] = math.nan
    assert one.lost


@pytest.mark.parametrize(
    ("name", "value"),
    [("angle_deg", 40.0), ("angle_deg", math.nan), ("sigma_deg", 0.0), ("fwhm_deg", math.nan), ("peak", -1.0)],
)
def test_settings_that_cannot_be_are_refused(name, value):
    with pytest.raises(ConfigError, match="tracker: "):
        tracker(**{name: value})


def policy(*, began_s=5.0, until_s=9.0, probe_deg=2.0, **changes):
    rig = SweptRig(fastest_deg_s=12.5, acceleration_deg_s2=25.0, period_s=0.05, noise_sigma=1.0)
    return SweptTrackingPolicy(tracker(**changes), rig=rig, began_s=began_s, until_s=until_s, probe_deg=probe_deg)


def sample(at_s, angle_deg=2.0, intensity=20.0, speed_deg_s=5.0):
    header = FrameHeader(sequence=1, token="a", pulses=1, commanded_deg=9.0, started_s=at_s, ended_s=at_s)
    return Sample(
        angle_deg=angle_deg,
        reading=Reading(intensity=intensity, noise_sigma=1.0, cells=10),
        sweep=SweepTiming(number=1, speed_deg_s=speed_deg_s, delay_sigma_s=5e-3),
        frame=ReadingFrame(header=header, intensity=intensity),
    )


def test_it_asks_for_the_same_sweep_until_it_wants_another_and_ends_in_time():
    one = policy(until_s=5.25)
    first = one.ask()
    assert isinstance(first, Sweep)
    assert first.lit_braking
    assert first.speed_deg_s <= 12.5
    assert one.ask() == first
    one.tell(sample(5.1))
    assert one.ask() in (first, None)
    one.end_sweep()
    assert isinstance(one.ask(), Sweep)
    one.tell(sample(5.3))
    assert one.ask() is None
    assert isinstance(one.estimate(), Found)


def test_a_sweep_of_which_no_frame_was_admitted_ends_the_track():
    one = policy()
    assert isinstance(one.ask(), Sweep)
    one.tell(sample(5.1))
    one.end_sweep()
    assert isinstance(one.ask(), Sweep)
    one.end_sweep()
    assert one.ask() is None
    assert one.lost
    ended = one.estimate()
    assert isinstance(ended, NotFound)
    assert "no frame of a sweep was admitted, after 1 frames" in ended.reason


def test_a_track_whose_frames_are_all_refused_ends_without_a_fault():
    bench, one = on_bench()

    def refused(*_, **__):
        raise AcquisitionError("no use")

    bench.scanner.guard.admit_reading = refused
    events = list(bench.run(one, plan=RunPlan(stay=True)))
    assert sum(isinstance(event, Swept) for event in events) == 1
    assert any(isinstance(event, Refused) for event in events)
    assert isinstance(events[-1], Finished)
    assert isinstance(events[-1].estimate, NotFound)
    assert bench.scanner.guard.state is State.DISARMED


@pytest.mark.parametrize("width_deg", [0.3, 0.99])
def test_a_range_in_which_no_sweep_has_room_is_refused(width_deg):
    limits, said = (
        Interval(low_deg=2.0, high_deg=2.0 + width_deg),
        r"range is 0\.\d+ deg wide, .* at least 1 deg; widen",
    )
    with pytest.raises(ConfigError, match=said):
        policy(limits=limits)
    # Of a rig before anything moves: this one has nothing that could.
    with pytest.raises(ConfigError, match=said):
        require_streaming(SimpleNamespace(limits=SimpleNamespace(search=limits)))
    assert isinstance(policy(limits=Interval(low_deg=2.0, high_deg=3.0), probe_deg=2.5).ask(), Sweep)


def test_at_an_end_of_the_range_it_sweeps_back_and_never_out_of_it():
    one = policy(angle_deg=34.9, probe_deg=35.0)
    asked = one.ask()
    assert isinstance(asked, Sweep)
    assert -35.0 <= asked.to_deg < 35.0


def test_a_probe_that_sweeps_away_from_a_lost_marker_turns_round():
    one = policy(angle_deg=20.0, sigma_deg=6.0, until_s=30.0, probe_deg=-5.0, most_speed_deg_s=2.0)
    one.ask()
    one._sweep = Sweep(to_deg=-35.0, speed_deg_s=12.5, lit_braking=True)
    for number in range(1, 11):
        # It sees nothing but noise.
        one.tell(sample(5.0 + 0.05 * number, -5.0 - 0.6 * number, 2.0, speed_deg_s=-12.5))
    assert one.searched_again == 1
    assert one.ask() is None
    one.end_sweep()
    assert one.ask().to_deg > 10.0


def test_a_marker_that_stays_lost_is_given_up():
    one = policy(until_s=100.0)
    now_s, rng = 5.0, np.random.default_rng(2)
    while one.ask() is not None and now_s < 60.0:
        now_s += 0.05
        # Noise, wherever it looks.
        one.tell(sample(now_s, float(rng.uniform(-35, 35)), float(rng.uniform(1.5, 2.5))))
        one.end_sweep()
    assert one.lost
    assert one.searched_again >= 1
    assert now_s < 40.0
    assert isinstance(one.estimate(), NotFound)


def test_a_sample_that_cannot_be_followed_is_refused():
    one = policy()
    with pytest.raises(SearchError, match="has no time"):
        one.tell(Sample(angle_deg=2.0, reading=Reading(intensity=10.0)))
    with pytest.raises(SearchError, match="has no time"):
        one.tell(replace(sample(6.0), sweep=None))
    with pytest.raises(SearchError, match="it must be later"):
        one.tell(sample(4.0))


def test_a_dark_frame_says_nothing_of_the_marker():
    one = policy()
    header = FrameHeader(sequence=1, token="a", pulses=0, commanded_deg=2.0, started_s=6.0, ended_s=6.1)
    dark = replace(sample(6.0), dark=True, sweep=None, frame=ReadingFrame(header=header, intensity=4.0))
    before = one.ask()
    one.tell(dark)
    assert one.ask() == before
    assert not one.track


def test_before_its_first_frame_the_marker_is_not_called_lost():
    before = policy().estimate()
    assert isinstance(before, NotFound)
    assert before.reason == "no frame has been measured yet"


def on_bench(**changes):
    """A marker that rests at 5 degrees, on the bench of the sweeps, and a policy that knows it may move."""
    bench = SweepBench(start_deg=5.0, **changes)
    devices = bench.scanner.sweeping
    rig = SweptRig(
        fastest_deg_s=devices.stage.fastest_sweep_deg_s,
        acceleration_deg_s2=devices.stage.acceleration_deg_s2,
        period_s=devices.least_period_s,
        noise_sigma=4.0,
    )
    one = SweptTrackingPolicy(
        tracker(angle_deg=5.0, fwhm_deg=6.0, peak=100.0), rig=rig, began_s=0.0, until_s=6.0, probe_deg=5.0
    )
    return bench, one


@pytest.mark.parametrize("changes", [{}, {"rate_hz": 100.0}, {"motion": StageMotion()}])
def test_every_pulse_is_under_a_permit_and_all_of_them_are_told(changes):
    bench, one = on_bench(**changes)
    events = list(bench.run(one, plan=RunPlan(stay=True)))
    swept = [event for event in events if isinstance(event, Swept)]
    measured = [event for event in events if isinstance(event, Measured)]
    assert len(swept) == len(bench.permits) > 2
    assert len(measured) == len(bench.flashes()) == len(one.track) == sum(each.pulses for each in swept)
    bench.require_permitted()
    assert all(before.time_s < after.time_s for before, after in pairwise(one.track))
    assert isinstance(events[-1], Finished)
    assert isinstance(events[-1].estimate, Found)
    assert events[-1].estimate.mean_deg == pytest.approx(5.0, abs=0.6)
    assert bench.scanner.guard.state is State.DISARMED


@pytest.mark.parametrize(
    ("curve_deg", "speed_deg_s", "most_deg"),
    [
        (PowerCurve(fwhm_deg=FWHM_DEG, power=1.2), 1.0, 0.5),
        (PowerCurve(fwhm_deg=FWHM_DEG, power=1.2), 5.0, 1.2),
        (GaussianCurve(fwhm_deg=FWHM_DEG), 1.0, 0.5),
    ],
)
def test_a_stage_of_25_deg_s_follows_a_marker_that_stop_and_go_loses(curve_deg, speed_deg_s, most_deg):
    settings = SimulatedSettings(
        stage=StageMotion(speed_deg_s=25.0, acceleration_deg_s2=25.0),
        laser=LaserSettings(rate_hz=20.0, energy_jitter=0.1, stamp_delay_s=5e-3),
        receiver=ReceiverSettings(readout_s=0.05),
    )
    done = track_by_sweeps(
        curve_deg,
        fwhm_deg=FWHM_DEG,
        settings=settings,
        motion=OscillatingMotion(speed_deg_s=speed_deg_s),
        duration_s=8.0,
        seed=1,
    )
    assert done.quality.rms_deg < most_deg
    assert abs(done.quality.lag_s) < 0.3
    assert done.quality.covered > 0.7
    assert done.sweeps > 2
    assert done.frames > 80


def test_frames_that_are_read_after_the_sweep_are_refused():
    settings = SimulatedSettings(receiver=ReceiverSettings(readout_s=10.0))
    with pytest.raises(ConfigError, match="reads its frames for 10 s after each sweep"):
        track_by_sweeps(
            PowerCurve(fwhm_deg=FWHM_DEG, power=1.2),
            fwhm_deg=FWHM_DEG,
            settings=settings,
            motion=OscillatingMotion(speed_deg_s=1.0),
            duration_s=5.0,
            seed=1,
        )
