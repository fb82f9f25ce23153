"""The detection threshold, the evidence, and the answers of the checked form; the catalogue of methods."""

from __future__ import annotations

import math

import numpy as np
import pytest

from markerseek.core import (
    AtBound,
    ConfigError,
    Floor,
    Found,
    NotFound,
    Reading,
    Sample,
    SearchError,
    SearchPlan,
    Tolerance,
    Unsure,
)
from markerseek.search import (
    GOLDEN,
    METHODS,
    BracketSearch,
    build,
    method_named,
    noise_of,
)
from markerseek.search.evidence import inconsistency, why_not_detected
from markerseek.search.floor import FEWEST_CELLS, MAX_CELLS, SearchNoise, noise_factor

ALL = [method.name for method in METHODS]
PUBLISHED = [name for name in ALL if name != "posterior"]


def sample(angle_deg, intensity, **reading):
    return Sample(angle_deg=angle_deg, reading=Reading(intensity=intensity, **reading))


def dark(intensity, **reading):
    return Sample(angle_deg=0.0, reading=Reading(intensity=intensity, **reading), dark=True)


def lorentzian(marker_deg, fwhm_deg=6.0, height=1.0):
    return lambda angle_deg: height / (1 + (2 * (angle_deg - marker_deg) / fwhm_deg) ** 2)


def run(policy, curve, *, darks=(), **reading):
    """Search; each entry of ``reading`` is a function of the angle."""
    for dark in darks:
        policy.tell(dark)
    asked = []
    while (angle_deg := policy.ask()) is not None:
        asked.append(angle_deg)
        policy.tell(sample(angle_deg, float(curve(angle_deg)), **{name: of(angle_deg) for name, of in reading.items()}))
    return asked, policy.estimate()


DARKS = [dark(0.04, noise_sigma=0.01, cells=12_800)] * 3


class TestFloor:
    def test_threshold_of_the_safety_notes(self):
        assert noise_factor(cells=12_800, frames=15) == pytest.approx(6.2, abs=0.05)

    def test_dark_frames_with_noise(self):
        noise = noise_of([sample(0.0, 1.0)] * 15, dark=DARKS)
        assert noise.floor.source == "dark frames"
        assert noise.floor.level == pytest.approx(0.01 * noise_factor(cells=12_800, frames=15))
        assert noise.sigma == pytest.approx(0.01)

    def test_dark_frames_with_a_burst_raise_the_floor(self):
        burst = dark(0.5, noise_sigma=0.01, cells=12_800)
        assert noise_of([sample(0.0, 1.0)], dark=[*DARKS, burst]).floor.level == 0.5

    def test_dark_frames_with_an_intensity_only(self):
        noise = noise_of([sample(0.0, 1.0)] * 15, dark=[dark(0.03), dark(0.05), dark(0.04)])
        assert noise.floor.source == "dark frames"
        assert noise.floor.level is not None
        assert 1.5 * 0.05 < noise.floor.level < 2.5 * 0.05

    def test_unknown_cells_are_many(self):
        noise = noise_of([sample(0.0, 1.0)], dark=[dark(0.04, noise_sigma=0.01)])
        assert noise.floor.level == pytest.approx(0.01 * noise_factor(cells=MAX_CELLS, frames=1))

    def test_noise_of_the_frames(self):
        lit = [sample(float(index), 1.0 + index, noise_sigma=0.01, cells=1000) for index in range(5)]
        noise = noise_of(lit)
        assert noise.floor.source == "noise of the frames"
        assert noise.floor.level == pytest.approx(0.01 * noise_factor(cells=1000, frames=5))

    def test_a_burst_raises_its_own_floor(self):
        lit = [sample(float(index), 0.04, noise_sigma=0.01, cells=1000) for index in range(5)]
        noise = noise_of([*lit, sample(6.0, 2.0, noise_sigma=0.5, cells=1000)])
        assert noise.sigma == 0.5

    def test_one_silent_frame_leaves_the_noise_unknown(self):
        lit = [sample(float(index), 1.0, noise_sigma=0.01) for index in range(5)]
        assert noise_of([*lit, sample(6.0, 2.0)]).floor.source == "unknown"

    @pytest.mark.parametrize(("angles", "source"), [(11, "unknown"), (12, "lower quartile")])
    def test_lower_quartile_needs_12_angles(self, angles, source):
        lit = [sample(float(index), 1.0 + 0.1 * index) for index in range(angles)]
        assert noise_of(lit).floor.source == source
        assert (noise_of(lit).floor.level is None) == (source == "unknown")

    def test_amounts_of_normal_noise_stay_below_the_floor(self):
        """Those of a file are no maxima of images: their largest is eight times their quartile."""
        rng = np.random.default_rng(3)
        files = [np.abs(rng.normal(size=60)) for _ in range(400)]
        floors = [noise_of([sample(float(k), value) for k, value in enumerate(each.tolist())]) for each in files]
        above = sum(each.max() > noise.floor.level for each, noise in zip(files, floors, strict=True))
        assert above <= 4
        assert np.median([noise.sigma for noise in floors]) == pytest.approx(1.0, abs=0.15)

    def test_the_same_angle_twice_is_one_angle(self):
        assert noise_of([sample(float(index % 11), 1.0) for index in range(22)]).floor.source == "unknown"

    def test_the_quartile_is_of_the_range_and_not_of_the_samples(self):
        """A converged search has most samples on the peak; they stand for a small part of the range."""
        far = [sample(-35.0 + 5 * index, 0.1) for index in range(7)]
        near = [sample(0.01 * index, 1.0 + 0.02 * (index % 2)) for index in range(60)]
        floor = noise_of([*far, *near, sample(20.0, 0.1), sample(35.0, 0.1)]).floor
        expected = (
            0.1 * noise_factor(cells=FEWEST_CELLS, frames=69) / math.sqrt(-2 * math.log(1 - 0.25 ** (1 / FEWEST_CELLS)))
        )
        assert floor.level == pytest.approx(expected)


