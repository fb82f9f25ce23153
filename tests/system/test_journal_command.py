"""Journals from the command line: written by a search, shown, verified, replayed, resumed after any end."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from markerseek.core import Measured
from markerseek.records.journal import RunView, read_journal
from tests.emulated import ran

Shell = Callable[..., tuple[int, str, str]]

SEARCH = ("search", "--seed", 3, "--method", "ternary", "--acquisitions", 8)


def journals(folder: Path) -> list[Path]:
    return sorted((folder / "data" / "markerseek" / "journals").glob("*.journal"))


def killed_search(path: Path, number: signal.Signals, *, after: int) -> subprocess.CompletedProcess[str]:
    """`markerseek search` in a process of its own, which sends itself a signal at its n-th acquisition."""
    before = (
        "import os\n"
        "from markerseek.records.journal import RunView\n"
        "add = RunView.add\n"
        "def add_and_kill(self, event, **clock):\n"
        "    view = add(self, event, **clock)\n"
        f"    if len(view.samples) == {after} and type(event).__name__ == 'Asked':\n"
        f"        os.kill(os.getpid(), {int(number)})\n"
        "    return view\n"
        "RunView.add = add_and_kill\n"
    )
    return ran(*SEARCH, "--journal", path, before=before)


def test_a_search_keeps_a_journal_in_the_users_data_folder(shell: Shell, tmp_path: Path) -> None:
    code, _, err = shell(*SEARCH)
    (path,) = journals(tmp_path)
    assert f"journal: {path}" in err.replace("\n", "")
    assert RunView.of(read_journal(path)).state == "finished"
    cut = path.with_name("cut")
    cut.write_bytes(path.read_bytes()[:-1])
    code, out, _ = shell("journal", "verify", cut)
    assert code == 0
    assert re.search(
        r"nothing is wrong; an unfinished entry of \d+ bytes behind them is ignored", " ".join(out.split())
    )
    cut.unlink()
    shell(*SEARCH, "--no-journal")
    assert journals(tmp_path) == [path]


def test_the_journal_gives_the_same_answer_as_the_search(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    searched = shell(*SEARCH, "--journal", path, "--json")
    resumed = shell("resume", path, "--json")
    assert resumed[:2] == searched[:2]
    code, out, _ = shell("journal", "show", path, "--json")
    shown = json.loads(out)
    assert (code, shown["state"], shown["damage"]) == (0, "finished", None)
    assert shown["configuration"]["recipe"]["settings"]["tissue"] == "plastisol-phantom"
    kinds = [entry["kind"] for entry in shown["entries"]]
    assert (kinds[0], kinds[-1]) == ("started", "finished")
    angles = [
        e["body"]["sample"]["angle_deg"]
        for e in shown["entries"]
        if e["kind"] == "measured" and not e["body"]["sample"]["dark"]
    ]
    printed = json.loads(searched[1])
    assert angles[: printed["acquisitions"]] == [sample["angle_deg"] for sample in printed["samples"]]
    assert json.loads(shell("journal", "verify", path, "--json")[1]) == {
        "ok": True,
        "entries": len(kinds),
        "faults": [],
        "unfinished_bytes": 0,
    }
    rows = [line.split() for line in shell("journal", "replay", path)[1].splitlines()]
    answers = [row[-1] for row in rows if row and row[0] in ("recorded", "from")]
    assert answers == 3 * answers[:1]
    again = json.loads(shell("journal", "replay", path, "--json")[1])
    assert again["recorded"]["angle_deg"] == printed["angle_deg"]
    assert again["recorded"] == again["from_the_samples"] == again["from_the_frames"]


def test_the_journals_of_a_folder_are_listed_with_their_ends(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert json.loads(shell("journal", "list", "--json")[1])["journals"] == []
    result = json.loads(shell(*SEARCH, "--json")[1])
    (kept,) = journals(tmp_path)
    killed = kept.with_name("killed.journal")
    killed_search(killed, signal.SIGKILL, after=2)
    kept.with_name("foreign.journal").write_text("text" * 999)
    code, out, _ = shell("journal", "list", "--json")
    printed = json.loads(out)
    by_name = {Path(each["path"]).name: each for each in printed["journals"]}
    # The newest first.
    assert (code, printed["count"], list(by_name)[-1]) == (0, 3, kept.name)
    over = by_name[kept.name]
    open_run = by_name["killed.journal"]
    assert (over["state"], over["answer"]) == ("finished", result["answer"])
    assert (over["angle_deg"], over["acquisitions"]) == (result["angle_deg"], 8)
    assert (over["seed"], "phantom" in over["description"]) == (3, True)
    assert (open_run["state"], open_run["answer"], open_run["acquisitions"]) == ("open", None, 2)
    assert open_run["size_bytes"] >= killed.stat().st_size > 0
    assert by_name["foreign.journal"]["state"] == "unreadable"
    assert printed["total_bytes"] == sum(each["size_bytes"] for each in printed["journals"])
    code, out, _ = shell("journal", "list", "--last", 1)
    assert (code, kept.name in out) == (0, False)
    assert "3 journals" in out
    assert "the newest 1 are listed" in out
    monkeypatch.setenv("TZ", "XYZ-3")
    time.tzset()
    try:
        assert f"{datetime.now(UTC) + timedelta(hours=3):%Y-%m-%d %H}" in shell("journal", "list")[1]
    finally:
        monkeypatch.undo()
        time.tzset()


def test_a_killed_search_is_resumed_once_it_is_armed(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    ended = killed_search(path, signal.SIGKILL, after=3)
    assert ended.returncode == -signal.SIGKILL
    before = len(read_journal(path).entries)
    code, out, err = shell("resume", path)
    assert code == 4
    assert "3 acquisitions are kept, the strongest is measured again" in out
    assert "nothing moved and nothing was fired; add --arm" in err
    code, out, _ = shell("resume", path, "--json")
    printed = json.loads(out)
    assert (code, printed["armed"], printed["acquisitions"]) == (4, False, 3)
    assert len(read_journal(path).entries) == before
    assert json.loads(shell("journal", "replay", path, "--json")[1])["recorded"] is None
    code, resumed, _ = shell("resume", path, "--arm", "--json")
    whole = json.loads(shell(*SEARCH, "--no-journal", "--json")[1])
    assert json.loads(resumed)["samples"][:3] == whole["samples"][:3]
    assert json.loads(resumed)["acquisitions"] == whole["acquisitions"]
    assert shell("resume", path, "--json")[:2] == (code, resumed)


def test_a_named_journal_that_cannot_be_written_is_an_error_before_anything_moves(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    path.write_text("mine")
    code, out, err = shell(*SEARCH, "--journal", path)
    assert (code, out) == (2, "")
    assert "exists already" in err
    assert path.read_text() == "mine"
    code, _, err = shell(*SEARCH, "--journal", tmp_path / "nowhere" / "run.journal")
    assert code == 2
    assert "cannot be written" in err.replace("\n", " ")
    code, _, err = shell(*SEARCH, "--journal", tmp_path / "other.journal", "--no-journal")
    assert (code, "leave one of them out" in err.replace("\n", " ")) == (2, True)


def test_a_data_folder_that_cannot_be_written_is_a_warning_on_a_simulated_rig(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "file"))
    code, out, err = shell(*SEARCH, "--json")
    assert code in (0, 3)
    assert json.loads(out)["acquisitions"] == 8
    assert "no journal is kept" in err


def test_a_damaged_journal_is_shown_as_far_as_it_is_whole(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "run.journal"
    shell(*SEARCH, "--journal", path)
    samples = next(
        e.event.sample.frame.samples for e in read_journal(path).entries[9:] if isinstance(e.event, Measured)
    )
    data = bytearray(path.read_bytes())
    data[data.index(samples.tobytes()[5000:5100])] ^= 1
    path.write_bytes(data)
    code, out, err = shell("journal", "show", path)
    assert code == 2
    assert "dark frame 1: " in out
    assert "does not agree with its checksum" in err.replace("\n", " ")
    code, out, _ = shell("journal", "verify", path)
    assert (code, "wrong:" in out) == (1, True)
    code, _, err = shell("resume", path, "--arm")
    assert (code, "error:" in err) == (2, True)
