"""A search from outside: the ordinary command as a child process, its events, its end, and the end of its parent."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

from markerseek import rigs
from markerseek.bridges import ChildRun, Outcome, Searches, SearchOptions, SearchRequest
from markerseek.bridges.igtl.commands import search_request
from markerseek.bridges.run_images import PicturedItem
from markerseek.core import ConfigError, Finished, Measured, SearchError, SearchPlan
from markerseek.records.journal import Configuration, Interrupted, JournalEntry, JournalItem, read_journal
from markerseek.runs import new_run, plan_on
from tests.waiting import wait_until

SEED = 3


@pytest.fixture(autouse=True)
def _own_data_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


def events_of(items: list[JournalItem]) -> list[JournalEntry]:
    return [item for item in items if isinstance(item, JournalEntry)]


def test_a_child_sends_the_events_and_gives_the_answer_of_the_same_search_in_this_process() -> None:
    rig = rigs.simulated(seed=SEED)
    plan = plan_on(rig, SearchPlan(method="golden-section", acquisitions=5, start_deg=0.0))
    run = new_run(rig, plan)
    expected = list(run.events())
    child = ChildRun(
        ["search", "--method", "golden-section", "--acquisitions", "5", "--seed", str(SEED), "--no-journal"]
    )
    items = list(child.items())
    outcome = child.outcome()
    assert isinstance(items[0], Configuration)
    assert items[0].plan == plan
    received = [item.event for item in events_of(items)]
    assert received == expected
    for one, other in zip(received, expected, strict=True):
        if isinstance(one, Measured) and isinstance(other, Measured):
            assert (one.sample.frame.samples == other.sample.frame.samples).all()
    result = run.result()
    assert outcome.exit_code == (0 if result.found else 3)
    assert outcome.printed["angle_deg"] == result.angle_deg
    assert [sample["angle_deg"] for sample in outcome.printed["samples"]] == [s.angle_deg for s in result.samples]


def test_a_child_that_is_stopped_says_so_and_its_exit_code_is_passed_on(tmp_path: Path) -> None:
    journal = tmp_path / "run.journal"
    child = ChildRun(["search", "--seed", "1", "--pace", "0.2", "--journal", str(journal)], journal=journal)
    items = child.items()
    next(item for item in items if isinstance(item, JournalEntry) and isinstance(item.event, Measured))
    for _ in range(20):
        # Escape that is held down; only the first counts.
        child.stop()
    rest = list(items)
    outcome = child.outcome()
    assert isinstance(events_of(rest)[-1].event, Interrupted)
    assert outcome.exit_code == 128 + signal.SIGINT
    assert outcome.message == "stopped by the user"
    assert isinstance(read_journal(journal).entries[-1].event, Interrupted)


@pytest.mark.parametrize("after_s", [0.0, 0.01, 0.02, 0.05])
def test_a_child_that_is_stopped_while_python_starts_is_no_fault_and_prints_no_trace(
    after_s: float, capfd: pytest.CaptureFixture[str]
) -> None:
    child = ChildRun(["search", "--seed", "1", "--no-journal"])
    # At any moment of the start.
    time.sleep(after_s)
    child.stop()
    outcome = child.outcome()
    assert (outcome.failed, outcome.answered) == (False, False)
    assert outcome.exit_code == 128 + signal.SIGINT
    assert outcome.printed == {"error": "stopped by the user", "kind": "KeyboardInterrupt"}
    assert capfd.readouterr().err == "error: stopped by the user\n"


@pytest.mark.long
@pytest.mark.real_time
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "hung"])
def test_26_7_a_child_whose_bridge_is_killed_or_hangs_stops_the_search_within_5_s(tmp_path: Path, how: int) -> None:
    journal = tmp_path / "run.journal"
    bridge = (
        "import sys\n"
        "from markerseek.bridges import ChildRun\n"
        "from pathlib import Path\n"
        f"journal = {str(journal)!r}\n"
        "arguments = ['search', '--seed', '1', '--pace', '0.5', '--journal', journal]\n"
        "child = ChildRun(arguments, journal=Path(journal))\n"
        "for item in child.items():\n"
        "    print(child.process_id, flush=True)\n"
    )
    with subprocess.Popen([sys.executable, "-c", bridge], stdout=subprocess.PIPE, text=True) as process:
        for _ in range(4):
            child = int(process.stdout.readline())
        watched = os.pidfd_open(child)
        process.send_signal(how)
        # Readable once the child has ended, although it is no child of this process.
        # 5 s are promised; the others are for a busy computer, and the search by itself takes longer.
        ready, _, _ = select.select([watched], [], [], 9)
        os.close(watched)
        process.kill()
    assert ready
    last = read_journal(journal).entries[-1].event
    assert last == Interrupted(reason="another program (SIGTERM)")


@pytest.mark.parametrize(
    ("answer", "reason", "said"),
    [
        ("found", None, "found at 1.700°"),
        ("not found", "no signal above the detection threshold", "not found: no signal above the detection threshold"),
        (
            "unsure",
            "the confirmation was weaker",
            "unsure: the confirmation was weaker; best guess 1.700°, not claimed",
        ),
    ],
)
def test_an_angle_is_said_and_claimed_only_where_a_marker_was_found(answer: str, reason: str | None, said: str) -> None:
    outcome = Outcome.of(0, msgspec.json.encode({"answer": answer, "angle_deg": 1.7, "reason": reason}))
    assert outcome.message == said


def test_of_a_published_form_nothing_is_claimed_and_a_kill_is_named() -> None:
    answer = {"answer": "found", "angle_deg": 1.7, "reason": None, "as_published": True}
    message = Outcome.of(0, msgspec.json.encode(answer)).message
    assert message == "angle 1.700°, nothing is claimed"
    killed = Outcome(exit_code=137).message
    assert killed == "the command ended with exit code 137, by SIGKILL"


def test_an_error_is_one_sentence(tmp_path: Path) -> None:
    child = ChildRun(["search", "--no-journal", "--rig", str(tmp_path / "none.toml")])
    assert list(child.items()) == []
    outcome = child.outcome()
    assert outcome.exit_code == 2
    assert "none.toml" in outcome.message


def test_a_second_search_is_refused_while_one_runs() -> None:
    items: list[PicturedItem] = []
    outcomes: list[Outcome] = []
    started: list[int] = []
    searches = Searches(SearchOptions(pace=0.02), on_start=started.append, on_item=items.append, on_end=outcomes.append)
    assert searches.stop() == (False, "no search is running")
    searches.start(SearchRequest().changed(seed=1))
    with pytest.raises(SearchError, match="a search is running; stop it, or wait for its end"):
        searches.start(SearchRequest().changed(seed=2))
    assert searches.stop() == (True, "the search is being stopped")
    searches.close()
    assert [each.stopped for each in outcomes] == [True]
    items.clear()
    searches.start(SearchRequest().changed(method="ternary", acquisitions=4))
    wait_until(lambda: not searches.running)
    assert outcomes[-1].answered
    assert isinstance(items[0], Configuration)
    assert isinstance(items[-1].entry.event, Finished)
    assert len(started) == 2


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("Method", "posterior --arm", "method"),
        ("Acquisitions", "1", "at least 2"),
        ("Acquisitions", "10000", "acquisitions is 10000"),
        ("Acquisitions", "nan", "acquisitions is 'nan', it must be a whole number"),
        ("Seed", "-1", "seed is -1"),
        ("Seed", "1 --arm", "seed is '1 --arm', it must be a whole number"),
        ("Stay", "yes", "stay is 'yes', it must be true or false"),
        ("ToleranceMm", "nan", "tolerance_mm is nan"),
        ("Rig", "/dev/tty", "StartSearch has no Rig"),
    ],
)
def test_what_a_program_may_not_ask_for_is_refused_with_a_sentence(field: str, value: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        search_request({field: value})


def test_a_request_becomes_options_that_arm_nothing_and_name_no_file() -> None:
    asked = SearchRequest().changed(method="ternary", acquisitions=8, as_published=True, stay=True, seed=5)
    method = ["--method=ternary", "--acquisitions=8", "--as-published", "--stay"]
    assert asked.arguments() == [*method, "--seed=5"]
    assert json.dumps(SearchOptions(rig=Path("a.toml"), pace=1.0).arguments()) == ('["--rig=a.toml", "--pace=1.0"]')


def test_devices_are_not_searched_without_a_journal_and_the_cure_is_one_that_there_is(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("no folder")
    assert SearchOptions().new_journal(method="posterior") is None
    bench = Path(__file__).parents[2] / "examples" / "rigs" / "bench.toml"
    with pytest.raises(
        SearchError, match=r"no journal can be written there.*a data folder in XDG_DATA_HOME that can be written"
    ):
        SearchOptions(rig=bench).new_journal(method="posterior")
