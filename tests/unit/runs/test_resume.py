"""Resumed runs: equal to the whole run, never without arming, never with another policy."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from markerseek.core import (
    Asked,
    DeviceError,
    Failed,
    Finished,
    Measured,
    MoveError,
    Permit,
    PolicyPlan,
    RecordError,
    Refused,
)
from markerseek.guard import State
from markerseek.records.journal import Journal, read_journal, result_of, run_state, verify
from markerseek.runs import next_angle, rebuild_reader, recompute_differences
from markerseek.runs.journalled import journalled
from markerseek.runs.resume import resumed
from markerseek.search import build
from tests.unit.runs.journalled_runs import ACQUISITIONS, begin, live, resume_run, times_and_events


def test_a_journal_holds_what_run_reports(whole: Path) -> None:
    held = read_journal(whole)
    kinds = [type(entry.event).__name__ for entry in held.entries]
    assert kinds[0] == "Started"
    assert kinds[-1] == "Finished"
    assert kinds.count("Measured") == kinds.count("Asked") == 3 + ACQUISITIONS
    refused = [entry.event for entry in held.entries if isinstance(entry.event, Refused)]
    assert len(refused) >= 3
    # The reader of this run refuses by the number of the frame: each of them is kept.
    numbers = [event.frame.header.sequence for event in refused if event.frame is not None]
    assert numbers == [4 * count for count in range(1, len(refused) + 1)]
    assert verify(whole).faults == []
    by_kind = {type(entry.event): entry for entry in held.entries}
    assert by_kind[Measured].checkpoint is not None
    assert by_kind[Asked].checkpoint is None


def test_stopped_after_any_event_a_run_is_resumed_to_the_same_end(whole: Path, tmp_path: Path) -> None:
    wanted = read_journal(whole)
    for until in range(1, len(wanted.entries)):
        path = tmp_path / f"{until}.journal"
        live(path, until=until)
        assert times_and_events(read_journal(path)) == times_and_events(wanted)[:until]
        events = resume_run(path)
        held = read_journal(path)
        assert times_and_events(held) == times_and_events(wanted)
        assert events == [event for event, _ in times_and_events(wanted)]
        assert msgspec.json.encode(result_of(held)[1]) == msgspec.json.encode(result_of(wanted)[1])
        assert verify(path).faults == []


def test_a_run_may_be_stopped_many_times(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=3)
    total = len(read_journal(whole).entries)
    for until in range(5, total, 3):
        policy, rig, _ = begin()
        journal, held = Journal.reopen(path)
        with journal, closing(resumed(policy, rig, journal, held, by="a person")) as events:
            for _ in range(until):
                next(events)
        assert len(times_and_events(read_journal(path))) == until
    resume_run(path)
    assert times_and_events(read_journal(path)) == times_and_events(read_journal(whole))


def test_the_next_angle_is_the_one_that_was_asked_for(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    events = live(path, until=14)
    asked = [event.angle_deg for event in events if isinstance(event, Asked)]
    following = [entry.event.angle_deg for entry in read_journal(whole).entries if isinstance(entry.event, Asked)]
    measured = sum(isinstance(event, Measured) for event in events)
    assert len(asked) in (measured, measured + 1)
    assert next_angle(read_journal(path), begin()[0]) == following[measured]


def test_a_fault_is_left_by_a_reset_only(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    sound = rig.stage.move_to
    moves = 0

    def sticks(angle_deg: float) -> float:
        nonlocal moves
        moves += 1
        return sound(angle_deg) + (1.0 if moves == 4 else 0.0)

    rig.stage.move_to = sticks  # type: ignore[method-assign]
    with Journal.create(path, configuration) as journal, pytest.raises(MoveError):
        list(journalled(policy, rig, journal))
    held = read_journal(path)
    assert isinstance(held.entries[-1].event, Failed)
    with pytest.raises(DeviceError, match=r"ended with a fault: the stage was sent .* --reset-fault"):
        resume_run(path)
    assert len(read_journal(path).entries) == len(held.entries)
    events = resume_run(path, reset_fault=True)
    assert isinstance(events[-1], Finished)
    assert verify(path).faults == []
    assert recompute_differences(read_journal(path), begin()[0], rebuild_reader(configuration)) == []


def test_a_fault_during_the_check_is_kept_as_well(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    _, rig, _ = begin()
    sound = rig.stage.move_to
    rig.stage.move_to = lambda angle_deg: sound(angle_deg) + 1.0  # type: ignore[method-assign]
    with pytest.raises(MoveError):
        resume_run(path, rig=rig)
    assert run_state(read_journal(path).entries).state == "fault"
    with pytest.raises(DeviceError, match="--reset-fault"):
        resume_run(path)


def test_a_run_that_is_over_is_not_resumed(whole: Path) -> None:
    journal, held = Journal.reopen(whole)
    policy, rig, _ = begin()
    with journal, pytest.raises(RecordError, match="the run is over"):
        next(resumed(policy, rig, journal, held, by="a person"))


def test_a_policy_that_decides_otherwise_is_refused_before_it_fires(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=16)
    _, rig, _ = begin()
    journal, held = Journal.reopen(path)
    other = build(PolicyPlan(method="ternary", acquisitions=ACQUISITIONS), limits=rig.limits.search)
    fired: list[Permit] = []
    moved: list[float] = []
    rig.laser.fire = fired.append  # type: ignore[assignment, method-assign]
    rig.stage.move_to = moved.append  # type: ignore[assignment, method-assign]
    with journal, pytest.raises(RecordError, match=r"decides differently .* resume with its first versions"):
        list(resumed(other, rig, journal, held, by="a person"))
    assert times_and_events(read_journal(path)) == times_and_events(held)
    assert rig.scanner.guard.state is State.DISARMED
    assert fired == moved == []


def test_a_simulated_run_without_its_state_cannot_be_resumed(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    worldless = replace(rig, world=None)
    with Journal.create(path, configuration) as journal, closing(journalled(policy, worldless, journal)) as events:
        for _ in range(8):
            next(events)
    with pytest.raises(RecordError, match="no state of the simulated world"):
        resume_run(path)


def test_a_run_on_devices_that_outlive_the_program_is_resumed_without_their_state(tmp_path: Path) -> None:
    """As with real devices: no state is kept, and the clock of another process began at another time."""
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    rig = replace(rig, world=None)
    rig.scanner.clock.wait(1000.0)
    with Journal.create(path, configuration) as journal, closing(journalled(policy, rig, journal)) as events:
        for _ in range(16):
            next(events)
    rig.scanner.clock.set(5.0)  # type: ignore[attr-defined]
    rest = resume_run(path, rig=rig)
    held = read_journal(path)
    times = [at_s for _, at_s in times_and_events(held)]
    assert times == sorted(times)
    assert times[0] == 1000.0
    over = rest[-1]
    assert isinstance(over, Finished)
    assert over.acquisitions == ACQUISITIONS
    assert over.elapsed_s == times[-1] - 1000.0 > 0
    assert verify(path).faults == []
    assert recompute_differences(held, begin()[0], rebuild_reader(held.configuration)) == []


def test_a_run_that_never_started_begins_when_it_is_armed(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    Journal.create(path, begin()[2]).close()
    resume_run(path)
    assert times_and_events(read_journal(path)) == times_and_events(read_journal(whole))