ANSWERS = {
    "marker": (lorentzian(7.3), Found),
    "no marker": (lambda angle: 0.03 + 0.01 * math.sin(37 * angle), NotFound),
    "zero": (lambda _: 0.0, NotFound),
    "flat background": (lambda _: 1.0, NotFound),
    "flat far field": (lambda angle: 1 + 0.02 * lorentzian(0.0)(angle), NotFound),
    "beyond the low end": (lorentzian(-45.0), AtBound),
    "beyond the high end": (lorentzian(45.0), AtBound),
}


@pytest.mark.parametrize(("curve", "kind"), ANSWERS.values(), ids=ANSWERS.keys())
@pytest.mark.parametrize("name", ALL)
def test_answers(name, curve, kind):
    acquisitions = 28 if name == "golden-section-reuse" else None
    _, estimate = run(build(SearchPlan(method=name, acquisitions=acquisitions)), curve, darks=DARKS)
    assert isinstance(estimate, kind)
    assert estimate.floor is not None
    assert estimate.floor.source == "dark frames"
    if isinstance(estimate, Found):
        assert estimate.mean_deg == pytest.approx(7.3, abs=0.3)
    if isinstance(estimate, AtBound):
        assert estimate.side == ("low" if estimate.mean_deg < 0 else "high")


@pytest.mark.parametrize("name", ALL)
def test_before_the_first_sample(name):
    estimate = build(name).estimate()
    assert isinstance(estimate, NotFound)
    assert "nothing has been measured" in estimate.reason


def test_posterior_was_not_published():
    with pytest.raises(ConfigError, match="leave out as_published"):
        build(SearchPlan(method="posterior", as_published=True))


def test_two_markers_are_no_answer_between_them():
    def both(angle):
        return max(lorentzian(-20.0)(angle), lorentzian(20.0)(angle))

    _, estimate = run(build(SearchPlan(method="weighted-average", early_end=False)), both, darks=DARKS)
    assert isinstance(estimate, Unsure)
    assert estimate.doubt == "source"
    assert "weaker than the one at" in estimate.reason


def test_strong_samples_from_different_places():
    places = {"lateral_m": lambda angle: 1e-2 * math.sin(37 * angle)}
    _, scattered = run(build("weighted-average"), lorentzian(7.3), darks=DARKS, **places)
    assert isinstance(scattered, NotFound)
    assert "different places" in scattered.reason
    _, together = run(build("weighted-average"), lorentzian(7.3), darks=DARKS, lateral_m=lambda _: 0.011)
    assert isinstance(together, Found)


