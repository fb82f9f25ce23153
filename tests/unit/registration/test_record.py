"""The record of a session: torn, changed, full, written twice, followed while it is written, killed in a search."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from markerseek.core import MarkerCandidate, MarkerPosition, RecordError
from markerseek.records.journal import is_journal, line_of, read_journal
from markerseek.registration import (
    REGISTRATION_FILE,
    RecordedStep,
    Registered,
    SessionRecord,
    SpotRefused,
    TakenMarker,
    Waiting,
    follow_session,
    is_running,
    read_registration,
    read_session,
)
from tests.registration_sessions import BEGUN, ENDED, MOVED, WAITING, begin, kill, matrix_m, registered, taken

STEPS = [WAITING, SpotRefused(name="2", reason="no light"), MOVED, ENDED]


def written(folder: Path) -> Path:
    record = SessionRecord.create(folder, BEGUN)
    for step in STEPS:
        record.add(step)
    record.close()
    return folder / "session.jsonl"


def test_the_registration_is_a_file_as_long_as_it_holds(tmp_path: Path) -> None:
    record = begin(tmp_path / "s", markers=2)
    path = tmp_path / "s" / REGISTRATION_FILE
    assert not path.exists()
    for markers in (3, 4):
        record.add(registered(markers))
        known = read_registration(path)
        assert known.simulated
        assert known.davinci_to_trus.matrix == pytest.approx(matrix_m(markers))
    record.add(registered(5, decided=False))
    assert not path.exists()
    record.add(registered(5))
    record.add(MOVED)
    assert not path.exists()
    record.close()


def test_each_truncation_is_read_as_a_prefix_of_the_steps_and_continued_there(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    whole = path.read_bytes()
    ends = [number + 1 for number, byte in enumerate(whole) if byte == ord("\n")]
    for size in range(len(whole) + 1):
        path.write_bytes(whole[:size])
        expected = [BEGUN, *STEPS][: sum(end <= size for end in ends)]
        if not expected:
            with pytest.raises(RecordError, match="its first line is not finished, so that no session has begun"):
                read_session(tmp_path / "s")
            continue
        assert read_session(tmp_path / "s") == expected
        record = SessionRecord.reopen(tmp_path / "s")
        record.add(WAITING)
        record.close()
        assert read_session(tmp_path / "s") == [*expected, WAITING]


def test_each_changed_byte_is_named(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    whole = path.read_bytes()
    for place in range(len(whole)):
        for bit in (0x01, 0x20):
            changed = bytearray(whole)
            changed[place] ^= bit
            path.write_bytes(changed)
            with pytest.raises(RecordError, match=r"session\.jsonl.*(damaged|was changed)"):
                read_session(tmp_path / "s")


def test_a_folder_with_a_session_or_a_file_of_another_program_is_not_taken(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    whole = path.read_bytes()
    for content, said in (
        (whole, "it holds a session already; continue that session"),
        (whole[:50], "it holds a session already"),
        (b"name,value\n1,2\n", "it is a file of another program; name another folder"),
    ):
        path.write_bytes(content)
        with pytest.raises(RecordError, match=said):
            SessionRecord.create(tmp_path / "s", BEGUN)
        assert path.read_bytes() == content


def test_there_is_one_writer_and_those_who_look_on_do_not_disturb_it(tmp_path: Path) -> None:
    record = SessionRecord.create(tmp_path / "s", BEGUN)
    with pytest.raises(RecordError, match="another markerseek runs this session; wait until it ends"):
        SessionRecord.reopen(tmp_path / "s")
    with pytest.raises(RecordError, match="it holds a session already"):
        SessionRecord.create(tmp_path / "s", BEGUN)
    # A refused writer cuts nothing off.
    record.add(WAITING)
    record.close()
    assert not is_running(tmp_path / "s")
    over = threading.Event()

    def look() -> None:
        while not over.is_set():
            is_running(tmp_path / "s")

    looking = [threading.Thread(target=look) for _ in range(3)]
    for each in looking:
        each.start()
    for _ in range(30):
        SessionRecord.reopen(tmp_path / "s").close()
    over.set()
    for each in looking:
        each.join()
    assert read_session(tmp_path / "s") == [BEGUN, WAITING]


def test_a_full_disk_leaves_no_part_of_a_step_and_room_lets_it_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = SessionRecord.create(tmp_path / "s", BEGUN)
    write = os.pwrite
    room = [30]

    def full(descriptor: int, data: bytes, at: int) -> int:
        if not room[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = write(descriptor, bytes(data[: room[0]]), at)
        room[0] -= taken
        return taken

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        with pytest.raises(RecordError, match="No space left on device; make room on the disk"):
            record.add(WAITING)
    assert (tmp_path / "s" / "session.jsonl").read_bytes().endswith(b"}\n")
    record.add(ENDED)
    assert read_session(tmp_path / "s") == [BEGUN, ENDED]
    record.close()
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        with pytest.raises(RecordError, match="No space left on device"):
            SessionRecord.create(tmp_path / "new", BEGUN)
    # Once there is room, the same folder can be taken.
    SessionRecord.create(tmp_path / "new", BEGUN).close()


def test_a_marker_that_was_measured_again_is_no_marker_more(tmp_path: Path) -> None:
    record = SessionRecord.create(tmp_path / "s", BEGUN)
    record.add(taken("1"))
    record.add(taken("1-again", again="1"))
    assert [each.name for each in record.view.markers] == ["1"]
    record.close()
    record = SessionRecord.reopen(tmp_path / "s")
    assert [each.name for each in record.view.markers] == ["1"]
    record.close()


@pytest.mark.parametrize("lines", [[0, 1, 3], [0, 1, 1, 2, 3], [0, 2, 1, 3]], ids=["removed", "doubled", "exchanged"])
def test_a_step_that_is_missing_or_recorded_twice_is_named(tmp_path: Path, lines: list[int]) -> None:
    path = written(tmp_path / "s")
    kept = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(kept[number] for number in lines))
    with pytest.raises(RecordError, match=r"session\.jsonl: entry \d is missing, entry \d follows; it is damaged"):
        read_session(tmp_path / "s")


def test_the_record_of_a_session_is_no_journal_of_a_search(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    assert not is_journal(path)
    with pytest.raises(RecordError, match="it is the record of a registration session; name the journal of a search"):
        read_journal(path)


def former(folder: Path, *steps: RecordedStep) -> Path:
    """The record of a session of markerseek 0.4."""
    folder.mkdir()
    texts = [msgspec.json.encode(step) + b"\n" for step in (BEGUN, *steps)]
    path = folder / "session.jsonl"
    path.write_bytes(b"".join(b"%08x " % zlib.crc32(text) + text for text in texts))
    return path


def test_a_session_of_version_0_4_is_read_and_continued_with_all_its_steps(tmp_path: Path) -> None:
    steps = [taken("1"), taken("2"), registered(3), WAITING]
    path = former(tmp_path / "s", *steps)
    with path.open("ab") as file:
        file.write(b"0123abcd {")
    assert read_session(tmp_path / "s") == [BEGUN, *steps]
    assert list(follow_session(tmp_path / "s", wait=lambda: None)) == [BEGUN, *steps]
    record = SessionRecord.reopen(tmp_path / "s")
    record.add(taken("3"))
    record.close()
    assert read_session(tmp_path / "s") == [BEGUN, *steps, taken("3")]
    assert SessionRecord.reopen(tmp_path / "s").view.registration is not None
    assert [each.name for each in tmp_path.joinpath("s").iterdir() if each.name.startswith(".")] == []


@pytest.mark.parametrize("names", [["1", "3"], ["1", "2", "2"], ["2", "1"]], ids=["removed", "doubled", "exchanged"])
def test_a_marker_of_version_0_4_that_is_missing_or_recorded_twice_is_named(tmp_path: Path, names: list[str]) -> None:
    former(tmp_path / "s", *(taken(name) for name in names))
    with pytest.raises(RecordError, match=r"session\.jsonl: marker \d follows where marker \d is due"):
        SessionRecord.reopen(tmp_path / "s")


def test_a_changed_byte_of_a_session_of_version_0_4_is_named(tmp_path: Path) -> None:
    path = former(tmp_path / "s", taken("1"))
    whole = path.read_bytes()
    for place in range(len(whole)):
        changed = bytearray(whole)
        changed[place] ^= 0x01
        path.write_bytes(changed)
        with pytest.raises(RecordError, match=r"session\.jsonl"):
            read_session(tmp_path / "s")


def test_a_session_of_a_newer_version_is_refused_with_what_to_do(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    path.write_bytes(line_of({"session": 3, "begun": {"type": "begun"}}))
    with pytest.raises(RecordError, match="the record has version 3, this one reads up to 2; install a newer one"):
        read_session(tmp_path / "s")


def test_a_full_disk_leaves_no_file_of_a_registration_that_holds_no_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = begin(tmp_path / "s", markers=3)
    path = tmp_path / "s" / REGISTRATION_FILE

    def full(_path: Path, _data: bytes) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(RecordError, match="No space left on device"):
            record.add(registered(4))
    assert not path.exists()
    record.close()
    SessionRecord.reopen(tmp_path / "s").close()
    assert read_registration(path).davinci_to_trus.matrix == pytest.approx(matrix_m(4))


def test_a_registration_that_could_not_be_withdrawn_for_want_of_room_still_has_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = begin(tmp_path / "s", markers=3)

    def full(_descriptor: int, _data: bytes, _at: int) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        with pytest.raises(RecordError, match="No space left on device"):
            record.add(MOVED)
    # The record does not say that it has moved.
    assert record.view.registration is not None
    assert read_registration(tmp_path / "s" / REGISTRATION_FILE).davinci_to_trus.matrix == pytest.approx(matrix_m(3))
    record.add(MOVED)
    assert not (tmp_path / "s" / REGISTRATION_FILE).exists()
    record.close()


def no_light(name: str) -> SpotRefused:
    return SpotRefused(name=name, reason="no light")


def test_steps_come_as_they_are_written_and_those_of_a_continued_session_too(tmp_path: Path) -> None:
    folder = tmp_path / "session"

    def writes() -> Iterator[None]:
        yield
        record = SessionRecord.create(folder, BEGUN)
        yield
        record.add(no_light("1"))
        record.add(no_light("2"))
        yield
        # Within a line: the half is cut off when the session is continued.
        kill(record)
        yield
        record = SessionRecord.reopen(folder)
        record.add(no_light("3"))
        yield
        record.add(ENDED)
        record.close()
        yield

    script = writes()
    more = [True]

    def wait() -> None:
        more[0] = next(script, "over") is None

    steps = list(follow_session(folder, is_over=lambda: not more[0], wait=wait))
    assert steps == read_session(folder)
    assert [getattr(step, "name", None) for step in steps] == [None, "1", "2", "3", None]


def test_without_an_end_it_ends_once_nobody_writes_and_a_changed_line_is_named(tmp_path: Path) -> None:
    record = SessionRecord.create(tmp_path / "session", BEGUN)
    waits = []

    def wait() -> None:
        waits.append(record.add(no_light("1")))
        record.close()

    assert len(list(follow_session(tmp_path / "session", wait=wait))) == 2
    assert len(waits) == 1
    path = tmp_path / "session" / "session.jsonl"
    os.truncate(path, 0)
    path.write_bytes(b'00000000 {"type":"waiting"}\n')
    with pytest.raises(RecordError, match="line 1: it does not agree with its check sum"):
        list(follow_session(tmp_path / "session", wait=wait))


@pytest.mark.parametrize("how", ["deleted", "cut"])
def test_a_record_whose_steps_are_gone_is_named(tmp_path: Path, how: str) -> None:
    record = SessionRecord.create(tmp_path / "session", BEGUN)
    record.add(no_light("1"))
    path = tmp_path / "session" / "session.jsonl"

    def wait() -> None:
        if how == "deleted":
            path.unlink()
        else:
            os.truncate(path, path.stat().st_size // 2)

    said = {"deleted": "deleted while it was followed", "cut": "not in it any more"}[how]
    with pytest.raises(RecordError, match=said):
        list(follow_session(tmp_path / "session", is_over=lambda: False, wait=wait))
    record.close()


def run(folder: Path, *until: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.unit.registration.killed_session", str(folder), *until]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=500)


def require_whole(folder: Path, last: subprocess.CompletedProcess[str]) -> None:
    """No marker is lost, none is asked for after it was taken, and the session is registered."""
    assert last.returncode == 0, last.stderr
    steps = read_session(folder)
    names: list[str] = []
    for step in steps:
        if isinstance(step, Waiting):
            assert step.name == str(1 + len(names))
        if isinstance(step, TakenMarker):
            assert step.name == str(1 + len(names))
            names.append(step.name)
    assert names == ["1", "2", "3"]
    state = [step for step in steps if isinstance(step, Registered)][-1]
    assert state.decided
    truth = json.loads(last.stdout)
    # Of markers that an earlier process took, only the camera knows where their spots were.
    assert truth["marker_errors_m"].keys() <= state.chosen.keys()
    assert truth["target_error_m"] < 4 * state.report.tre_m


def test_a_session_that_is_killed_in_a_search_looks_for_the_same_marker_again(tmp_path: Path) -> None:
    folder = tmp_path / "s"
    assert run(folder, "search", "2").returncode == -signal.SIGKILL
    former = (folder / "2.journal").read_bytes()
    require_whole(folder, run(folder))
    assert (folder / "2.journal").read_bytes() == former
    assert {path.name for path in folder.glob("*.journal")} == {"1.journal", "2.journal", "2-2.journal", "3.journal"}


SPOT_M2 = [[1e-8, 0.0, 0.0], [0.0, 1e-8, 0.0], [0.0, 0.0, 1e-6]]


def candidate(**changes: object) -> MarkerCandidate:
    position = {"position_m": (0.0, 0.01, 0.05), "sigma_m": (2e-4, 3e-4, 3e-4)} | changes
    return MarkerCandidate(angle_deg=4.0, probability=0.9, position=MarkerPosition(**position))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"camera_m": [0.0, 1e200, 0.1]}, "camera_m is [0.0, 1e+200, 0.1], 3 numbers within ± 10 are expected"),
        ({"camera_m": [0.0, 0.1]}, "camera_m is [0.0, 0.1], 3 numbers"),
        ({"camera_shared_m": [[0.0], [0.0, 1.0], [0.0]]}, "camera_shared_m is"),
        ({"camera_shared_m": [[0.0], [-1e30], [0.0]]}, "3 x n numbers within ± 10"),
        ({"camera_covariance_m2": [[1e-8, 0.0, 0.0]] * 3}, "which is no covariance of a spot"),
        ({"camera_covariance_m2": [[-1e-8, 0, 0], [0, 1e-8, 0], [0, 0, 1e-6]]}, "which is no covariance of a spot"),
        ({"candidates": [candidate(position_m=(1e30, 0.0, 0.0))]}, "the position of a candidate is (1e+30"),
        ({"candidates": [candidate(sigma_m=(0.0, 3e-4, 3e-4))]}, "from 1e-09 are expected"),
        ({"candidates": [replace(candidate(), probability=7.0)]}, "the probability of a candidate is 7"),
        ({"candidates": [replace(candidate(), angle_deg=1e9)]}, "the angle of a candidate is 1"),
    ],
)
def test_numbers_that_no_marker_has_are_named_though_their_sum_is_right(
    tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    good = taken("1", camera_covariance_m2=SPOT_M2, candidates=[candidate()])
    record = begin(tmp_path / "s")
    record.add(good)
    record.close()
    assert good in read_session(tmp_path / "s")
    path = tmp_path / "s" / "session.jsonl"
    first, _ = path.read_bytes().splitlines(keepends=True)
    body = msgspec.to_builtins(good) | msgspec.to_builtins(changes)
    path.write_bytes(first + line_of({"number": 1, "written": "2026-01-01T00:00:00+00:00", "body": body}))
    with pytest.raises(RecordError) as caught:
        read_session(tmp_path / "s")
    assert said in str(caught.value)
