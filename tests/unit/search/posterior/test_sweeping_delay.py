"""The delay between pulse and angle, and the order of the frames of a burst, against closed forms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from msgspec import structs
from scipy.optimize import curve_fit
from scipy.stats import norm

from markerseek.core import (
    Reading,
    Sample,
    SweepTiming,
)
from markerseek.search.posterior.likelihood import later, with_light
from markerseek.search.posterior.sweeping import Delay, FrameOrder, delay_of, order_of

FWHM_DEG = 6.0
SNR = 50.0
CELLS = 100_000


def gaussian(angle_deg: np.ndarray, height: float, centre_deg: float) -> np.ndarray:
    return height * np.exp(-4 * np.log(2) * ((angle_deg - centre_deg) / FWHM_DEG) ** 2)


def fitted(samples: Sequence[Sample]) -> tuple[float, float, float]:
    """Centre of a Gaussian curve of known width by least squares, with its standard deviation and width."""
    angles_deg = np.array([sample.angle_deg for sample in samples])
    heights = np.array([sample.reading.intensity for sample in samples])
    guess = (heights.max(), angles_deg[heights.argmax()])
    values, covariance = curve_fit(gaussian, angles_deg, heights, guess, sigma=np.ones(len(samples)))
    return float(values[1]), float(np.sqrt(covariance[1, 1])), FWHM_DEG


def ways(
    *speeds_deg_s: float, delay_s: float, noise: float = 0.0, seed: int = 0, play_sigma_deg: float = 0.0
) -> list[Sample]:
    """Pulses at 100 Hz from end to end over a Gaussian curve about 3 degrees, one sweep a speed."""
    rng = np.random.default_rng(seed)
    made = []
    for number, speed in enumerate(speeds_deg_s, start=1):
        timing = SweepTiming(number=number, speed_deg_s=speed, delay_sigma_s=10e-3, play_sigma_deg=play_sigma_deg)
        for angle_deg in np.arange(-20.0, 20.0, abs(speed) / 100)[:: int(np.sign(speed))].tolist():
            height = float(gaussian(np.array(angle_deg + speed * delay_s), SNR, 3.0))
            reading = Reading(intensity=max(height + noise * rng.standard_normal(), 0.0), noise_sigma=1.0, cells=CELLS)
            made.append(Sample(angle_deg=angle_deg, reading=reading, sweep=timing))
    return made


def measured(samples: Sequence[Sample]) -> Delay:
    delay = delay_of(samples, fitted)
    assert delay is not None
    return delay


@pytest.mark.parametrize("delay_s", [-30e-3, 0.0, 7e-3, 30e-3])
@pytest.mark.parametrize("speeds_deg_s", [(25.0, -25.0), (-10.0, 25.0), (20.0, -5.0)])
def test_the_delay_is_that_of_the_closed_form(delay_s: float, speeds_deg_s: tuple[float, float]) -> None:
    delay = measured(ways(*speeds_deg_s, delay_s=delay_s))
    assert delay.measured_s == pytest.approx(delay_s, abs=1e-6)
    assert delay.prior_s == 10e-3
    # Both weighed, where the measurement knows everything.
    assert delay.mean_s == pytest.approx(delay_s, abs=1e-5)
    assert [sample.angle_deg for sample in later(ways(25.0, delay_s=0.0)[:1], delay_s)] == [-20.0 + 25.0 * delay_s]


def test_its_standard_deviation_is_that_of_the_scatter() -> None:
    delays = [measured(ways(25.0, -25.0, delay_s=5e-3, noise=1.0, seed=seed)) for seed in range(60)]
    off = [(delay.measured_s - 5e-3) / delay.sigma_s for delay in delays]
    assert abs(np.mean(off)) < 0.45
    assert 0.75 < np.std(off) < 1.3


def test_backlash_that_is_not_known_leaves_the_delay_open() -> None:
    exact, open_ = (measured(ways(25.0, -25.0, delay_s=10e-3, play_sigma_deg=play)) for play in (0.0, 0.5))
    # 0.5 deg over both speeds is as much as the prior: half of what was measured is believed.
    assert open_.sigma_s == pytest.approx(0.5 / 50.0, rel=1e-3)
    assert (exact.mean_s, open_.mean_s) == pytest.approx((10e-3, 5e-3), rel=1e-2)


def test_a_marker_that_moves_leaves_the_delay_open_and_explains_a_difference() -> None:
    """Each way has a displacement of its own: √2 · 0.5 deg over both speeds is √2 of the prior."""
    samples = ways(25.0, -25.0, delay_s=40e-3)
    moved = delay_of(samples, fitted, moved_deg=0.5)
    assert moved is not None
    assert moved.sigma_s == pytest.approx(math.sqrt(2) * 0.5 / 50.0, rel=1e-3)
    assert moved.mean_s == pytest.approx(40e-3 / 3, rel=1e-2)
    assert (measured(samples).unexplained, moved.unexplained) == (True, False)


@pytest.mark.parametrize(("delay_s", "unexplained"), [(29e-3, False), (-29e-3, False), (31e-3, True), (-50e-3, True)])
def test_what_three_sigmas_of_the_rig_do_not_explain_is_no_delay(delay_s: float, unexplained: bool) -> None:
    assert measured(ways(25.0, -25.0, delay_s=delay_s)).unexplained == unexplained


@pytest.mark.parametrize("missing", [(-21.0, 4.0), (2.0, 21.0)])
def test_one_way_or_one_flank_says_nothing_of_the_delay(missing: tuple[float, float]) -> None:
    samples = ways(25.0, -25.0, delay_s=5e-3)
    assert delay_of([sample for sample in samples if sample.sweep and sample.sweep.speed_deg_s > 0], fitted) is None
    low_deg, high_deg = missing
    half = [
        sample
        for sample in samples
        if not (sample.sweep and sample.sweep.speed_deg_s < 0 and low_deg < sample.angle_deg < high_deg)
    ]
    assert delay_of(half, fitted) is None
    assert delay_of(samples, lambda _: None) is None


def test_pulses_without_light_go_and_no_others_do() -> None:
    samples = ways(25.0, -25.0, delay_s=0.0)
    bright = [index for index, sample in enumerate(samples) if sample.reading.intensity > 20.0]
    inside = bright[3]
    edge = len(samples) // 2 - 1
    for index in (inside, edge):
        samples[index] = structs.replace(samples[index], reading=Reading(intensity=3.0, noise_sigma=1.0, cells=CELLS))
    kept = with_light(samples)
    # Beside the curve all pulses are at the noise, and there none is known to be without light.
    assert kept == [*samples[:inside], *samples[inside + 1 :]]
    unknown = [structs.replace(sample, reading=Reading(intensity=sample.reading.intensity)) for sample in samples]
    assert with_light(unknown) == unknown
    at_rest = [structs.replace(sample, sweep=None) for sample in samples]
    assert with_light(at_rest) == at_rest


def burst(*, late: range = range(0), delay_s: float = 0.0, noise: float = 1.0, seed: int = 0) -> list[Sample]:
    """A burst there and back at 50 Hz over a Gaussian curve about 3 degrees; ``late``: frames of the pulse before."""
    rng = np.random.default_rng(seed)
    there_deg = np.arange(-20.0, 20.0, 0.5)
    angles_deg = [*there_deg, *there_deg[::-1]]
    speeds_deg_s = [25.0] * there_deg.size + [-25.0] * there_deg.size
    made = []
    for index, (angle_deg, speed) in enumerate(zip(angles_deg, speeds_deg_s, strict=True)):
        of = index - (index in late)
        height = float(gaussian(np.array(angles_deg[of] + speeds_deg_s[of] * delay_s), SNR, 3.0))
        reading = Reading(intensity=max(height + noise * rng.standard_normal(), 0.0), noise_sigma=1.0, cells=CELLS)
        timing = SweepTiming(number=1, speed_deg_s=speed, delay_sigma_s=10e-3)
        made.append(Sample(angle_deg=float(angle_deg), reading=reading, sweep=timing))
    return made


def order_in(samples: Sequence[Sample]) -> FrameOrder:
    order = order_of(samples, measured(samples), fitted)
    assert order is not None
    return order


@pytest.mark.parametrize("delay_s", [0.0, 12e-3, -25e-3])
def test_a_delay_leaves_the_flanks_of_a_burst_about_one_centre(delay_s: float) -> None:
    orders = [order_in(burst(delay_s=delay_s, seed=seed)) for seed in range(40)]
    off = [order.apart_deg / order.apart_sigma_deg for order in orders]
    assert abs(np.mean(off)) < 0.5
    # Samples are never negative, which narrows the scatter that the fit sees; a delay widens it.
    assert 0.4 < np.std(off) < 1.6
    assert orders[0].frame_deg == pytest.approx(0.5, rel=1e-6)
    assert orders[0].period_s == pytest.approx(20e-3, rel=1e-6)


@pytest.mark.parametrize(
    ("late", "apart_deg"),
    [(range(20, 46), 0.25), (range(46, 80), -0.25), (range(46, 115), -0.5), (range(115, 150), 0.25)],
)
def test_frames_that_are_late_on_some_flanks_alone_move_these_apart(late: range, apart_deg: float) -> None:
    """A trigger is lost on one flank, and one is doubled on another: the marker is passed at pulses 46 and 113."""
    order = order_in(burst(late=late, noise=0.0))
    assert order.apart_deg == pytest.approx(apart_deg, abs=0.08)
    noisy = [order_in(burst(late=late, seed=seed)) for seed in range(10)]
    shift_deg = abs(apart_deg) / 2
    # Refused, or the error is in the interval.
    assert all(order.contradictory or 2.5 * order.flank_sigma_deg > shift_deg for order in noisy)


@pytest.mark.parametrize(("late", "true_s"), [(range(10, 78), 0.0), (range(10, 78), -12e-3), (range(82, 150), 9e-3)])
def test_one_way_that_is_late_looks_like_a_delay_and_widens_the_interval_by_its_probability(
    late: range, true_s: float
) -> None:
    order = order_in(burst(late=late, delay_s=true_s, noise=0.01))
    assert not order.contradictory
    # Late frames show earlier angles, as if the light came before its stamp; half of that each way.
    half_s = 10e-3
    assert order.delay.measured_s == pytest.approx(true_s - half_s, abs=1.1e-3)
    none, early, late_by_one = (norm.pdf(order.delay.measured_s + each, scale=10e-3) for each in (0, -half_s, half_s))
    shifted = 0.05 * (early + late_by_one)
    assert order.way_sigma_deg == pytest.approx(0.25 * np.sqrt(shifted / (shifted + none)), rel=0.02)


def test_a_burst_of_a_rig_that_knows_its_delay_is_no_wider() -> None:
    samples = burst()
    known = [
        structs.replace(each, sweep=structs.replace(each.sweep, delay_sigma_s=1e-3)) for each in samples if each.sweep
    ]
    assert order_in(known).way_sigma_deg < 1e-3 < order_in(samples).way_sigma_deg