@pytest.mark.parametrize(("elsewhere", "said"), [(4.9, None), (6.4, "the intensity is the same")])
def test_a_weak_peak_is_evidence_beside_noise_but_not_beside_a_background(elsewhere, said):
    """The dark frames say what noise reaches by itself."""
    darks = [dark(intensity, noise_sigma=1.0, cells=100_000) for intensity in (4.6, 5.0, 5.3)]
    lit = [sample(angle, elsewhere, noise_sigma=1.0, cells=100_000) for angle in (-30.0, -10.0, 20.0, 30.0)]
    lit.append(sample(5.0, 8.0, noise_sigma=1.0, cells=100_000))
    missing = why_not_detected(lit, dark=darks, noise=noise_of(lit, dark=darks))
    assert missing is None if said is None else said in missing


def test_coherence_must_exceed_that_of_noise():
    darks = [dark(0.04, noise_sigma=0.01, cells=12_800, coherence=0.1)]
    _, noise = run(build("weighted-average"), lorentzian(7.3), darks=darks, coherence=lambda _: 0.09)
    assert isinstance(noise, NotFound)
    assert "coherent" in noise.reason
    _, marker = run(build("weighted-average"), lorentzian(7.3), darks=darks, coherence=lambda _: 0.6)
    assert isinstance(marker, Found)


@pytest.mark.parametrize(("spread_m", "found"), [(1e-3, True), (8e-3, False)])
def test_a_sound_from_one_place_need_not_be_coherent(spread_m, found):
    """A marker in tissue with another speed of sound; noise would not come from one place again."""
    darks = [dark(0.04, noise_sigma=0.01, cells=12_800, coherence=0.1)]
    places = {"lateral_m": lambda _: 0.01, "depth_m": lambda angle: 0.05 + spread_m * math.sin(37 * angle)}
    _, answer = run(build("weighted-average"), lorentzian(7.3), darks=darks, coherence=lambda _: 0.09, **places)
    assert isinstance(answer, Found) == found


def test_unknown_floor_asks_for_ten_times_the_smallest():
    _, weak = run(build(SearchPlan(method="golden-section", acquisitions=8)), lambda angle: 1 + lorentzian(3.0)(angle))
    assert isinstance(weak, NotFound)
    assert "10 times" in weak.reason
    assert weak.floor is not None
    assert weak.floor.level is None
    _, strong = run(build(SearchPlan(method="golden-section", acquisitions=10)), lorentzian(3.0))
    assert isinstance(strong, Unsure)


@pytest.mark.parametrize(
    ("tolerance", "depth_m", "said"),
    [
        (Tolerance(), None, None),
        (Tolerance(mm=0.1), None, None),
        (Tolerance(deg=0.1), None, "the angle is known to within 0.58 deg, and 0.1 deg are tolerated"),
        (Tolerance(), 0.05, None),
        (Tolerance(mm=0.1), 0.05, "the angle is known to within 0.61 mm at the marker, and 0.1 mm is tolerated"),
    ],
)
def test_the_interval_of_what_is_found_lies_within_the_tolerance(tolerance, depth_m, said):
    """Too few acquisitions are reported, with what would help; where frames say no depth, degrees count."""
    policy = build(
        SearchPlan(method="weighted-average", acquisitions=15, tolerance_mm=tolerance.mm, tolerance_deg=tolerance.deg)
    )
    depth = {} if depth_m is None else {"depth_m": lambda _: depth_m}
    _, estimate = run(policy, lorentzian(7.3, fwhm_deg=4.0), darks=DARKS, **depth)
    if said is None:
        assert isinstance(estimate, Found)
    else:
        assert isinstance(estimate, Unsure)
        assert estimate.doubt == "width"
        assert estimate.reason == f"{said}; more acquisitions, or more pulses in each, reduce it"
    half_deg = estimate.interval95_deg.high_deg - estimate.mean_deg
    radius_m = None if depth_m is None else depth_m + 0.01
    assert estimate.half_width_m == (None if radius_m is None else pytest.approx(radius_m * math.radians(half_deg)))


