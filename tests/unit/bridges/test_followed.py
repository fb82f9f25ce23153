"""The registration of a session that is followed: what holds, what holds no longer, and how the session stands."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from markerseek.bridges import RegistrationSource, open_registration
from markerseek.core import RecordError
from markerseek.records.journal import line_of
from markerseek.registration import SessionRecord, SessionView
from tests.registration_sessions import BEGUN, ENDED, MOVED, WAITING, begin, kill, matrix_m, registered
from tests.waiting import wait_until


def wait_for(source: RegistrationSource, wanted: Callable[[SessionView], bool]) -> SessionView:
    wait_until(lambda: wanted(source.view))
    return source.view


def test_a_session_that_is_killed_and_continued_goes_on(tmp_path: Path) -> None:
    record = begin(tmp_path / "s", markers=2)
    with open_registration(tmp_path / "s" / "session.jsonl") as source:
        assert (source.view.registration, source.view.phase) == (None, "running")
        record.add(registered(3))
        held = wait_for(source, lambda state: state.registration is not None)
        assert held.registration.davinci_to_trus.matrix == pytest.approx(matrix_m(3))
        assert (held.registration.errors["markers"], held.simulated) == (3, True)
        record.add(WAITING)
        kill(record)
        stopped = wait_for(source, lambda state: state.phase == "stopped")
        # The same object: it is not handed on once more.
        assert stopped.registration is held.registration
        assert "continue it" in stopped.sentence
        record = SessionRecord.reopen(tmp_path / "s")
        wait_for(source, lambda state: state.phase == "running")
        record.add(registered(4, decided=False))
        undecided = wait_for(source, lambda state: state.registration is None)
        assert undecided.said == "not certain after 4"
        record.add(registered(5))
        decided = wait_for(source, lambda state: state.registration is not None)
        assert decided.registration.davinci_to_trus.matrix == pytest.approx(matrix_m(5))
        record.add(ENDED)
        record.close()
        ended = wait_for(source, lambda state: state.phase == "ended")
        assert ended.registration is decided.registration


@pytest.mark.parametrize("damage", ["a byte is changed", "it is deleted"])
def test_a_record_that_cannot_be_read_any_more_withdraws_what_held(tmp_path: Path, damage: str) -> None:
    record = begin(tmp_path / "s", markers=3)
    path = tmp_path / "s" / "session.jsonl"
    with open_registration(tmp_path / "s") as source:
        assert source.view.registration is not None
        if damage == "it is deleted":
            path.unlink()
        else:
            with path.open("ab") as file:
                file.write(b'01234567 {"type":"waiting"}\n')
        lost = wait_for(source, lambda state: state.phase == "unreadable")
        assert lost.registration is None
        assert str(path) in lost.said
    record.close()


def test_a_marker_that_has_moved_withdraws_the_registration_for_good(tmp_path: Path) -> None:
    record = begin(tmp_path / "s", markers=4)
    with open_registration(tmp_path / "s") as source:
        assert source.view.registration is not None
        for step in (MOVED, ENDED):
            record.add(step)
        record.close()
        moved = wait_for(source, lambda state: state.phase == "ended")
        assert (moved.registration, moved.said) == (None, "marker 1 has moved")
        record = SessionRecord.reopen(tmp_path / "s")
        record.add(registered(4))
        again = wait_for(source, lambda state: state.phase == "running")
        assert again.registration is None
    record.close()


def test_a_session_whose_marker_has_moved_is_refused_by_its_folder_and_by_each_file_in_it(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    record = begin(folder, markers=4)
    held = (folder / "registration.json").read_bytes()
    # Continued by an older program, which said that it is registered, and left its file.
    for step in (MOVED, ENDED, registered(4), ENDED):
        record.add(step)
    record.close()
    (folder / "registration.json").write_bytes(held)
    for path in (folder, folder / "session.jsonl", folder / "registration.json"):
        with pytest.raises(RecordError, match=r"without a registration that holds \(marker 1 has moved\)"):
            open_registration(path)
    SessionRecord.reopen(folder).close()
    assert not (folder / "registration.json").exists()


def test_the_file_of_a_running_session_is_withdrawn_with_it(tmp_path: Path) -> None:
    record = begin(tmp_path / "s", markers=3)
    with open_registration(tmp_path / "s" / "registration.json") as source:
        assert source.view.registration is not None
        record.add(registered(4, decided=False))
        assert wait_for(source, lambda view: view.registration is None).reason == "marker 1 may be another source"
    record.close()


def test_an_ended_session_is_as_good_as_its_file(tmp_path: Path) -> None:
    record = begin(tmp_path / "s", markers=3)
    record.add(ENDED)
    record.close()
    (tmp_path / "registration.json").write_bytes(msgspec.json.encode(registered(3).report))
    for source in (open_registration(tmp_path / "s"), open_registration(tmp_path / "registration.json")):
        with source:
            assert source.view.registration.davinci_to_trus.matrix == pytest.approx(matrix_m(3))
            assert source.view.known["markers"] == 3


def test_a_file_of_a_simulation_is_handed_on_as_simulated(tmp_path: Path) -> None:
    path = tmp_path / "registration.json"
    values = msgspec.to_builtins(registered(3).report)
    for simulation in (None, {"seed": 1}):
        path.write_bytes(msgspec.json.encode(values | {"simulation": simulation}))
        with open_registration(path) as source:
            assert source.view.simulated == source.view.known["simulated"] == (simulation is not None)


def unfinished(folder: Path) -> None:
    folder.mkdir()
    (folder / "session.jsonl").write_bytes(b"0123abcd {")


def without_registration(folder: Path) -> None:
    record = begin(folder, markers=2)
    record.add(ENDED)
    record.close()


def of_another_version(folder: Path) -> None:
    SessionRecord.create(folder, BEGUN).close()
    with (folder / "session.jsonl").open("ab") as file:
        file.write(line_of({"number": 1, "body": {"type": "an unknown step"}}))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda folder: None, "s.json: it cannot be read: No such file"),
        (Path.mkdir, "there is no session.jsonl in it, so that no session has begun"),
        (unfinished, "its first line is not finished, so that no session has begun; begin a new one"),
        (without_registration, "has ended without a registration that holds .*register again"),
        (of_another_version, "another version of markerseek wrote it: use that one"),
    ],
)
def test_what_no_registration_can_come_of_is_refused(tmp_path: Path, make: Callable[[Path], object], said: str) -> None:
    make(tmp_path / "s.json")
    with pytest.raises(RecordError, match=said):
        open_registration(tmp_path / "s.json")
