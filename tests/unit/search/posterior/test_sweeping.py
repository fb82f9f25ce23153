"""The policy that sweeps: what it asks for, when it ends a sweep, and what it does where sweeps are not enough."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from markerseek.core import (
    PAPER_RANGE,
    AnglePrior,
    ConfigError,
    Found,
    Interval,
    NotFound,
    Reading,
    Sample,
    SearchError,
    SearchPlan,
    Sweep,
    SweepTiming,
)
from markerseek.search import build, build_sweeping, most_acquisitions, require_sweeping
from markerseek.search.posterior import SweepPosterior

SNR = 50.0
CELLS = 100_000
SPEED = 12.5
NEAR = AnglePrior(mean_deg=-10.0, sigma_deg=2.0)
"""Its window is that from -21 to 1 degrees."""


def curve_about(marker_deg: float, *, snr: float = 40.0, fwhm_deg: float = 4.0) -> Callable[[float], float]:
    def height(angle_deg: float) -> float:
        return snr / (1 + (2 * (angle_deg - marker_deg) / fwhm_deg) ** 2) ** 0.75

    return height


class Search:
    """A policy, and a rig without time: a sample each 0.6 degrees of a sweep, three pulses late when it is ended.

    ``dark_deg``: how long before its end the light of a sweep goes out. ``delay_s``: time from a stamp to its light;
    ``sigma_s``: standard deviation to which the rig knows it as 0.
    """

    def __init__(
        self,
        curve: Callable[[float], float],
        *,
        start_deg: float = -35.0,
        seed: int = 1,
        others: float = 0.05,
        dark_deg: float = 0.0,
        from_end: bool = False,
        delay_s: float = 0.0,
        sigma_s: float = 5e-3,
        near: AnglePrior | None = None,
    ) -> None:
        self.dark_deg = dark_deg
        self.delay_s = delay_s
        self.sigma_s = sigma_s
        plan = SearchPlan(
            method="posterior",
            start_deg=start_deg,
            others=others,
            near=near,
            sweep_speed_deg_s=SPEED,
            sweep_from_end=from_end,
        )
        policy = build_sweeping(plan, limits=PAPER_RANGE)
        assert isinstance(policy, SweepPosterior)
        self.policy = policy
        self.place_deg = start_deg
        self.rng = np.random.default_rng(seed)
        self.curve = curve
        self.sweeps: list[tuple[float, float]] = []
        self.swept_deg: list[float] = []
        self.stops: list[float] = []

    def sample(self, angle_deg: float, *, timing: SweepTiming | None = None) -> Sample:
        sigma = 1.0 if timing is not None else 0.25
        energy = 1 + 0.1 * self.rng.standard_normal() * (1 if timing is not None else 0.25)
        noise = sigma * np.sqrt(2 * np.log(CELLS) + 2 * self.rng.standard_exponential())
        later_deg = 0.0 if timing is None else timing.speed_deg_s * self.delay_s
        height = energy * self.curve(angle_deg + later_deg) + sigma * self.rng.standard_normal()
        reading = Reading(intensity=float(max(height, noise)), noise_sigma=sigma, cells=CELLS)
        return Sample(angle_deg=angle_deg, reading=reading, sweep=timing, angle_sigma_deg=0.02 * (timing is not None))

    def sweep(self, sweep: Sweep) -> None:
        if sweep.from_deg is not None:
            self.place_deg = sweep.from_deg
        began_deg = self.place_deg
        left = 3
        for to_deg in (sweep.to_deg, sweep.back_deg):
            if to_deg is None or left == 0:
                break
            sign = np.sign(to_deg - self.place_deg)
            timing = SweepTiming(
                number=len(self.sweeps) + 1, speed_deg_s=float(sweep.speed_deg_s * sign), delay_sigma_s=self.sigma_s
            )
            step_deg = sign * 0.6 * sweep.speed_deg_s / SPEED
            angles = np.arange(self.place_deg + step_deg / 2, to_deg - sign * self.dark_deg, step_deg).tolist()
            for angle_deg in angles:
                self.policy.tell(self.sample(angle_deg, timing=timing))
                self.place_deg = angle_deg
                self.swept_deg.append(angle_deg)
                left -= self.policy.ask() != sweep
                if left == 0:
                    break
        self.policy.end_sweep()
        self.sweeps.append((began_deg, self.place_deg))

    def run(self) -> None:
        for _ in range(40):
            asked = self.policy.ask()
            if asked is None:
                return
            if isinstance(asked, Sweep):
                self.sweep(asked)
            else:
                self.stops.append(asked)
                self.place_deg = asked
                self.policy.tell(self.sample(asked))
        raise AssertionError("the search does not end")


def test_it_sweeps_to_the_far_end_where_a_stronger_source_may_be() -> None:
    search = Search(curve_about(-10.0))
    assert search.policy.ask() == Sweep(to_deg=35.0, speed_deg_s=SPEED)
    search.run()
    (_, ended_deg), (_, back_deg) = search.sweeps
    assert ended_deg == pytest.approx(35.0, abs=1.0)
    # The way back, over both flanks, says whether the frames are of their pulses.
    assert -16.0 < back_deg < -10.0 - 0.5 * 4.0
    assert search.stops == []
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(-10.0, abs=0.4)


@pytest.mark.parametrize("start_deg", [-35.0, 35.0])
def test_where_there_is_only_one_source_a_sweep_ends_once_the_marker_is_known(start_deg: float) -> None:
    search = Search(curve_about(-10.0), start_deg=start_deg, others=0.0)
    search.run()
    (_, ended_deg), (began_deg, _) = search.sweeps
    assert began_deg == ended_deg
    passed_deg = (ended_deg + 10.0) * (-1 if start_deg > 0 else 1)
    # Both flanks are swept, and not much more.
    assert 0.8 * 4.0 < passed_deg < 15.0
    assert search.stops == []
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(-10.0, abs=0.4)


@pytest.mark.parametrize(
    ("start_deg", "ends_deg"), [(-35.0, [35]), (10.0, [35, -35]), (-1.0, [-35, 35]), (34.6, [-35])]
)
def test_it_begins_with_the_nearer_end(start_deg: float, ends_deg: list[int]) -> None:
    search = Search(lambda _: 0.0, start_deg=start_deg)
    search.run()
    swept = [round(to_deg) for _, to_deg in search.sweeps]
    # And once more over the range, for nothing shows.
    assert swept == pytest.approx([*ends_deg, -ends_deg[-1]], abs=1)


@pytest.mark.parametrize("from_end", [False, True])
@pytest.mark.parametrize(("start_deg", "from_deg"), [(-35.0, -21.0), (35.0, 1.0)])
def test_with_a_prior_it_turns_to_the_nearer_end_of_the_window_and_sweeps_that(
    start_deg: float, from_deg: float, from_end: bool
) -> None:
    search = Search(curve_about(-11.0), start_deg=start_deg, from_end=from_end, near=NEAR)
    asked = search.policy.ask()
    to_deg = -20.0 - from_deg
    assert isinstance(asked, Sweep)
    assert (asked.from_deg, asked.to_deg) == (from_deg, to_deg)
    assert (asked.back_deg, asked.wait_deg) == ((from_deg, -10.0) if from_end else (None, None))
    search.run()
    assert all(-22.0 < angle_deg < 2.0 for angle_deg in search.swept_deg)
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(-11.0, abs=0.4)
    evidence = search.policy.near_evidence
    assert evidence is not None
    assert evidence.probability > 0.9
    assert not evidence.whole_range


@pytest.mark.parametrize(("marker_deg", "from_end"), [(4.0, False), (20.0, False), (-30.0, True)])
def test_where_the_prior_is_wrong_the_whole_range_is_swept(marker_deg: float, from_end: bool) -> None:
    search = Search(curve_about(marker_deg), from_end=from_end, near=NEAR)
    search.run()
    assert min(search.swept_deg) < -34.0
    assert max(search.swept_deg) > 34.0
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert answer.mean_deg == pytest.approx(marker_deg, abs=0.4)
    # As safe as a search without a prior.
    assert answer.surveyed == pytest.approx(1.0, abs=0.06)
    evidence = search.policy.near_evidence
    assert evidence is not None
    assert evidence.probability < 1e-3
    assert evidence.whole_range


def test_where_nothing_is_in_the_window_nor_elsewhere_it_ends_at_rest_as_without_a_prior() -> None:
    search = Search(lambda _: 0.0, near=NEAR)
    search.run()
    assert isinstance(search.policy.estimate(), NotFound)
    # Stops are spread over the whole range.
    assert min(search.stops) < -30.0
    assert max(search.stops) > 30.0
    assert len(search.stops) == 16


def test_a_prior_as_wide_as_the_range_changes_no_sweep() -> None:
    wide = AnglePrior(mean_deg=0.0, sigma_deg=20.0)
    assert Search(curve_about(-11.0), near=wide).policy.sweeps == Search(curve_about(-11.0)).policy.sweeps


def test_a_narrow_range_is_swept_whole() -> None:
    plan = SearchPlan(method="posterior", start_deg=1.4, sweep_speed_deg_s=SPEED)
    policy = build_sweeping(plan, limits=Interval(low_deg=0.0, high_deg=2.0))
    assert isinstance(policy, SweepPosterior)
    assert [sweep.to_deg for sweep in policy.sweeps] == [2.0, 0.0]


@pytest.mark.parametrize(("start_deg", "from_deg", "to_deg"), [(-35.0, None, 35.0), (10.0, 35.0, -35.0)])
def test_a_burst_goes_there_and_back_from_an_end(start_deg: float, from_deg: float | None, to_deg: float) -> None:
    search = Search(curve_about(-10.0), start_deg=start_deg, from_end=True)
    asked = search.policy.ask()
    assert asked == Sweep(to_deg=to_deg, speed_deg_s=SPEED, from_deg=from_deg, back_deg=-to_deg, wait_deg=0.0)
    search.run()
    assert len(search.sweeps) == 1
    assert isinstance(search.policy.estimate(), Found)


@pytest.mark.parametrize(("delay_s", "from_end", "sigma_s"), [(-8e-3, True, 10e-3), (8e-3, False, 30e-3)])
def test_a_delay_that_the_ways_there_and_back_show_is_taken_out(delay_s: float, from_end: bool, sigma_s: float) -> None:
    off_deg = []
    for seed in range(6):
        search = Search(curve_about(-10.0), seed=seed, delay_s=delay_s, from_end=from_end, sigma_s=sigma_s)
        search.run()
        assert len(search.sweeps) == 1 + (not from_end)
        answer = search.policy.estimate()
        assert isinstance(answer, Found)
        off_deg.append(answer.mean_deg + 10.0)
    # 0.1 degrees if it were not.
    assert abs(np.mean(off_deg)) < 0.05


@pytest.mark.parametrize("delay_s", [96e-3, -48e-3])
def test_frames_that_are_late_by_one_or_two_or_early_are_refused(delay_s: float) -> None:
    search = Search(curve_about(-10.0), delay_s=delay_s, from_end=True)
    search.run()
    assert re.search(r"differ as if the light came .* frames are late by one or more", search.policy.disorder or "")
    # No frame shows a motion along the turn, which has the same effect.
    assert re.search(r"moves along the turn, here by \d\.\d deg .* hold the ventilation", search.policy.disorder or "")
    assert not isinstance(search.policy.estimate(), Found)


@pytest.mark.parametrize("delay_s", [33e-3, 66e-3, -33e-3])
def test_a_stream_that_is_late_although_the_rig_states_its_delay_is_refused(delay_s: float) -> None:
    """Frames of a laser of 30 Hz, late or early by one or two."""
    search = Search(curve_about(-7.0), delay_s=delay_s, sigma_s=1e-3)
    search.run()
    assert re.search(r"the sweeps there and back differ as if the light came", search.policy.disorder or "")
    assert not isinstance(search.policy.estimate(), Found)


@pytest.mark.parametrize("marker_deg", [-32.6, 33.1])
@pytest.mark.parametrize("delay_s", [66e-3, -33e-3])
def test_where_the_range_ends_on_a_flank_a_late_stream_is_refused_or_the_interval_holds_the_marker(
    marker_deg: float, delay_s: float
) -> None:
    search = Search(curve_about(marker_deg), delay_s=delay_s, sigma_s=1e-3)
    search.run()
    answer = search.policy.estimate()
    assert not isinstance(answer, Found) or abs(answer.mean_deg - marker_deg) < 3 * answer.sigma_deg


def test_a_burst_back_begins_at_the_end_although_the_probe_waited_elsewhere() -> None:
    search = Search(curve_about(-10.0, snr=10.0, fwhm_deg=18.0), from_end=True)
    there = search.policy.ask()
    assert isinstance(there, Sweep)
    search.sweep(there)
    back = search.policy.ask()
    assert isinstance(back, Sweep)
    # Over both flanks, there and back; beside the marker the probe waits for the frames.
    assert back.from_deg == back.back_deg
    assert -35.0 <= back.from_deg < -10.0 - 0.5 * 18.0
    assert -10.0 + 0.5 * 18.0 < back.to_deg < 35.0
    assert back.speed_deg_s <= SPEED
    assert back.wait_deg == pytest.approx(-10.0, abs=2.0)
    search.run()
    assert len(search.sweeps) in {2, 3}


def test_a_sweep_is_over_however_long_before_its_end_the_light_goes_out() -> None:
    search = Search(lambda _: 0.0, start_deg=10.0, dark_deg=3.0)
    search.run()
    assert [round(to_deg) for _, to_deg in search.sweeps] == pytest.approx([32, -32, 32], abs=1)


@pytest.mark.parametrize("marker_deg", [34.2, -34.4, 29.0])
def test_an_answer_near_an_end_knows_its_error_though_one_flank_alone_was_in_the_light(marker_deg: float) -> None:
    search = Search(curve_about(marker_deg), dark_deg=1.8)
    search.run()
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert abs(answer.mean_deg - marker_deg) < 3 * answer.sigma_deg


def test_where_single_pulses_show_nothing_a_search_at_rest_begins_anew() -> None:
    search = Search(lambda _: 0.0)
    search.run()
    assert len(search.sweeps) == 2
    assert len(search.stops) == 16
    assert isinstance(search.policy.estimate(), NotFound)
    with pytest.raises(SearchError):
        search.policy.tell(search.sample(0.0))


def test_what_single_pulses_do_not_show_the_mean_of_some_does() -> None:
    """At an SNR of 4.5 a pulse, 18 after averaging, the marker is found at rest."""
    search = Search(curve_about(5.0, snr=4.5, fwhm_deg=10.0))
    search.run()
    assert search.stops
    answer = search.policy.estimate()
    assert abs(answer.mean_deg - 5.0) < 1.5


def test_where_the_centre_is_not_known_well_enough_it_sweeps_back_over_the_flanks() -> None:
    search = Search(curve_about(20.0, snr=10.0, fwhm_deg=18.0))
    search.run()
    # Slower, and not over the whole range.
    assert len(search.sweeps) in {2, 3}
    assert all(abs(to_deg - from_deg) < 45.0 for from_deg, to_deg in search.sweeps[1:])
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert abs(answer.mean_deg - 20.0) < 3 * answer.sigma_deg


def test_where_another_source_may_hide_it_sweeps_back_over_the_whole_range() -> None:
    search = Search(curve_about(20.0, snr=8.0, fwhm_deg=3.0))
    search.run()
    assert [round(to_deg) for _, to_deg in search.sweeps] == [35, -35]
    assert search.stops == []
    assert isinstance(search.policy.estimate(), Found)


def test_a_confirmation_is_weighed_and_the_search_is_over() -> None:
    search = Search(curve_about(-10.0))
    search.run()
    answer = search.policy.estimate()
    search.policy.confirm(search.sample(answer.mean_deg))
    assert isinstance(search.policy.estimate(), Found)
    assert search.policy.ask() is None
    assert search.policy.belief is not None


def test_dark_frames_are_of_a_search_at_rest_only() -> None:
    search = Search(curve_about(-10.0))
    dark = Sample(angle_deg=-35.0, reading=Reading(intensity=1.2, noise_sigma=0.25, cells=CELLS), dark=True)
    search.policy.tell(dark)
    search.run()
    answer = search.policy.estimate()
    assert isinstance(answer, Found)
    assert answer.floor is not None
    assert answer.floor.source == "noise of the frames"


def test_a_plan_that_sweeps_is_of_the_posterior() -> None:
    plan = SearchPlan(method="posterior", sweep_speed_deg_s=10.0)
    assert most_acquisitions(plan) is None
    assert isinstance(build_sweeping(plan, limits=PAPER_RANGE), SweepPosterior)
    with pytest.raises(ConfigError, match="use build_sweeping"):
        build(plan)
    for wrong, said in (
        (SearchPlan(method="ternary"), "ternary: it asks for one angle after another"),
        (SearchPlan(method="posterior", as_published=True), "only posterior sweeps"),
        (SearchPlan(method="posterior", early_end=False), "early_end"),
    ):
        with pytest.raises(ConfigError, match=said):
            require_sweeping(wrong)
    assert not isinstance(build_sweeping(SearchPlan(method="ternary"), limits=PAPER_RANGE), SweepPosterior)


def test_two_sources_are_no_disorder_of_the_frames() -> None:
    for seed in range(6):
        first = curve_about(-15.0)
        second = curve_about(20.0)
        search = Search(
            lambda at_deg, one=first, other=second: max(one(at_deg), other(at_deg)), seed=seed, sigma_s=30e-3
        )
        search.run()
        assert len(search.sweeps) > 1
        assert search.policy.disorder is None
        assert not isinstance(search.policy.estimate(), Found)


def test_a_sweep_of_which_no_pulse_counts_is_made_again_the_other_way() -> None:
    search = Search(curve_about(-10.0))
    search.policy.end_sweep()
    asked = search.policy.ask()
    assert isinstance(asked, Sweep)
    assert asked.to_deg == -35.0