def test_early_end_waits_for_evidence():
    """A spike below the floor, then silence: the published rule ends there, the checked one continues to the marker."""

    def spike_then_marker(angle):
        return 0.05 if angle == -35 else lorentzian(20.0, fwhm_deg=5.0)(angle) if angle > 5 else 0.001

    published, _ = run(
        build(SearchPlan(method="weighted-average", acquisitions=57, as_published=True)), spike_then_marker
    )
    assert len(published) == 3
    checked, estimate = run(
        build(SearchPlan(method="weighted-average", acquisitions=57)), spike_then_marker, darks=DARKS
    )
    assert 40 < len(checked) < 57
    assert estimate.mean_deg == pytest.approx(20, abs=0.5)


def test_the_inner_answer_is_kept():
    bare = BracketSearch(ratio=GOLDEN, acquisitions=24)
    checked = build(SearchPlan(method="golden-section", acquisitions=24))
    run(bare, lorentzian(7.3))
    _, estimate = run(checked, lorentzian(7.3), darks=DARKS)
    assert estimate.mean_deg == bare.estimate().mean_deg
    assert isinstance(estimate, Found)
    assert estimate.sigma_deg > bare.estimate().sigma_deg


def test_refuses_samples_after_an_early_end_but_accepts_dark_ones():
    policy = build("weighted-average")
    asked, _ = run(policy, lorentzian(-20.0), darks=DARKS)
    assert len(asked) < 57
    policy.tell(DARKS[0])
    with pytest.raises(SearchError, match="over after"):
        policy.tell(sample(0.0, 1.0))


@pytest.mark.parametrize(("wrong", "value"), [("mm", 0.0), ("deg", -1.0), ("mm", math.nan)])
def test_a_tolerance_is_positive(wrong, value):
    with pytest.raises(ConfigError, match=f"tolerance_{wrong} is {value}, it must be a positive number"):
        Tolerance(**{wrong: value})


class TestMethods:
    @pytest.mark.parametrize("acquisitions", [1, 0])
    @pytest.mark.parametrize("name", ALL)
    def test_refuses_fewer_acquisitions_than_the_method_needs(self, name, acquisitions):
        with pytest.raises(ConfigError, match=f"{name}: acquisitions is .*at least {method_named(name).least}"):
            build(SearchPlan(method=name, acquisitions=acquisitions))

    @pytest.mark.parametrize(
        ("wrong", "meant"),
        [("golden", "golden-section"), ("Weighted_Average", "weighted-average"), ("ternery", "ternary")],
    )
    def test_suggests_a_name(self, wrong, meant):
        with pytest.raises(ConfigError, match=f"did you mean {meant}"):
            build(wrong)

    def test_lists_the_names(self):
        with pytest.raises(ConfigError, match=r"'xyz' is unknown; methods are posterior, weighted-average, "):
            build("xyz")

    def test_checked_sweeps_begin_at_the_nearer_end(self):
        assert build(SearchPlan(method="weighted-average", start_deg=20.0)).ask() == 35
        assert build(SearchPlan(method="weighted-average", start_deg=20.0, as_published=True)).ask() == -35
        assert build(SearchPlan(method="manual", start_deg=20.0)).ask() == 35


def test_a_class_of_ones_own_is_no_method_of_a_record_or_a_request():
    with pytest.raises(ConfigError, match="is unknown; a class of your own is taken from who starts a search"):
        method_named("mine:Method")


@pytest.mark.parametrize("intensities", [(1.0, 10.0, 3.0), (10.0, 1.0, 3.0)])
@pytest.mark.parametrize("turned", [1.0, -1.0])
def test_an_answer_at_an_angle_measured_twice_fits_the_stronger_sample(intensities, turned):
    """Neither the order in which the two were taken, nor the side on which the third one lies, matters."""
    lit = [sample(turned * angle_deg, each) for angle_deg, each in zip((0.0, 0.0, 5.0), intensities, strict=True)]
    noise = SearchNoise(floor=Floor(level=None, source="unknown"), sigma=None)
    assert inconsistency(lit, mean_deg=0.0, noise=noise) is None
