"""The loop: order of events, what a policy is told and when, and that every end leaves the rig stopped."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import pytest

from markerseek.core import (
    AcquisitionError,
    Asked,
    ConfigError,
    DeviceError,
    DeviceTimeoutError,
    Event,
    Failed,
    Finished,
    Found,
    Frame,
    FrameHeader,
    Interval,
    LaserError,
    LimitError,
    Measured,
    MoveError,
    NotFound,
    Permit,
    Reading,
    ReadingFrame,
    Refused,
    Sample,
    SaturationError,
    SearchError,
    Started,
)
from markerseek.guard import Admission, FiringLimits, Guard, Limits, State
from markerseek.scan import RunLimits, Scanner, run

FOUND = Found(
    mean_deg=4.0, sigma_deg=0.1, interval95_deg=Interval(low_deg=3.8, high_deg=4.2), interval_kind="propagated"
)


@dataclass
class Bench:
    """Stage, laser, receiver, reader and clock in one, with a log and some faults."""

    angle_deg: float = -35.0
    limits: Interval = field(default_factory=lambda: Interval(low_deg=-36.5, high_deg=36.5))
    log: list[str] = field(default_factory=list)
    short_by_deg: float = 0.0
    missing_pulses: int = 0
    bad_frames: int = 0
    intensity: float = 5.0
    time_s: float = 0.0
    sequence: int = 0

    def move_to(self, angle_deg: float) -> float:
        self.log.append(f"move {angle_deg:g}")
        self.angle_deg = angle_deg - self.short_by_deg
        self.time_s += 1.0
        return self.angle_deg

    def stop(self) -> None:
        self.log.append("stop")

    def arm(self, permit: Permit) -> None:
        self.log.append("arm")

    def fire(self, permit: Permit) -> int:
        self.log.append(f"fire {permit.pulses}")
        return max(permit.pulses - self.missing_pulses, 0)

    def disarm(self) -> None:
        self.log.append("disarm")

    def acquire(self, permit: Permit) -> Frame:
        self.sequence += 1
        stale = self.bad_frames > 0
        self.bad_frames -= stale
        header = FrameHeader(
            sequence=self.sequence,
            token="old" if stale else permit.token,
            pulses=permit.pulses,
            commanded_deg=permit.angle_deg,
            started_s=self.time_s,
            ended_s=self.time_s,
        )
        return ReadingFrame(header=header, intensity=self.intensity + 0.01 * self.sequence)

    def read(self, frame: Frame) -> Reading:
        assert isinstance(frame, ReadingFrame)
        return Reading(intensity=frame.intensity)

    def now_s(self) -> float:
        return self.time_s

    def wait(self, duration_s: float) -> None:
        self.time_s += duration_s


class Tour:
    """Visits the angles given and then says what it was told to say."""

    def __init__(self, *angles_deg: float, answer: Found | NotFound = FOUND) -> None:
        self.left = list(angles_deg)
        self.told: list[Sample] = []
        self.answer = answer

    def ask(self) -> float | None:
        return self.left[0] if self.left else None

    def tell(self, sample: Sample) -> None:
        self.told.append(sample)
        if not sample.dark:
            self.left.pop(0)

    def estimate(self) -> Found | NotFound:
        return self.answer


def scanner(bench: Bench, **changes: object) -> Scanner:
    arms_itself = {"arms_itself": True}
    return Scanner(
        stage=bench,
        laser=bench,
        receiver=bench,
        reader=bench,
        clock=bench,
        guard=Guard(limits=Limits(), firing=FiringLimits(), admission=Admission()),
        **(arms_itself | changes),
    )


def kinds(events: list[Event]) -> list[str]:
    """Names of the events without `Asked`, which stands before each acquisition."""
    heard = [event for event in events if not isinstance(event, Asked)]
    return [event.role if isinstance(event, Measured) else type(event).__name__ for event in heard]


def drain(events: Iterator[Event], error: type[Exception]) -> list[Event]:
    """Events up to the error that ends them."""
    seen: list[Event] = []
    with pytest.raises(error):
        seen.extend(events)
    return seen


def test_a_found_search_moves_to_the_marker_confirms_and_stops() -> None:
    bench = Bench()
    policy = Tour(-35.0, 0.0, 10.0)
    events = list(run(policy, scanner(bench), dark_frames=2))
    assert kinds(events) == ["Started", "dark", "dark", "search", "search", "search", "confirmation", "Finished"]
    finished = events[-1]
    assert isinstance(finished, Finished)
    assert finished.acquisitions == 3
    assert finished.travel_deg == pytest.approx(35 + 10 + 6)
    assert finished.elapsed_s == pytest.approx(4.0)
    assert finished.confirmation is not None
    assert finished.confirmation.angle_deg == 4.0
    assert [sample.dark for sample in policy.told] == [True, True, False, False, False]
    assert [entry for entry in bench.log if entry.startswith("fire")] == ["fire 0"] * 2 + ["fire 16"] * 4
    assert bench.log[-2:] == ["disarm", "stop"]


def test_every_acquisition_is_announced_before_anything_moves() -> None:
    bench = Bench()
    announced = []
    for event in run(Tour(-35.0, 10.0), scanner(bench), dark_frames=1):
        if isinstance(event, Asked):
            announced.append((event.role, event.index, event.angle_deg))
            assert len([entry for entry in bench.log if entry.startswith("fire")]) == len(announced) - 1
    assert announced == [("dark", 1, -35.0), ("search", 1, -35.0), ("search", 2, 10.0), ("confirmation", 1, 4.0)]


def test_the_order_within_one_measurement() -> None:
    bench = Bench()
    sample = scanner(bench).measure(12.0)
    assert bench.log == ["move 12", "arm", "fire 16"]
    assert sample.frame is not None
    header = sample.frame.header
    assert (header.commanded_deg, header.angle_before_deg, header.angle_after_deg) == (12.0, 12.0, 12.0)


def test_a_policy_is_told_only_after_the_event_was_handed_out() -> None:
    policy = Tour(0.0, 1.0)
    events = run(policy, scanner(Bench()))
    assert isinstance(next(events), Started)
    assert next(events) == Asked(role="search", index=1, angle_deg=0.0)
    assert policy.told == []
    measured = next(events)
    assert isinstance(measured, Measured)
    assert policy.told == []
    next(events)
    assert policy.told == [measured.sample]


@pytest.mark.parametrize(("stay", "answer"), [(True, FOUND), (False, NotFound(mean_deg=0.0, reason="flat"))])
def test_without_a_found_marker_or_with_stay_the_probe_stays(stay: bool, answer: Found | NotFound) -> None:
    bench = Bench()
    events = list(run(Tour(0.0, answer=answer), scanner(bench), stay=stay))
    assert kinds(events) == ["Started", "search", "Finished"]
    assert bench.angle_deg == 0.0


def test_a_refused_frame_is_reported_and_taken_again() -> None:
    bench = Bench(bad_frames=2)
    policy = Tour(0.0)
    events = list(run(policy, scanner(bench), stay=True))
    assert kinds(events) == ["Started", "Refused", "Refused", "search", "Finished"]
    refused = events[2]
    assert isinstance(refused, Refused)
    assert "stale" in refused.reason
    assert len(policy.told) == 1


def test_frames_refused_too_often_end_the_run_with_an_error_and_no_angle() -> None:
    bench = Bench(bad_frames=3)
    policy = Tour(0.0)
    events = drain(run(policy, scanner(bench)), AcquisitionError)
    assert kinds(events) == ["Started", "Refused", "Refused", "Failed"]
    failed = events[-1]
    assert isinstance(failed, Failed)
    assert "refused 3 times" in str(failed.error)
    assert policy.told == []
    assert bench.log[-2:] == ["disarm", "stop"]


@pytest.mark.parametrize(
    ("bench", "error"),
    [
        (Bench(short_by_deg=0.2), MoveError),
        (Bench(short_by_deg=float("nan")), LimitError),
        (Bench(missing_pulses=1), LaserError),
        (Bench(intensity=float("nan")), AcquisitionError),
    ],
)
def test_a_device_that_does_not_do_its_part_ends_the_run(bench: Bench, error: type[DeviceError]) -> None:
    policy = Tour(0.0)
    events = drain(run(policy, scanner(bench)), error)
    assert isinstance(events[-1], Failed)
    assert policy.told == []
    assert bench.log[-1] == "stop"


@pytest.mark.parametrize("angle_deg", [35.001, -36.0, float("nan"), float("inf")])
def test_an_angle_outside_is_refused_before_anything_moves(angle_deg: float) -> None:
    bench = Bench()
    drain(run(Tour(angle_deg), scanner(bench)), LimitError)
    assert bench.log == ["disarm", "stop"]


def test_closing_the_run_early_stops_the_rig() -> None:
    bench = Bench()
    events = run(Tour(0.0, 1.0), scanner(bench))
    next(events)
    next(events)
    events.close()
    assert bench.log[-2:] == ["disarm", "stop"]


def test_a_laser_that_cannot_be_disarmed_does_not_keep_the_stage_from_stopping() -> None:
    class Jammed(Bench):
        def disarm(self) -> None:
            raise LaserError("jammed")

    bench = Jammed()
    with pytest.raises(LaserError):
        scanner(bench).stop()
    assert bench.log == ["stop"]


@pytest.mark.parametrize(
    "limits", [RunLimits(acquisitions=5), RunLimits(duration_s=4.5), RunLimits(duration_s=float("nan"))]
)
def test_a_search_that_does_not_end_is_ended(limits: RunLimits) -> None:
    class Endless(Tour):
        def ask(self) -> float | None:
            return 0.0 if len(self.told) % 2 else 1.0

        def tell(self, sample: Sample) -> None:
            self.told.append(sample)

    policy = Endless()
    drain(run(policy, scanner(Bench()), limits=limits), SearchError)
    assert len(policy.told) <= 5


def test_settings_that_could_hear_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="pulses is 0"):
        scanner(Bench(), pulses=0)
    with pytest.raises(ConfigError, match="attempts is 0"):
        list(run(Tour(0.0), scanner(Bench()), limits=replace(RunLimits(), attempts=0)))


def states(bench: Bench, **changes: object) -> tuple[Scanner, list[str]]:
    """A scanner, and what the guard's state was at each verb of a device, the dead man's among them."""
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
    made = scanner(watched, dead_man=watched, **changes)
    return made, seen


def test_each_device_acts_in_its_state_and_under_the_lease() -> None:
    made, seen = states(Bench())
    events = list(run(Tour(0.0), made, stay=True))
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


def test_a_guard_that_nobody_armed_moves_and_fires_nothing() -> None:
    bench = Bench()
    made = scanner(bench, arms_itself=False)
    drain(run(Tour(0.0), made), LimitError)
    with pytest.raises(LimitError, match="no leave to permit pulses"):
        made.measure_dark()
    assert bench.log == ["disarm", "stop"]
    made.guard.arm(by="a test")
    assert made.measure(0.0).angle_deg == 0.0


def test_a_run_leaves_the_guard_disarmed_and_the_next_needs_a_person() -> None:
    made = scanner(Bench(), arms_itself=False)
    made.guard.arm(by="a test")
    list(run(Tour(0.0), made, stay=True))
    with pytest.raises(LimitError, match="arm it"):
        made.measure(0.0)


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


@pytest.mark.parametrize(
    ("bench", "state"),
    [
        (Bench(short_by_deg=0.2), State.FAULT),
        (Bench(missing_pulses=1), State.FAULT),
        (Bench(bad_frames=3), State.FAULT),
        (Bench(bad_frames=2), State.DISARMED),
    ],
)
def test_evidence_against_a_device_is_a_fault_and_a_frame_refused_twice_is_not(bench: Bench, state: State) -> None:
    made = scanner(bench)
    with contextlib.suppress(DeviceError):
        list(run(Tour(0.0), made, stay=True))
    assert made.guard.state is state


def test_an_angle_outside_is_the_policys_fault_and_not_the_rigs() -> None:
    made = scanner(Bench())
    drain(run(Tour(36.0), made), LimitError)
    assert made.guard.state is State.DISARMED


def test_a_saturated_frame_ends_the_search_and_is_no_fault_of_a_device() -> None:
    class Loud(Bench):
        def read(self, frame: Frame) -> Reading:
            return replace(super().read(frame), saturated_fraction=0.5)

    made = scanner(Loud())
    events = drain(run(Tour(0.0), made), SaturationError)
    assert kinds(events) == ["Started", "Failed"]
    assert made.guard.state is State.DISARMED


def test_ctrl_c_in_mid_move_stops_the_rig_and_disarms_it() -> None:
    bench = broken("move_to", KeyboardInterrupt())  # type: ignore[arg-type]
    made = scanner(bench)
    with pytest.raises(KeyboardInterrupt):
        list(run(Tour(0.0), made))
    assert bench.log == ["disarm", "stop"]
    assert made.guard.state is State.DISARMED


def test_a_probe_that_stands_outside_its_travel_ends_the_run_before_it_begins() -> None:
    bench = Bench(angle_deg=-40.0)
    made = scanner(bench)
    events = drain(run(Tour(0.0), made), LimitError)
    assert kinds(events) == ["Failed"]
    assert made.guard.state is State.FAULT
    assert bench.log == ["disarm", "stop"]


def test_a_probe_that_creeps_between_arrival_and_firing_is_not_fired_at() -> None:
    class Creeping(Bench):
        def arm(self, permit: Permit) -> None:
            self.angle_deg += 0.2

    bench = Creeping()
    drain(run(Tour(0.0), scanner(bench)), MoveError)
    assert not [entry for entry in bench.log if entry.startswith("fire")]


def test_a_receiver_that_takes_longer_than_the_permit_lives_is_not_fired_for() -> None:
    class Slow(Bench):
        def arm(self, permit: Permit) -> None:
            self.time_s += 31.0

    bench = Slow()
    drain(run(Tour(0.0), scanner(bench)), LaserError)
    assert not [entry for entry in bench.log if entry.startswith("fire")]


@pytest.mark.parametrize("verb", ["disarm", "stop"])
def test_a_device_that_does_not_stop_is_a_fault(verb: str) -> None:
    made = scanner(broken(verb, OSError("jammed")))
    with pytest.raises(OSError, match="jammed"):
        made.stop()
    assert made.guard.state is State.FAULT


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"late_s": 6.0}, "the limit of age is 5.0 s"),
        ({"early_s": -1.0}, "permitted at"),
        ({"early_s": 1.0}, "permitted at"),
        ({"early_s": float("nan")}, "taken from nan"),
        ({"intensity": 7.0}, "those of the frame before"),
        ({"sequence": 0}, "frame out of order"),
        ({"pulses": 15}, "15 pulses were seen"),
        ({"after_deg": 0.06}, "the probe moved by 0.060 deg"),
    ],
)
def test_a_frame_of_another_time_place_or_light_never_reaches_the_policy(
    changes: dict[str, float], reason: str
) -> None:
    class Late(Bench):
        def acquire(self, permit: Permit) -> Frame:
            frame = super().acquire(permit)
            assert isinstance(frame, ReadingFrame)
            taken_s = self.time_s + changes.get("early_s", 0.0)
            self.time_s += changes.get("late_s", 0.0)
            self.angle_deg += changes.get("after_deg", 0.0)
            header = replace(
                frame.header,
                sequence=changes.get("sequence", frame.header.sequence),
                pulses=changes.get("pulses", permit.pulses),
                started_s=taken_s,
                ended_s=taken_s,
            )
            return replace(frame, header=header, intensity=changes.get("intensity", frame.intensity))

    policy = Tour(0.0, 1.0)
    events = drain(run(policy, scanner(Late())), AcquisitionError)
    reasons = [event.reason for event in events if isinstance(event, Refused)]
    assert reason in reasons[-1]
    assert len(policy.told) <= 1
