"""The tracker against a particle filter of the same model, and on markers whose motion is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.core import ConfigError, Interval, SearchError
from markerseek.search import Tracker
from markerseek.search.tracking import SHAPE_ERROR, curve
from markerseek.sim import PowerCurve, StageMotion
from markerseek.studies.tracking import marker_deg, stage_period_s, track

FWHM_DEG, PEAK = 5.0, 100.0


def tracker(**changes):
    values = {"angle_deg": 2.0, "sigma_deg": 0.3, "fwhm_deg": FWHM_DEG, "peak": PEAK, "noise_sigma": 1.0, **changes}
    return Tracker(**values)


def test_the_curve_has_its_width_and_tails():
    half = curve(np.array([-FWHM_DEG / 2, 0.0, FWHM_DEG / 2]), fwhm_deg=FWHM_DEG)
    assert half == pytest.approx([0.5, 1.0, 0.5])
    far = curve(np.array([200.0, 400.0]), fwhm_deg=FWHM_DEG)
    assert far[0] / far[1] == pytest.approx(2**1.2, rel=1e-2)


def test_it_is_the_posterior_of_its_model():
    """A particle filter with 400,000 particles draws what the tracker computes on its grid."""
    rng = np.random.default_rng(1)
    ours = tracker(most_speed_deg_s=6.0, acceleration_deg_s2=4.0)
    angle = rng.normal(2.0, 0.3, 400_000)
    speed = rng.choice(np.linspace(-6, 6, 25), angle.size)
    for number in range(1, 9):
        after_s, truth = 0.2, 2.0 + 3.0 * 0.2 * number
        probe = ours.ask(after_s)
        intensity = PEAK * float(curve(np.array([probe - truth]), fwhm_deg=FWHM_DEG)[0]) * (1 + 0.05 * rng.normal())
        ours.tell(probe, intensity, after_s=after_s)
        # The speed changes by a normal deviate, within the largest one, and then moves the angle.
        step = speed + rng.normal(0, 4.0 * after_s, angle.size)
        outside = np.abs(step) > 6.25
        while outside.any():
            step[outside] = speed[outside] + rng.normal(0, 4.0 * after_s, int(outside.sum()))
            outside = np.abs(step) > 6.25
        speed = np.clip(step, -6, 6)
        angle = angle + after_s * speed
        expected = PEAK * curve(probe - angle, fwhm_deg=FWHM_DEG)
        sigma = np.hypot(1.0, SHAPE_ERROR * expected)
        weight = 0.999 * np.exp(-0.5 * ((intensity - expected) / sigma) ** 2) / sigma + 1e-3
        weight /= weight.sum()
        assert ours.mean_deg == pytest.approx(weight @ angle, abs=0.08), number
        assert ours.sigma_deg == pytest.approx(math.sqrt(weight @ (angle - weight @ angle) ** 2), rel=0.15), number
        assert ours.speed_deg_s == pytest.approx(weight @ speed, abs=0.4), number
        chosen = rng.choice(angle.size, angle.size, p=weight)
        angle, speed = angle[chosen], speed[chosen]


def follow(speed_deg_s, period_s, seed=1):
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
    found = follow(speed_deg_s, 0.1)
    assert not found.lost
    assert found.rms_deg < 0.4
    assert abs(found.lag_s) < 0.05


def test_a_fast_marker_at_a_frame_a_second_is_lost_and_is_said_to_be():
    assert all(follow(10.0, 1.0, seed).lost for seed in range(4))


def test_it_looks_at_both_flanks_in_turn_and_stays_in_its_range():
    one = tracker(limits=Interval(low_deg=-5.0, high_deg=5.0), angle_deg=4.5)
    asked = []
    for _ in range(6):
        asked.append(one.ask(0.1))
        one.tell(asked[-1], PEAK * float(curve(np.array([asked[-1] - 4.5]), fwhm_deg=FWHM_DEG)[0]), after_s=0.1)
    assert all(-5 <= angle <= 5 for angle in asked)
    middle = tracker()
    first = middle.ask(0.1)
    middle.tell(first, 75.0, after_s=0.1)
    assert (first - 2.0) * (middle.ask(0.1) - 2.0) < 0


def test_one_frame_that_fits_nowhere_does_not_end_the_track():
    one = tracker()
    before = one.mean_deg
    one.tell(one.ask(0.05), 50 * PEAK, after_s=0.05)
    assert abs(one.mean_deg - before) < 0.5
    assert not one.lost


@pytest.mark.parametrize("intensity", [-1.0, math.nan, math.inf])
def test_what_is_no_intensity_is_refused(intensity):
    with pytest.raises(SearchError, match="it must be finite and at least 0"):
        tracker().tell(2.0, intensity, after_s=0.1)


@pytest.mark.parametrize(
    ("name", "value"),
    [("angle_deg", 40.0), ("angle_deg", math.nan), ("sigma_deg", 0.0), ("fwhm_deg", math.nan), ("peak", -1.0)],
)
def test_settings_that_cannot_be_are_refused(name, value):
    with pytest.raises(ConfigError, match="tracker: "):
        tracker(**{name: value})
    with pytest.raises(ConfigError, match="tracker: after_s"):
        tracker().ask(0.0)


def test_the_marker_keeps_its_speed_and_turns_smoothly():
    time_s = np.arange(0, 60, 1e-3)
    angle = np.array([marker_deg(t, 5.0) for t in time_s])
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
