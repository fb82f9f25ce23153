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
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from markerseek.core import MarkerCandidate, MarkerPosition, RecordError
from markerseek.registration import (
    REGISTRATION,
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
    path = tmp_path / "s" / REGISTRATION
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
        assert read_session(tmp_path / "s")[0] == expected
        record = SessionRecord.reopen(tmp_path / "s")
        record.add(WAITING)
        record.close()
        assert read_session(tmp_path / "s")[0] == [*expected, WAITING]


def test_each_changed_byte_is_named(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    whole = path.read_bytes()
    for place in range(len(whole)):
        for bit in (0x01, 0x20):
            changed = bytearray(whole)
            changed[place] ^= bit
            path.write_bytes(changed)
            with pytest.raises(RecordError, match=r"session\.jsonl.*(check sum|was changed)"):
                read_session(tmp_path / "s")


def test_a_first_line_that_was_never_finished_is_no_session(tmp_path: Path) -> None:
    path = written(tmp_path / "s")
    path.write_bytes(path.read_bytes()[:50])
    SessionRecord.create(tmp_path / "s", BEGUN).close()
    assert read_session(tmp_path / "s")[0] == [BEGUN]
    with pytest.raises(RecordError, match="it holds a session already; continue it by --continue"):
        SessionRecord.create(tmp_path / "s", BEGUN)


def test_there_is_one_writer_and_those_who_look_on_do_not_disturb_it(tmp_path: Path) -> None:
    record = SessionRecord.create(tmp_path / "s", BEGUN)
    for second in (lambda: SessionRecord.reopen(tmp_path / "s"), lambda: SessionRecord.create(tmp_path / "s", BEGUN)):
        with pytest.raises(RecordError, match="another markerseek runs this session; wait until it ends"):
            second()
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
    assert read_session(tmp_path / "s")[0] == [BEGUN, WAITING]


def test_a_full_disk_leaves_no_part_of_a_step_and_room_lets_it_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    record = SessionRecord.create(tmp_path / "s", BEGUN)
    write, room = os.write, [30]

    def full(descriptor: int, data: bytes) -> int:
        if not room[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = write(descriptor, bytes(data[: room[0]]))
        room[0] -= taken
        return taken

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(RecordError, match="No space left on device; make room on the disk"):
            record.add(WAITING)
    assert (tmp_path / "s" / "session.jsonl").read_bytes().endswith(b"}\n")
    record.add(ENDED)
    assert read_session(tmp_path / "s")[0] == [BEGUN, ENDED]
    record.close()
    with monkeypatch.context() as patch:
        patch.setattr(os, "write", full)
        with pytest.raises(RecordError, match="No space left on device"):
            SessionRecord.create(tmp_path / "new", BEGUN)
    # Once there is room, the same folder can be taken.
    SessionRecord.create(tmp_path / "new", BEGUN).close()


def test_a_marker_that_was_measured_again_is_no_marker_more(tmp_path: Path) -> None:
    record = SessionRecord.create(tmp_path / "s", BEGUN)
    record.add(taken("1"))
    record.add(taken("1-again", again="1"))
    assert [each.name for each in record.taken] == ["1"]
    record.close()
    record = SessionRecord.reopen(tmp_path / "s")
    assert [each.name for each in record.taken] == ["1"]
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
    assert steps == read_session(folder)[0]
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
    steps, _ = read_session(folder)
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
    assert good in read_session(tmp_path / "s")[0]
    path = tmp_path / "s" / "session.jsonl"
    path.write_bytes(path.read_bytes().replace(*changed_line(good, changes)))
    with pytest.raises(RecordError) as caught:
        read_session(tmp_path / "s")
    assert said in str(caught.value)


def changed_line(step: TakenMarker, changes: dict[str, object]) -> tuple[bytes, bytes]:
    """The JSON of a step, and the same with other values; each behind its check sum."""
    lines = []
    for values in (msgspec.to_builtins(step), msgspec.to_builtins(step) | msgspec.to_builtins(changes)):
        text = msgspec.json.encode(values) + b"\n"
        lines.append(b"%08x " % zlib.crc32(text) + text)
    return lines[0], lines[1]
