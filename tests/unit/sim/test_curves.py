"""Intensity curves and their simulated world: against closed forms and SciPy, as devices and in searches."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize, stats
from scipy.interpolate import PchipInterpolator

from markerseek import rigs
from markerseek.contract import ReceiverContract
from markerseek.core import (
    ConfigError,
    Finished,
    FrameHeader,
    Laser,
    NotFound,
    Receiver,
    SearchPlan,
)
from markerseek.scan import run
from markerseek.search import build
from markerseek.sim import (
    CurveWorld,
    Flash,
    GaussianCurve,
    IntensityCurve,
    LaserSettings,
    MarkerSettings,
    NoiseSettings,
    PowerCurve,
    RecordedCurve,
    SechCurve,
    SimulatedLaser,
    SimulatedReceiver,
    SimulatedSettings,
    VirtualClock,
)
from markerseek.sim.curves import largest_noise

HEADER = FrameHeader(sequence=1, token="t", pulses=1, commanded_deg=0.0, started_s=0.0, ended_s=0.0)
FLASH = Flash(at_s=0.0, pulses=1, energy=1.0)
CLOSED: dict[str, IntensityCurve] = {
    "gaussian": GaussianCurve(fwhm_deg=7.0),
    "sech": SechCurve(fwhm_deg=7.0),
    "lorentz": PowerCurve(fwhm_deg=7.0, power=2.0),
    "edge waves": PowerCurve(fwhm_deg=7.0, power=1.0),
}


def world(curve: IntensityCurve | None, *, peak: float = 100.0) -> CurveWorld:
    settings = SimulatedSettings(
        noise=NoiseSettings(peak_snr_db=20 * math.log10(peak)),
        laser=LaserSettings(energy_jitter=0.0, pulses=FLASH.pulses),
    )
    return CurveWorld(settings, curve=curve, marker_deg=0.0, cells=460_000, rng=np.random.default_rng(1))


@pytest.mark.parametrize("name", CLOSED)
def test_a_closed_form_is_one_on_the_marker_even_and_half_at_half_its_width(name: str) -> None:
    curve = CLOSED[name]
    half = optimize.brentq(lambda t: curve.peaks(t)[0] - 0.5, 0, 30)
    assert 2 * half == pytest.approx(7.0)
    assert curve.peaks(0.0)[0] == 1.0
    assert curve.peaks(-3.1) == curve.peaks(3.1)


def test_the_tails_fall_as_they_are_named() -> None:
    t = 1000.0
    assert PowerCurve(fwhm_deg=5.0, power=1.5).peaks(t)[0] == pytest.approx((2 * t / 5) ** -1.5, rel=1e-3)
    assert SechCurve(fwhm_deg=5.0).peaks(40.0)[0] == pytest.approx(2 * math.exp(-16 * math.acosh(2)), rel=1e-6)
    assert SechCurve(fwhm_deg=0.001).peaks(80.0)[0] < 1e-300
    assert GaussianCurve(fwhm_deg=5.0).peaks(10.0)[0] == pytest.approx(2.0**-16)


@given(st.floats(-45, 45))
def test_a_recorded_curve_is_monotone_cubic_between_its_angles(t: float) -> None:
    angles = np.array([-40.0, -10, -3, 0, 2, 9, 41])
    heights = np.array([[0.0, 0.0], [0.1, 0.05], [0.5, 0.4], [1.0, 0.9], [0.6, 0.6], [0.2, 0.0], [0.01, 0.0]])
    inside = min(max(t, -40.0), 41.0)
    assert RecordedCurve(angles, heights).peaks(t) == pytest.approx(
        PchipInterpolator(angles, heights)(inside), abs=1e-4
    )


@pytest.mark.parametrize(
    ("angles", "heights", "message"),
    [
        ([0.0], [[1.0]], "at least two angles"),
        ([0.0, 0.0], [[1.0], [1.0]], "each above the one before"),
        ([0.0, math.nan], [[1.0], [1.0]], "each above the one before"),
        ([0.0, 1.0], [[1.0]], r"shape \(1, 1\)"),
        ([0.0, 1.0], [[1.0], [-0.1]], "not negative"),
    ],
)
def test_a_recording_that_is_no_curve_is_refused(angles: list[float], heights: list[list[float]], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        RecordedCurve(np.array(angles), np.array(heights))


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_widths_powers_and_levels_that_cannot_be_are_refused(value: float) -> None:
    for make in (
        lambda: GaussianCurve(fwhm_deg=value),
        lambda: SechCurve(fwhm_deg=value),
        lambda: PowerCurve(fwhm_deg=5.0, power=value),
    ):
        with pytest.raises(ConfigError, match="must lie"):
            make()


def test_a_strong_peak_is_distributed_as_a_noncentral_chi_of_two_places_and_two_quadratures() -> None:
    strong = world(GaussianCurve(fwhm_deg=7.0), peak=15.0)
    drawn = np.array([strong.frame(FLASH, header=HEADER).intensity for _ in range(4000)])
    assert stats.kstest(drawn**2, stats.ncx2(4, 15.0**2).cdf).pvalue > 0.01


def test_the_largest_noise_is_distributed_as_peaks_above_a_level_are_counted() -> None:
    silent = world(None)
    drawn = np.array([silent.frame(FLASH, header=HEADER).intensity for _ in range(4000)])
    rate = 0.55 * 460_000 / (2 * math.log(460_000 / 1e-3) - 1)
    assert stats.kstest(drawn, lambda u: np.exp(-rate * (u**2 - 1) * np.exp(-(u**2) / 2))).pvalue > 0.01


@pytest.mark.parametrize("cells", [10, 100, 300])
def test_the_least_noise_of_a_small_image_is_that_of_independent_cells_and_never_the_same(cells: int) -> None:
    rng = np.random.default_rng(1)
    drawn = np.array([largest_noise(rng, cells=cells) for _ in range(20_000)])
    assert np.unique(drawn).size == drawn.size
    assert drawn.min() > 0
    rate = 0.55 * cells / (2 * math.log(cells / 1e-3) - 1)
    share = math.exp(-1.5)
    low = drawn[drawn < math.sqrt(3)]
    assert stats.binomtest(low.size, drawn.size, math.exp(-2 * rate * share)).pvalue > 0.01
    independent = -2 * rate * share / math.log(1 - share)
    assert stats.kstest(low, lambda u: ((1 - np.exp(-(u**2) / 2)) / (1 - share)) ** independent).pvalue > 0.01


def test_two_equal_peaks_are_stronger_than_one_and_scatter_less() -> None:
    """The largest of two independent normals has the mean 1/sqrt(pi) and the variance 1 - 1/pi."""
    angles = np.array([-1.0, 1.0])
    both = world(RecordedCurve(angles, np.ones((2, 2))), peak=1000.0)
    drawn = np.array([both.frame(FLASH, header=HEADER).intensity for _ in range(4000)]) - 1000
    assert drawn.mean() == pytest.approx(1 / math.sqrt(math.pi), abs=0.05)
    assert drawn.std() == pytest.approx(math.sqrt(1 - 1 / math.pi), abs=0.04)


def test_without_a_marker_a_checked_search_finds_nothing_and_there_is_no_truth() -> None:
    rig = rigs.of_intensities(seed=1, curve=None, marker_deg=0.0)
    *_, last = run(build(SearchPlan(method="weighted-average", acquisitions=29)), rig.scanner, rig.run_plan)
    assert rig.facts.truth_deg is None
    assert isinstance(last, Finished)
    assert isinstance(last.estimate, NotFound)
    assert last.estimate.floor is not None
    assert last.estimate.floor.source == "dark frames"
    hidden = SimulatedSettings(marker=MarkerSettings(present=False))
    rig = rigs.of_intensities(seed=1, curve=SechCurve(fwhm_deg=5.0), marker_deg=0.0, settings=hidden)
    assert rig.facts.truth_deg is None


def test_the_energy_jitter_of_the_settings_reaches_the_intensities() -> None:
    steady, shaky = (
        rigs.of_intensities(
            seed=1,
            curve=SechCurve(fwhm_deg=8.0),
            marker_deg=0.0,
            settings=SimulatedSettings(
                noise=NoiseSettings(peak_snr_db=80.0), laser=LaserSettings(energy_jitter=jitter, pulses=4)
            ),
        )
        for jitter in (0.0, 0.1)
    )
    scatter = [np.std([rig.scanner.measure(0.0).reading.intensity for _ in range(200)]) for rig in (steady, shaky)]
    assert scatter[0] == pytest.approx(1.0, rel=0.2)
    assert scatter[1] == pytest.approx(0.05 * 10**4, rel=0.2)


class TestReceiver(ReceiverContract):
    def make(self) -> tuple[Receiver, Laser]:
        around = world(SechCurve(fwhm_deg=5.0))
        clock = VirtualClock()
        return SimulatedReceiver(world=around, clock=clock, readout_s=0.1), SimulatedLaser(world=around, clock=clock)
