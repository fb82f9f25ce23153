"""The loop: the order of its events, the guard within a run, and what devices raise; every end leaves the rig stopped.

Devices that answer wrongly are in `tests.faults.test_campaign`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import pytest

from markerseek.core import (
    AcquisitionError,
    Asked,
    ConfigError,
    DeviceTimeoutError,
    Failed,
    Finished,
    Found,
    Frame,
    LaserError,
    LimitError,
    Measured,
    MoveError,
    NotFound,
    Permit,
    Reading,
    ReadingFrame,
    Refused,
    RunPlan,
    Sample,
    SearchError,
    Started,
)
from markerseek.guard import State
from markerseek.scan import RunLimits, Scanner, run
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


@pytest.mark.parametrize("answer", [None, 3.5, (FOUND,)])
def test_an_estimate_that_is_none_names_the_policy(answer: object) -> None:
    with pytest.raises(SearchError, match=r"policy .*scan_bench\.Tour: estimate\(\) returned .* must return a Found"):
        list(run(Tour(0.0, answer=cast("Found", answer)), scanner(Bench())))


def test_a_refused_frame_is_reported_and_taken_again() -> None:
    policy = Tour(0.0)
    made = scanner(Bench(bad_frames=2))
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


@pytest.mark.parametrize("angle_deg", [35.001, -36.0, float("nan"), float("inf")])
def test_an_angle_outside_is_refused_before_anything_moves(angle_deg: float) -> None:
    bench = Bench()
    made = scanner(bench)
    drain(run(Tour(angle_deg), made), LimitError)
    assert bench.log == ["disarm", "stop"]
    # It is the policy's fault and not the rig's.
    assert made.guard.state is State.DISARMED


def states(bench: Bench, **changes: object) -> tuple[Scanner, list[str]]:
    """A scanner, and what the guard's state was at each verb of a device, the watchdog's among them."""
    seen: list[str] = []
    held = [False]

    class Watched(Bench):
        def _note(self, verb: str) -> None:
            seen.append(f"{verb} {made.guard.state.value}{' held' if held[0] else ''}")

        def move_to(self, angle_deg: float) -> float:
            self._note("move")
            return super().move_to(angle_deg)

        def arm(self, permit: Permit) -> None:
            self._note("arm")

        def fire(self, permit: Permit) -> int:
            self._note("fire")
            return super().fire(permit)

        def acquire(self, permit: Permit) -> Frame:
            self._note("acquire")
            return super().acquire(permit)

        def disarm(self) -> None:
            self._note("disarm")

        def stop(self) -> None:
            self._note("stop")

        def hold(self) -> None:
            held[0] = True

        def release(self) -> None:
            held[0] = False

    watched = Watched(**{name: getattr(bench, name) for name in bench.__dataclass_fields__})
    made = scanner(watched, watchdog=watched, **changes)
    return made, seen


def test_each_device_acts_in_its_state_and_under_the_lease() -> None:
    made, seen = states(Bench())
    events = list(run(Tour(0.0), made, RunPlan(stay=True)))
    assert isinstance(events[-1], Finished)
    assert seen == [
        "move moving held",
        "arm armed",
        "fire firing held",
        "acquire armed",
        "disarm disarmed",
        "stop disarmed",
    ]
    assert made.guard.state is State.DISARMED


def test_an_unarmed_guard_moves_and_fires_nothing() -> None:
    bench = Bench()
    made = scanner(bench, arms_itself=False)
    drain(run(Tour(0.0), made), LimitError)
    with pytest.raises(LimitError, match="not allowed to permit pulses"):
        made.measure_dark()
    assert bench.log == ["disarm", "stop"]
    made.guard.arm(by="a test")
    assert made.measure(0.0).angle_deg == 0.0


def test_a_run_leaves_the_guard_disarmed_and_the_next_needs_a_person() -> None:
    made = scanner(Bench(), arms_itself=False)
    made.guard.arm(by="a test")
    list(run(Tour(0.0), made, RunPlan(stay=True)))
    with pytest.raises(LimitError, match="arm it"):
        made.measure(0.0)


def test_a_probe_outside_its_travel_ends_the_run_before_it_begins() -> None:
    bench = Bench(angle_deg=-40.0)
    made = scanner(bench)
    events = drain(run(Tour(0.0), made), LimitError)
    assert kinds(events) == ["Failed"]
    assert made.guard.state is State.FAULT
    assert bench.log == ["disarm", "stop"]


def test_a_laser_that_cannot_be_disarmed_does_not_keep_the_stage_from_stopping() -> None:
    class Jammed(Bench):
        def disarm(self) -> None:
            raise LaserError("jammed")

    bench = Jammed()
    with pytest.raises(LaserError):
        scanner(bench).stop()
    assert bench.log == ["stop"]


class Broken(Bench):
    """A bench, one verb of which raises."""

    verb: str = ""
    error: Exception = OSError("cable pulled")

    def __getattribute__(self, name: str) -> object:
        if name == object.__getattribute__(self, "verb"):
            raise object.__getattribute__(self, "error")
        return object.__getattribute__(self, name)


def broken(verb: str, error: Exception) -> Broken:
    bench = Broken()
    bench.verb = verb
    bench.error = error
    return bench


@pytest.mark.parametrize("verb", ["move_to", "angle_deg", "arm", "fire", "acquire", "read"])
@pytest.mark.parametrize("error", [OSError("cable pulled"), DeviceTimeoutError("silent"), ValueError("what?")])
def test_whatever_a_device_raises_is_a_fault_that_only_a_person_ends(verb: str, error: Exception) -> None:
    bench = broken(verb, error)
    made = scanner(bench)
    events = drain(run(Tour(0.0), made), type(error))
    assert isinstance(events[-1], Failed)
    assert made.guard.state is State.FAULT
    assert made.guard.fault == f"{type(error).__name__}: {error}"
    bench.verb = ""
    with pytest.raises(LimitError, match="a person must reset it"):
        made.measure(0.0)
    made.guard.reset(by="a test")
    assert made.measure(0.0).reading.intensity > 0


@pytest.mark.parametrize("verb", ["move_to", "fire"])
def test_stage_and_laser_have_nothing_to_refuse(verb: str) -> None:
    made = scanner(broken(verb, AcquisitionError("not my business")))
    drain(run(Tour(0.0), made), AcquisitionError)
    assert made.guard.state is State.FAULT


@pytest.mark.parametrize(
    ("verb", "error"), [("arm", ConfigError("no dark frames here")), ("read", ConfigError("channel data"))]
)
def test_an_argument_that_a_part_cannot_use_is_no_fault(verb: str, error: Exception) -> None:
    made = scanner(broken(verb, error))
    drain(run(Tour(0.0), made), ConfigError)
    assert made.guard.state is State.DISARMED


def test_a_reader_that_makes_no_number_of_a_frame_has_the_frame_refused() -> None:
    """A damaged reading stays a refusal, after which the frame is taken again: the search goes on."""

    class OnceNan(Bench):
        def read(self, frame: Frame) -> Reading:
            assert isinstance(frame, ReadingFrame)
            return Reading(intensity=math.nan if frame.header.sequence == 2 else frame.intensity)

    events = list(run(Tour(0.0, 1.0, 2.0), scanner(OnceNan()), RunPlan(stay=True)))
    assert [event.reason for event in events if isinstance(event, Refused)] == [
        "intensity is nan, it must be a finite number of at least 0; take the frame again"
    ]
    assert isinstance(events[-1], Finished)


def test_ctrl_c_in_mid_move_stops_the_rig_and_disarms_it() -> None:
    bench = broken("move_to", KeyboardInterrupt())  # type: ignore[arg-type]
    made = scanner(bench)
    with pytest.raises(KeyboardInterrupt):
        list(run(Tour(0.0), made))
    assert bench.log == ["disarm", "stop"]
    assert made.guard.state is State.DISARMED


def test_a_probe_that_creeps_between_arrival_and_firing_is_not_fired_at() -> None:
    class Creeping(Bench):
        def arm(self, permit: Permit) -> None:
            self.angle_deg += 0.2

    bench = Creeping()
    drain(run(Tour(0.0), scanner(bench)), MoveError)
    assert not [entry for entry in bench.log if entry.startswith("fire")]


@pytest.mark.parametrize("verb", ["disarm", "stop"])
def test_a_device_that_does_not_stop_is_a_fault(verb: str) -> None:
    made = scanner(broken(verb, OSError("jammed")))
    with pytest.raises(OSError, match="jammed"):
        made.stop()
    assert made.guard.state is State.FAULT


def test_a_receiver_that_takes_longer_than_the_permit_lives_is_not_fired_for() -> None:
    class Slow(Bench):
        def arm(self, permit: Permit) -> None:
            self.time_s += 31.0

    bench = Slow()
    drain(run(Tour(0.0), scanner(bench)), LaserError)
    assert not [entry for entry in bench.log if entry.startswith("fire")]


def test_a_frame_of_a_probe_that_moved_never_reaches_the_policy() -> None:
    class Moved(Bench):
        def acquire(self, permit: Permit) -> Frame:
            frame = super().acquire(permit)
            self.angle_deg += 0.06
            return frame

    policy = Tour(0.0)
    events = drain(run(policy, scanner(Moved())), AcquisitionError)
    assert "the probe moved by 0.06" in [event.reason for event in events if isinstance(event, Refused)][-1]
    assert policy.samples == []
