"""A session that is followed while it is written: whole steps only, each once, also where it is continued."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from markerseek.core import RecordError
from markerseek.registration import Ended, SessionRecord, SpotRefused, follow_session, read_session
from tests.registration_sessions import BEGUN


def refused(name: str) -> SpotRefused:
    return SpotRefused(name=name, reason="no light")


def test_steps_come_as_they_are_written_and_those_of_a_continued_session_too(tmp_path: Path) -> None:
    folder = tmp_path / "session"

    def writes() -> Iterator[None]:
        yield
        record = SessionRecord.create(folder, BEGUN)
        yield
        record.add(refused("1"))
        record.add(refused("2"))
        yield
        # Killed within a line: the half is cut off when the session is continued.
        record.close()
        with (folder / "session.jsonl").open("ab") as file:
            file.write(b"0000")
        yield
        record = SessionRecord.reopen(folder)
        record.add(refused("3"))
        yield
        record.add(Ended(registered=False, said="over", rig_s=1.0))
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
        waits.append(record.add(refused("1")))
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
    record.add(refused("1"))
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
