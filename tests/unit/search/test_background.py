"""Tables of intensities on a background, with outliers, and with answers that contradict the samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.core import Found, Interval, Reading, Sample, SearchPlan, Unsure
from markerseek.search import build, noise_of
from markerseek.search.recording import contradiction

CURVES = {
    "Gaussian": lambda t, width: np.exp(-((t / width) ** 2) / 2),
    "with side lobes": lambda t, width: np.abs(np.sinc(t / (2 * width))),
    "pointed": lambda t, width: np.exp(-0.9 * np.abs(t) / width),
    "with tails": lambda t, width: 1 / (1 + (t / (1.2 * width)) ** 2),
    "lopsided": lambda t, width: np.exp(-((t / np.where(t < 0, 0.92 * width, 1.08 * width)) ** 2) / 2),
}


def samples(angles_deg, intensities):
    return [
        Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity))
        for angle_deg, intensity in zip(np.asarray(angles_deg).tolist(), np.asarray(intensities).tolist(), strict=True)
    ]


def answers(angles_deg, intensities):
    """What a search of a table says, and all of its angles together."""
    lit = {each.angle_deg: each for each in samples(angles_deg, intensities)}
    plan = SearchPlan(method="posterior", angles_deg=tuple(lit), whole=True)
    policy = build(plan, limits=Interval(low_deg=min(lit), high_deg=max(lit)))
    while (angle_deg := policy.ask()) is not None:
        policy.tell(lit[angle_deg])
    return policy.searched.estimate, policy.estimate()


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize(
    ("level", "slope", "scatter"),
    [(0.35, 0.0, 0.004), (0.3, 0.35, 0.01), (0.45, -0.2, 0.015)],
    ids=["even", "rising", "high and falling"],
)
def test_a_marker_is_found_on_a_background(curve, level, slope, scatter):
    """The background has three times as many samples as the marker, and they must not outvote it."""
    rng = np.random.default_rng(11)
    angles_deg = np.arange(-33.0, 33.1, 0.75)
    for marker_deg, width_deg in ((13.3, 2.2), (-6.1, 3.7)):
        background = level * (1 + slope * angles_deg / 33)
        intensities = background + (1 - level) * CURVES[curve](angles_deg - marker_deg, width_deg)
        intensities *= 730 * (1 + scatter * rng.normal(size=angles_deg.size))
        search, answer = answers(angles_deg, intensities)
        assert isinstance(answer, Found)
        assert answer.mean_deg == pytest.approx(marker_deg, abs=0.6)
        assert not isinstance(search, Found) or search.mean_deg == pytest.approx(marker_deg, abs=1.0)


def test_no_answer_is_far_from_the_marker():
    """Whatever level, slope, scatter, step, width and second peak a table has."""
    found = 0
    for seed in range(15):
        rng = np.random.default_rng(seed)
        angles_deg = np.arange(-35.0, 35.1, rng.choice([0.5, 1.0, 2.0]))
        marker_deg = rng.uniform(-24, 24)
        width_deg = rng.uniform(1.2, 5.5)
        level = rng.choice([0.0, 0.1, 0.25, 0.4, 0.6])
        scatter = math.exp(rng.uniform(math.log(0.002), math.log(0.1)))
        curve = CURVES[rng.choice(list(CURVES))]
        intensities = level * (1 + rng.uniform(-0.4, 0.4) * angles_deg / 35)
        intensities = intensities + (1 - level) * curve(angles_deg - marker_deg, width_deg)
        if seed % 5 == 0:
            intensities += 0.5 * (1 - level) * curve(angles_deg + math.copysign(14, marker_deg) - marker_deg, width_deg)
        intensities = np.abs(intensities * (1 + scatter * rng.normal(size=angles_deg.size)) + 0.003)
        for answer in answers(angles_deg, 41 * intensities):
            if isinstance(answer, Found):
                found += 1
                assert answer.mean_deg == pytest.approx(marker_deg, abs=1.0), seed
    assert found > 12


def test_noise_alone_on_a_level_is_no_marker():
    rng = np.random.default_rng(5)
    angles_deg = np.arange(-30.0, 30.1, 1.0)
    for _ in range(5):
        _, answer = answers(angles_deg, 500 + 4 * rng.normal(size=angles_deg.size))
        assert not isinstance(answer, Found)


@pytest.mark.parametrize("samples_", [12, 40, 150])
def test_noise_on_a_level_seldom_exceeds_the_threshold(samples_):
    """Of maxima of images, whose tail is the longest."""
    rng = np.random.default_rng(7)
    tables = 100 + rng.gumbel(size=(1000, samples_))
    noises = [noise_of(samples(np.arange(samples_) / 2, each)) for each in tables]
    above = sum(each.max() > noise.floor.level for each, noise in zip(tables, noises, strict=True))
    assert above <= 3


def test_a_level_that_noise_explains_is_no_background():
    rng = np.random.default_rng(3)
    angles_deg = np.arange(-35.0, 35.1, 0.5)
    for intensities in (np.abs(rng.normal(size=141)), rng.rayleigh(size=(300, 141)).max(axis=0)):
        assert noise_of(samples(angles_deg, intensities)).floor.background is None


@pytest.mark.parametrize("marker_deg", [-20.0, 3.0, 27.0])
@pytest.mark.parametrize(("fwhm_deg", "tail"), [(14, 2), (24, 2), (30, 1.4)])
def test_the_tails_of_a_wide_curve_are_no_background(marker_deg, fwhm_deg, tail):
    """Without them the ends of the range would cut the curve, and move it."""
    angles_deg = np.arange(-35.0, 35.1, 1.0)
    lit = samples(angles_deg, 60 * (1 + (2 * (angles_deg - marker_deg) / fwhm_deg) ** 2) ** (-tail / 2))
    assert noise_of(lit).floor.background is None
    _, answer = answers(angles_deg, [each.reading.intensity for each in lit])
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(marker_deg, abs=0.3)


@pytest.mark.parametrize("outlier_deg", [-21.0, 4.0, 10.5])
@pytest.mark.parametrize("height", [4e3, 3e6])
def test_an_outlier_is_left_out_and_said(outlier_deg, height):
    """Beside the marker, on its flank and on its top: it sets no scale for the others."""
    rng = np.random.default_rng(2)
    angles_deg = np.arange(-30.0, 30.1, 0.5)
    intensities = 12 + 900 * CURVES["with tails"](angles_deg - 10.2, 2.6) + rng.normal(size=angles_deg.size)
    intensities[angles_deg == outlier_deg] = height
    _, answer = answers(angles_deg, intensities)
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(10.2, abs=0.3)
    assert answer.outliers_deg == (outlier_deg,)


def test_one_strong_sample_of_a_coarse_table_is_neither_left_out_nor_outvoted():
    """A narrow marker may be seen once: then the others claim nothing."""
    angles_deg = np.arange(-30.0, 30.1, 2.0)
    intensities = 5 + 200 * CURVES["Gaussian"](angles_deg + 8.4, 3.0) + 0.1 * np.cos(7 * angles_deg)
    intensities[angles_deg == 16.0] = 5e4
    _, answer = answers(angles_deg, intensities)
    assert not isinstance(answer, Found)
    assert answer.outliers_deg == ()


def test_a_search_and_all_angles_do_not_contradict_each_other():
    def found(mean_deg, half_deg):
        interval = Interval(low_deg=mean_deg - half_deg, high_deg=mean_deg + half_deg)
        return Found(mean_deg=mean_deg, sigma_deg=half_deg / 2, interval95_deg=interval, interval_kind="posterior")

    reason = contradiction(found(3.0, 0.4), found(-4.0, 0.5))
    assert reason is not None
    assert "3.00 deg" in reason
    assert "-4.00 deg" in reason
    assert contradiction(found(3.0, 0.4), found(3.9, 0.2)) is None
    assert contradiction(found(3.0, 0.4), found(5.0, 2.0)) is None
    assert contradiction(found(3.0, 0.4), found(-4.0, 0.5).as_unsure("width", "wide")) is None
    assert isinstance(found(3.0, 0.4).as_unsure("source", reason), Unsure)
