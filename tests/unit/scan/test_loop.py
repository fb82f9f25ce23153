"""The loop: order of events, which samples a policy gets and when, and that every end leaves the rig stopped."""

from __future__ import annotations

from dataclasses import replace

import pytest

from markerseek.core import (
    AcquisitionError,
    Asked,
    ConfigError,
    Failed,
    Finished,
    Found,
    Measured,
    NotFound,
    Refused,
    RunPlan,
    Sample,
    SearchError,
    Started,
)
from markerseek.guard import State
from markerseek.scan import RunLimits, run
from tests.unit.scan.scan_bench import FOUND, Bench, Tour, drain, kinds, scanner


def test_a_found_search_moves_to_the_marker_confirms_and_stops() -> None:
    bench = Bench()
    policy = Tour(-35.0, 0.0, 10.0)
    events = list(run(policy, scanner(bench), RunPlan(dark_frames=2)))
    assert kinds(events) == ["Started", "dark", "dark", "search", "search", "search", "confirmation", "Finished"]
    finished = events[-1]
    assert isinstance(finished, Finished)
    assert finished.acquisitions == 3
    assert finished.travel_deg == pytest.approx(35 + 10 + 6)
    assert finished.elapsed_s == pytest.approx(4.0)
    assert finished.confirmation is not None
    assert finished.confirmation.angle_deg == 4.0
    assert [sample.dark for sample in policy.samples] == [True, True, False, False, False]
    assert [entry for entry in bench.log if entry.startswith("fire")] == ["fire 0"] * 2 + ["fire 16"] * 4
    assert bench.log[-2:] == ["disarm", "stop"]


def test_the_order_within_one_measurement() -> None:
    bench = Bench(short_by_deg=0.0625)
    sample = scanner(bench).measure(12.0)
    assert bench.log == ["move 12", "arm", "fire 16"]
    assert sample.angle_deg == 11.9375
    assert sample.frame is not None
    header = sample.frame.header
    assert (header.commanded_deg, header.angle_before_deg, header.angle_after_deg) == (12.0, 11.9375, 11.9375)


def test_a_policy_gets_a_sample_only_after_the_event_was_handed_out() -> None:
    policy = Tour(0.0, 1.0)
    events = run(policy, scanner(Bench()))
    assert isinstance(next(events), Started)
    assert next(events) == Asked(role="search", index=1, angle_deg=0.0)
    assert policy.samples == []
    measured = next(events)
    assert isinstance(measured, Measured)
    assert policy.samples == []
    next(events)
    assert policy.samples == [measured.sample]


@pytest.mark.parametrize(("stay", "answer"), [(True, FOUND), (False, NotFound(mean_deg=0.0, reason="flat"))])
def test_without_a_found_marker_or_with_stay_the_probe_stays(stay: bool, answer: Found | NotFound) -> None:
    bench = Bench()
    events = list(run(Tour(0.0, answer=answer), scanner(bench), RunPlan(stay=stay)))
    assert kinds(events) == ["Started", "search", "Finished"]
    assert bench.angle_deg == 0.0


def test_a_refused_frame_is_reported_and_taken_again() -> None:
    policy, made = Tour(0.0), scanner(Bench(bad_frames=2))
    events = list(run(policy, made, RunPlan(stay=True)))
    assert kinds(events) == ["Started", "Refused", "Refused", "search", "Finished"]
    refused = events[2]
    assert isinstance(refused, Refused)
    assert "stale" in refused.reason
    assert len(policy.samples) == 1
    assert made.guard.state is State.DISARMED


def test_frames_refused_too_often_end_the_run_with_an_error_and_no_angle() -> None:
    bench = Bench(bad_frames=3)
    policy = Tour(0.0)
    events = drain(run(policy, scanner(bench)), AcquisitionError)
    assert kinds(events) == ["Started", "Refused", "Refused", "Failed"]
    failed = events[-1]
    assert isinstance(failed, Failed)
    assert "refused 3 times" in str(failed.error)
    assert policy.samples == []
    assert bench.log[-2:] == ["disarm", "stop"]


def test_closing_the_run_early_stops_the_rig() -> None:
    bench = Bench()
    events = run(Tour(0.0, 1.0), scanner(bench))
    next(events)
    next(events)
    events.close()
    assert bench.log[-2:] == ["disarm", "stop"]


@pytest.mark.parametrize(
    "limits", [RunLimits(acquisitions=5), RunLimits(duration_s=4.5), RunLimits(duration_s=float("nan"))]
)
def test_a_search_that_does_not_end_is_ended(limits: RunLimits) -> None:
    class Endless(Tour):
        def ask(self) -> float | None:
            return 0.0 if len(self.samples) % 2 else 1.0

        def tell(self, sample: Sample) -> None:
            self.samples.append(sample)

    policy = Endless()
    drain(run(policy, scanner(Bench()), limits=limits), SearchError)
    assert len(policy.samples) <= 5


def test_settings_that_could_measure_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="pulses is 0"):
        scanner(Bench(), pulses=0)
    with pytest.raises(ConfigError, match="attempts is 0"):
        list(run(Tour(0.0), scanner(Bench()), limits=replace(RunLimits(), attempts=0)))
