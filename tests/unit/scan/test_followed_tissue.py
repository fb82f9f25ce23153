"""Acquisitions while the tissue is followed: light in the pause, and the displacement in every sample."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from markerseek.core import ConfigError, Displacement, FollowedTissue, Permit, RunPlan, Sample, Sweep
from markerseek.scan import run
from tests.unit.scan.breathing_tissue import STILL, BreathingTissue
from tests.unit.scan.scan_bench import Bench, Tour, scanner
from tests.unit.scan.sweep_bench import SweepBench


@dataclass
class Lasting(Bench):
    """A bench whose pulses take time, and which notes when it was lit."""

    lit_s: list[tuple[float, float]] = field(default_factory=list)

    def fire(self, permit: Permit) -> int:
        began_s = self.time_s
        self.time_s += 0.05 * permit.pulses
        if permit.pulses:
            self.lit_s.append((began_s, self.time_s))
        return super().fire(permit)


def test_once_the_length_of_an_acquisition_is_known_all_of_its_light_is_in_the_pause() -> None:
    bench = Lasting()
    tissue = BreathingTissue(bench)
    assert isinstance(tissue, FollowedTissue)
    tour = Tour(*np.linspace(-30.0, 30.0, 7).tolist())
    list(run(tour, scanner(bench), RunPlan(stay=True), tissue=tissue))
    assert len(bench.lit_s) == 7
    for began_s, ended_s in bench.lit_s[1:]:
        assert tissue.way_mm(began_s) == tissue.way_mm(ended_s) == 0.0
        assert ended_s - began_s == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("changes", "most_s"),
    [
        ({"breath_s": None}, 0.0),
        ({"unknown": (0.0, 1e9)}, 0.0),
        # Never long enough: the light comes after two breaths, at rest or not.
        ({"pause_s": -1.0, "breath_s": 5.0}, 10.0 + 0.05),
    ],
)
def test_no_acquisition_waits_where_no_pause_is_known_nor_for_more_than_two_breaths(
    changes: dict[str, object], most_s: float
) -> None:
    bench = Lasting()
    tissue = BreathingTissue(bench, **changes)  # type: ignore[arg-type]
    list(run(Tour(1.0), scanner(bench), RunPlan(stay=True), tissue=tissue))
    ((began_s, _),) = bench.lit_s
    assert most_s - 0.05 <= began_s - 1.0 <= most_s + 1e-9


def test_a_dark_frame_does_not_wait_and_has_no_displacement() -> None:
    bench = Lasting()
    tour = Tour(1.0)
    list(run(tour, scanner(bench), RunPlan(dark_frames=1, stay=True), tissue=BreathingTissue(bench)))
    dark, lit = tour.samples
    assert dark.displacement is None
    assert lit.displacement is not None


def test_an_acquisition_that_breathes_has_the_mean_displacement_of_its_pulses() -> None:
    bench = Lasting()
    tissue = BreathingTissue(bench, breath_s=None)
    tour = Tour(1.0, 2.0, 3.0, 4.0)
    list(run(tour, scanner(bench), RunPlan(stay=True), tissue=tissue))
    for sample, (began_s, ended_s) in zip(tour.samples, bench.lit_s, strict=True):
        assert sample.displacement is not None
        mean_mm = np.mean([tissue.way_mm(each) for each in np.linspace(began_s, ended_s, 2001).tolist()])
        assert sample.displacement.mm == pytest.approx((mean_mm, 0.0, 0.0), abs=0.06)
        np.testing.assert_allclose(sample.displacement.covariance_mm2, STILL)


def test_a_displacement_that_is_not_known_all_the_time_is_not_known() -> None:
    bench = Lasting()
    tour = Tour(1.0)
    list(run(tour, scanner(bench), RunPlan(stay=True), tissue=BreathingTissue(bench, None, unknown=(1.7, 1e9))))
    assert tour.samples[0].displacement is None


def swept(bench: SweepBench, tissue: BreathingTissue, sweep: Sweep) -> list[Sample]:
    return [each for each in bench.scanner.take(sweep, tissue=tissue) if isinstance(each, Sample)]


@pytest.mark.parametrize("readout_s", [0.0, 10.0])
def test_each_pulse_of_a_sweep_has_the_displacement_of_its_own_moment(readout_s: float) -> None:
    bench = SweepBench(readout_s=readout_s)
    tissue = BreathingTissue(bench.rig.scanner.clock)
    samples = swept(bench, tissue, Sweep(to_deg=35.0, speed_deg_s=10.0))
    flashes = bench.flashes()
    assert len(samples) == len(flashes) > 100
    for sample, flash in zip(samples, flashes, strict=True):
        assert sample.displacement is not None
        assert sample.displacement.mm[0] == pytest.approx(tissue.way_mm(flash.at_s), abs=0.01)


def test_a_wait_that_ends_a_rounding_error_early_loses_no_pulse() -> None:
    bench = SweepBench()

    class Rounded(BreathingTissue):
        """What is asked later is known a rounding error later."""

        asked = 0

        def __getattribute__(self, name: str) -> object:
            if name != "known_after_s":
                return object.__getattribute__(self, name)
            Rounded.asked += 1
            return 0.2 + 1e-13 * Rounded.asked

    samples = swept(bench, Rounded(bench.rig.scanner.clock), Sweep(to_deg=35.0, speed_deg_s=10.0))
    assert len(samples) == len(bench.flashes()) > 100


def test_a_sweep_that_fits_into_a_pause_is_made_in_one_and_a_longer_one_does_not_wait() -> None:
    bench = SweepBench(start_deg=0.0)
    clock = bench.rig.scanner.clock
    tissue = BreathingTissue(clock)
    samples = swept(bench, tissue, Sweep(to_deg=8.0, speed_deg_s=12.0))
    assert len(samples) > 10
    assert {sample.displacement.mm[0] for sample in samples if sample.displacement is not None} == {0.0}
    began_s = clock.now_s()
    swept(bench, tissue, Sweep(to_deg=35.0, speed_deg_s=12.0))
    assert clock.now_s() - began_s < 5.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mm": (0.0, float("nan"), 0.0)}, "its numbers must be finite"),
        ({"covariance_mm2": ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0))}, "variance along y is -1.0 mm²"),
    ],
)
def test_a_displacement_that_is_none_is_refused(changes: dict[str, object], message: str) -> None:
    values: dict[str, object] = {"mm": (0.0, 0.0, 0.0), "covariance_mm2": STILL}
    with pytest.raises(ConfigError, match=message):
        Displacement(**values | changes)  # type: ignore[arg-type]
