"""Runs with a receiver that cannot identify its frames: settling, varied pulse counts, closing dark frame."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from markerseek import rigs
from markerseek.core import (
    AcquisitionError,
    ConfigError,
    Event,
    Failed,
    Finished,
    Frame,
    Measured,
    Permit,
    Refused,
    RunPlan,
    SearchPlan,
)
from markerseek.guard import Admission, FiringLimits, Guard, Limits, State
from markerseek.scan import run
from markerseek.search import build
from markerseek.sim import GaussianCurve
from tests.unit.scan.scan_bench import Bench, Tour, drain, kinds, scanner


class Settling(Bench):
    """A bench that notes when it settles, and into which stale files land at the first time."""

    stale: int = 0

    def settle(self) -> None:
        self.log.append("settle")
        if self.stale:
            self.stale -= 1
            raise AcquisitionError("stale files landed")

    def acquire(self, permit: Permit) -> Frame:
        self.log.append("acquire")
        return super().acquire(permit)


def order(bench: Bench) -> list[str]:
    return [step for step in bench.log if step in ("settle", "acquire") or step.startswith("fire")]


def test_the_receiver_settles_before_the_first_acquisition_and_not_between_good_ones() -> None:
    bench = Settling()
    list(run(Tour(1.0, 2.0), scanner(bench), RunPlan(dark_frames=1, stay=True)))
    assert order(bench) == ["settle", "fire 0", "acquire", "fire 16", "acquire", "fire 16", "acquire"]


def test_after_a_refused_frame_it_settles_before_anything_is_fired_again() -> None:
    bench = Settling()
    bench.bad_frames = 2
    events = list(run(Tour(1.0), scanner(bench), RunPlan(stay=True)))
    assert kinds(events) == ["Started", "Refused", "Refused", "search", "Finished"]
    assert order(bench) == ["settle", "fire 16", "acquire"] * 3


def test_stale_files_are_reported_and_the_search_goes_on() -> None:
    bench = Settling()
    bench.stale = 1
    events = list(run(Tour(1.0), scanner(bench), RunPlan(dark_frames=1, stay=True)))
    assert [event.reason for event in events if isinstance(event, Refused)] == ["stale files landed"]
    assert isinstance(events[-1], Finished)
    assert order(bench)[:4] == ["settle", "settle", "fire 0", "acquire"]


def test_files_of_light_for_a_camera_are_neither_used_nor_refused() -> None:
    bench = Settling()
    lit = scanner(bench)
    assert lit.light() == 16
    bench.stale = 1
    events = list(run(Tour(1.0), lit, RunPlan(stay=True)))
    assert not [event for event in events if isinstance(event, Refused)]
    assert order(bench) == ["fire 16", "settle", "fire 16", "acquire"]
    # Of the next acquisition it is stale again.
    bench.stale = 1
    bench.bad_frames = 1
    events = list(run(Tour(2.0), lit, RunPlan(stay=True)))
    assert "stale files landed" in [event.reason for event in events if isinstance(event, Refused)]


def test_stale_files_without_end_are_a_fault() -> None:
    bench = Settling()
    bench.stale = 9
    made = scanner(bench)
    drain(run(Tour(1.0), made), AcquisitionError)
    assert made.guard.state is State.FAULT
    assert order(bench) == ["settle"] * 3


def test_the_number_of_pulses_goes_in_turn_and_neighbours_differ() -> None:
    bench = Settling()
    made = scanner(bench, pulses=(17, 15, 16))
    events = list(run(Tour(1.0, 2.0, 3.0, 4.0), made, RunPlan(dark_frames=1, stay=True)))
    assert [step for step in order(bench) if step.startswith("fire")] == [f"fire {n}" for n in (0, 17, 15, 16, 17)]
    assert made.pulses == 17
    assert isinstance(events[-1], Finished)
    for pulses in ((), (4, 0)):
        with pytest.raises(ConfigError, match="scanner: pulses is"):
            scanner(Bench(), pulses=pulses)


def closing(behind: bool, *, stay: bool = False) -> tuple[rigs.Rig, Iterator[Event]]:
    """A search on a simulated rig that ends with a dark frame, whose data may be those of the frame before."""
    rig = rigs.of_intensities(seed=3, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=6.3)
    made = rig.scanner
    made.guard = Guard(limits=Limits(), firing=FiringLimits(), admission=Admission(dark_alarm=1e-6))
    made._faulting._guard = made.guard
    made._refusable._guard = made._faulting._guard
    receiver = rig.receiver
    last = []
    acquire = rig.receiver.acquire

    def one_behind(permit: Permit) -> Frame:
        last.append(acquire(permit))
        if behind and permit.pulses == 0 and len(last) > 3:
            return replace(last[-1], intensity=1.001 * last[-2].intensity)
        return last[-1]

    receiver.acquire = one_behind  # type: ignore[method-assign]
    # Without a confirmation the last acquisition must be of the source, and none of a survey: a single source has none.
    policy = build(SearchPlan(method="posterior", others=0.0 if stay else None), limits=rig.limits.search)
    return rig, run(policy, made, RunPlan(dark_frames=3, stay=stay, closing_dark=True))


@pytest.mark.parametrize("stay", [False, True])
def test_the_last_frame_is_dark_and_the_policy_does_not_get_it(stay: bool) -> None:
    rig, events = closing(behind=False, stay=stay)
    seen = list(events)
    measured = [event for event in seen if isinstance(event, Measured)]
    assert (measured[-1].role, measured[-1].index, measured[-1].sample.dark) == ("dark", 4, True)
    assert measured[-1].sample.angle_deg == measured[-2].sample.angle_deg
    assert measured[-2].role == ("search" if stay else "confirmation")
    assert isinstance(seen[-1], Finished)
    assert seen[-1].acquisitions == sum(event.role == "search" for event in measured)
    assert rig.scanner.guard.state is State.DISARMED


@pytest.mark.parametrize("stay", [False, True])
def test_frames_that_come_one_behind_leave_light_in_it_and_no_angle_is_given(stay: bool) -> None:
    rig, events = closing(behind=True, stay=stay)
    seen = drain(events, AcquisitionError)
    assert isinstance(seen[-1], Failed)
    assert "taken without light, yet it holds a source" in str(seen[-1].error)
    assert rig.scanner.guard.state is State.FAULT
    assert not any(isinstance(event, Finished) for event in seen)
