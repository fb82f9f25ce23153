"""Sessions that are kept: what a list says of each, and what is left of one that is deleted."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import structs

from markerseek.core import ConfigError, RecordError
from markerseek.registration import (
    SessionRecord,
    SpotCheck,
    SpotChecked,
    delete_session,
    kept_sessions,
)
from tests import registration_sessions as sessions


def session(folder: Path, *, begun: str, markers: int = 4, ended: bool = True) -> Path:
    """A session that is over, or was stopped."""
    record = SessionRecord.create(folder, structs.replace(sessions.BEGUN, begun=f"2026-01-{begun}T00:00:00+00:00"))
    for number in range(1, markers + 1):
        record.add(sessions.registered(number))
    if ended:
        record.add(sessions.ENDED)
    record.close()
    return folder


def test_the_newest_comes_first_with_its_state_errors_and_size(tmp_path: Path) -> None:
    session(tmp_path / "a", begun="01")
    session(tmp_path / "c", begun="03", ended=False)
    session(tmp_path / "b", begun="02", markers=2)
    (tmp_path / "d").mkdir()
    (tmp_path / "d" / "session.jsonl").write_bytes(b"nothing")
    (tmp_path / "other").mkdir()
    kept = kept_sessions(tmp_path)
    assert [Path(each.folder).name for each in kept] == ["c", "b", "a", "d"]
    assert [each.state for each in kept] == [
        "stopped, registered above the goal",
        "not registered",
        "registered above the goal",
        "cannot be read",
    ]
    report = sessions.registered(4).report
    assert (kept[2].tre_m, kept[2].tre95_m, kept[2].off_m) == (report.tre_m, report.tre95_m, None)
    assert (kept[1].registered, kept[1].tre_m) == (False, None)
    assert "it does not begin as the record of a session does" in kept[3].said
    for each in kept:
        assert each.size_bytes == sum(path.stat().st_size for path in Path(each.folder).iterdir())


def test_a_check_is_listed_with_the_error_at_its_spot(tmp_path: Path) -> None:
    record = sessions.begin(tmp_path / "a", markers=4)
    check = SpotCheck(
        name="check-1",
        trus_m=(0.0, 0.0, 0.05),
        camera_m=(0.0, 0.0, 0.1),
        transformed_m=(0.0, 0.0, 0.051),
        off_m=1e-3,
        expected_m=1e-3,
        expected95_m=2e-3,
        exceeded=0.4,
    )
    record.add(SpotChecked(check=check, chosen=sessions.registered(4).chosen))
    [running] = kept_sessions(tmp_path)
    assert (running.state, running.off_m) == ("running", 1e-3)
    with pytest.raises(RecordError, match="another markerseek runs this session; wait until it ends"):
        delete_session(tmp_path / "a")
    record.close()


def test_what_a_session_wrote_is_deleted_and_nothing_else(tmp_path: Path) -> None:
    folder = session(tmp_path / "a", begun="01")
    for name in ("1.journal", "1-left.png", "left.jpg", "report.pdf"):
        (folder / name).write_bytes(b"of the session")
    (folder / "notes.txt").write_text("mine", encoding="utf-8")
    assert delete_session(folder) == ["notes.txt"]
    assert [each.name for each in folder.iterdir()] == ["notes.txt"]
    with pytest.raises(ConfigError, match="it is no folder of a session"):
        delete_session(folder)
    assert delete_session(session(tmp_path / "b", begun="02")) == []
    assert not (tmp_path / "b").exists()


def test_nothing_is_deleted_through_a_link(tmp_path: Path) -> None:
    folder = session(tmp_path / "a", begun="01")
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(ConfigError, match="or a link to one; name the folder itself"):
        delete_session(tmp_path / "link")
    outside = tmp_path / "outside.journal"
    outside.write_bytes(b"elsewhere")
    (folder / "1.journal").symlink_to(outside)
    delete_session(folder)
    assert outside.read_bytes() == b"elsewhere"
