"""Devices that fail before a run, between runs and during a resume: each is a persistent fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from markerseek.core import DeviceError, Finished, MoveError, NotConnectedError
from markerseek.records.journal import Journal, Resuming, read_journal, run_state, verify
from markerseek.rigs import Rig
from markerseek.runs.journalled import journalled
from tests.unit.runs.journalled_runs import begin, live, resume_run


class Silent:
    """A stage that does not answer."""

    @property
    def angle_deg(self) -> float:
        raise NotConnectedError("stage: it does not answer")

    def stop(self) -> None:
        """Nothing to stop."""


def unstoppable(rig: Rig) -> None:
    def stop() -> None:
        raise MoveError("the stage does not stop")

    rig.stage.stop = stop  # type: ignore[method-assign]


def test_a_stage_that_does_not_answer_ends_a_run_before_it_begins(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    rig.scanner._stage = Silent()  # type: ignore[assignment]
    with Journal.create(path, configuration) as journal, pytest.raises(NotConnectedError):
        list(journalled(policy, rig, journal))
    assert verify(path).faults == []
    with pytest.raises(DeviceError, match=r"stage: it does not answer; .* --reset-fault"):
        resume_run(path)
    events = resume_run(path, reset_fault=True)
    assert isinstance(events[-1], Finished)
    assert verify(path).faults == []
    kinds = [type(entry.event).__name__ for entry in read_journal(path).entries]
    assert kinds[:3] == ["Failed", "Resuming", "Started"]
    (note,) = [entry.event for entry in read_journal(path).entries if isinstance(entry.event, Resuming)]
    assert (note.by, note.fault_reset, note.check_deg, note.flank_deg) == ("a person", True, None, None)


def test_a_stage_that_cannot_be_stopped_after_a_check_is_a_fault(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    live(path, until=20)
    _, rig, _ = begin()
    unstoppable(rig)
    with pytest.raises(MoveError, match="does not stop"):
        resume_run(path, rig=rig)
    stands = run_state(read_journal(path).entries)
    assert (stands.state, stands.fault) == ("fault", "the stage does not stop")
    assert verify(path).faults == []


def test_a_stage_that_cannot_be_stopped_with_the_run_is_a_fault(tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    policy, rig, configuration = begin()
    unstoppable(rig)
    with Journal.create(path, configuration) as journal:
        events = journalled(policy, rig, journal)
        for _ in range(14):
            next(events)
        with pytest.raises(MoveError):
            events.close()
    assert run_state(read_journal(path).entries).state == "fault"
    assert verify(path).faults == []
    with pytest.raises(DeviceError, match="--reset-fault"):
        resume_run(path)
    assert isinstance(resume_run(path, reset_fault=True)[-1], Finished)
