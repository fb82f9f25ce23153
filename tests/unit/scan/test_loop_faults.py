"""What devices raise: the run ends, the rig stops, and the guard distinguishes faults from refusals.

Devices that answer wrongly are in `tests.faults.test_campaign`.
"""

from __future__ import annotations

import math

import pytest

from markerseek.core import (
    AcquisitionError,
    ConfigError,
    DeviceTimeoutError,
    Failed,
    Finished,
    Frame,
    LaserError,
    LimitError,
    MoveError,
    Permit,
    Reading,
    ReadingFrame,
    Refused,
    RunPlan,
)
from markerseek.guard import State
from markerseek.scan import run
from tests.unit.scan.scan_bench import Bench, Tour, drain, scanner


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
