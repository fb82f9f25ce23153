"""A child that is followed: its events, its end, STOP at any time, and streams that cannot be shown."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.bridges.outcome import Outcome
from markerseek.bridges.page.children import ChildSearch
from markerseek.bridges.page.controls import USUAL, USUAL_REGISTRATION
from markerseek.core import Failed, MoveError, RecordError, SearchError, SearchPlan
from markerseek.records.journal import Interrupted, JournalEntry
from markerseek.rigs import read_rig_file
from markerseek.runs import new_run, plan_on
from markerseek.show import STOPPED as STOPPED_LINE
from markerseek.show import event_line
from markerseek.sim import GaussianCurve
from tests.unit.bridges.page.scripted_child import BROWSER, STOPPED, ScriptedChild, searches
from tests.waiting import wait_until

RESUMED = "Start begins a new search;"
RESUME = "markerseek resume JOURNAL --rig rig.toml"
IN_TERMINAL = "in the terminal, goes on with this one"
GO_ON = "Go on continues it; Start begins a new search"


@pytest.fixture(scope="module")
def stream():
    """What the journal of a short search holds."""
    rig = rigs.of_intensities(seed=2, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=3.0)
    search = new_run(rig, plan_on(rig, SearchPlan(method="ternary", acquisitions=8, start_deg=0.0)))
    items = [search.configuration]
    for number, event in enumerate(search.events(), start=1):
        items.append(JournalEntry(number=number, written="", clock_s=rig.scanner.clock.now_s(), event=event))
    return items


@pytest.fixture
def followed(tmp_path):
    """A function that follows a scripted child, to its end unless told otherwise."""

    def follow(child, *, simulated=True, waits=True):
        journal = tmp_path / "run.journal"
        journal.touch()
        goes_on = ["resume", str(journal), *([] if simulated else ["--rig", "rig.toml"])]
        live = ChildSearch(child, asked=USUAL, journal=journal, goes_on=goes_on, simulated=simulated)
        if waits:
            live.end(30)
        return live

    return follow


def test_stop_ends_it(stream, followed):
    live = followed(ScriptedChild(stream[:5], endless=True), waits=False)
    live.stop()
    assert (live.verdict(None).word, live.verdict(None).kind) == ("STOPPING", "busy")
    live.end(30)
    assert live.message == STOPPED_LINE
    assert live.run is None or event_line(live.run.last) == STOPPED_LINE


@pytest.mark.parametrize(
    ("simulated", "said"), [(False, "; its supervisor disarms the laser and stops the stage"), (True, "")]
)
def test_search_that_is_killed_says_what_laser_and_stage_do(stream, followed, simulated, said):
    child = ScriptedChild(stream[:5])
    child.outcome = lambda: Outcome(exit_code=137)
    live = followed(child, simulated=simulated)
    assert live.message == f"the command ended with exit code 137, by SIGKILL{said}"
    verdict = live.verdict(live.run.last)
    assert (verdict.word, verdict.problem) == ("FAULT", "the command ended with exit code 137, by SIGKILL")
    assert verdict.reason == said.removeprefix("; ")


def entry(event):
    return JournalEntry(number=9, written="", clock_s=9.0, event=event)


LAST = {
    "stopped": [entry(Interrupted(reason="SIGINT"))],
    # Killed: its end is in no journal.
    "killed": [],
    "fault": [entry(Failed(error=MoveError("it did not arrive")))],
}


@pytest.mark.parametrize(
    ("simulated", "last", "said"),
    [
        (True, "stopped", GO_ON),
        (True, "killed", GO_ON),
        (True, None, GO_ON),
        (True, "fault", "Start begins a new search"),
        (False, None, "Start begins a new search"),
        (False, "stopped", f"{RESUMED} {RESUME}, {IN_TERMINAL}"),
        (False, "killed", f"{RESUMED} {RESUME}, {IN_TERMINAL}"),
        # The journal holds the fault: without the option the terminal would refuse.
        (
            False,
            "fault",
            f"{RESUMED} once the fault is repaired, {RESUME} --reset-fault, {IN_TERMINAL}",
        ),
    ],
)
def test_what_a_person_can_do_next(stream, followed, simulated, last, said):
    child = ScriptedChild([] if last is None else [*stream[:5], *LAST[last]])
    child.outcome = lambda: Outcome.of(1, b'{"error": "it did not arrive"}')
    live = followed(child, simulated=simulated)
    said = said.replace("JOURNAL", str(live.journal))
    assert (live.next_step, live.can_go_on) == (said, said == GO_ON)
    assert live.verdict(None if last is None else live.run.last).next_step == said


@pytest.mark.parametrize(
    ("simulated", "said"), [(True, ""), (False, "answer in the terminal where the page was started")]
)
def test_a_person_who_must_arm_devices_is_told_so_until_the_search_runs(stream, followed, simulated, said):
    child = ScriptedChild(endless=True)
    live = followed(child, simulated=simulated, waits=False)
    starting = live.verdict(None)
    assert (starting.word, starting.next_step) == ("STARTING", said)
    for item in stream[:3]:
        child.sent.put(item)
    wait_until(lambda: live.run is not None and len(live.run.views) >= 3)
    running = live.verdict(live.run.last)
    assert (running.word, running.next_step) == ("SEARCHING", "")
    live.stop()
    live.end(30)


@pytest.mark.parametrize(
    ("outcome", "word", "said"),
    [
        (Outcome.of(1, b'{"error": "no answer from the stage"}'), "FAULT", "no answer from the stage"),
        (Outcome(exit_code=4), "NOT ARMED", "nothing moved and nothing was fired; a person"),
        (STOPPED, "STOPPED", "the laser is disarmed"),
    ],
)
def test_search_that_ended_without_an_event_is_not_called_ready(followed, outcome, word, said):
    child = ScriptedChild()
    child.outcome = lambda: outcome
    verdict = followed(child, simulated=False).verdict(None)
    assert (verdict.word, verdict.angle, verdict.next_step) == (word, "", "Start begins a new search")
    assert (verdict.problem if outcome.failed else verdict.reason).startswith(said)


def test_stream_that_cannot_be_read_stops_the_child(stream, followed):
    child = ScriptedChild(stream[:5], error=RecordError("stream: no stream"))
    live = followed(child)
    assert (child.stopped.is_set(), live.message) == (True, "stream: no stream")
    # Nobody knows where the probe is that was on its way.
    last = live.run.last
    assert (last.phase, last.target_deg, event_line(last)) == ("cut off", None, "stream: no stream")


# The thread's own error is printed, as that of any thread.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_search_that_cannot_be_shown_is_stopped(stream, followed, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr("markerseek.bridges.page.run_history.RunHistory.add", broken)
    child = ScriptedChild(stream[:5], endless=True)
    live = followed(child)
    assert (child.stopped.is_set(), live.message) == (True, "the search cannot be shown; it was stopped")


def test_one_search_at_a_time(stream, tmp_path, monkeypatch):
    shared, asked = searches([ScriptedChild(stream[:5], endless=True)], tmp_path, monkeypatch)
    shared.start(USUAL.changed(seed=4), asked_by=BROWSER)
    for another in (
        lambda: shared.start(USUAL, asked_by=BROWSER),
        lambda: shared.start(USUAL_REGISTRATION, asked_by=BROWSER),
        lambda: shared.go_on(shared.search, asked_by=BROWSER),
    ):
        with pytest.raises(SearchError, match="a search or a registration runs"):
            another()
    shared.close()
    assert not shared.busy
    assert len(asked) == 1
    assert asked[0][:3] == ["search", "--seed=4", "--pace=0.05"]


def test_rig_of_devices_is_never_armed_from_the_page(stream, tmp_path, monkeypatch):
    children = [ScriptedChild(stream[:5], endless=True)]
    settings = read_rig_file(Path("examples/rigs/bench.toml"))
    shared, asked = searches(children, tmp_path, monkeypatch, file=tmp_path / "rig.toml", settings=settings)
    shared.start(USUAL.changed(seed=4, tissue="liver"), asked_by=BROWSER)
    shared.search.journal.touch()
    shared.stop()
    shared.search.end(10)
    assert asked[0][:4] == ["search", "--rig", str(tmp_path / "rig.toml"), "--journal"]
    assert not any(each.startswith(("--arm", "--reset-fault", "--seed", "--tissue")) for each in asked[0])
    # For the question in the terminal.
    assert asked[0][-1] == "--asked-by=a browser at 127.0.0.1"
    with pytest.raises(SearchError, match="resume it in the terminal"):
        shared.go_on(shared.search, asked_by=BROWSER)


def test_stop_while_a_search_goes_on_can_go_on_again(stream, tmp_path, monkeypatch):
    children = [ScriptedChild(stream[:5], endless=True), ScriptedChild(endless=True), ScriptedChild(stream)]
    shared, asked = searches(children, tmp_path, monkeypatch)
    shared.start(USUAL, asked_by=BROWSER)
    wait_until(lambda: shared.search.run is not None and len(shared.search.run.views) >= 3)
    shared.search.journal.touch()
    for going_on in (True, True, False):
        if going_on:
            shared.stop()
        shared.search.end(10)
        assert shared.search.can_go_on is going_on
        if going_on:
            # The second is stopped before it has sent anything.
            shared.go_on(shared.search, asked_by=BROWSER)
    assert [each[0] for each in asked] == ["search", "resume", "resume"]


def test_child_that_does_not_stop_is_killed(stream, tmp_path, monkeypatch):
    monkeypatch.setattr("markerseek.bridges.page.page_searches.END_S", 0.1)
    child = ScriptedChild(stream[:5], endless=True)
    child.stop = lambda _number: None
    shared, _ = searches([child], tmp_path, monkeypatch)
    shared.start(USUAL, asked_by=BROWSER)
    shared.close()
    assert child.stopped.is_set()


def test_a_rig_of_devices_registers_only_with_its_endoscope_and_a_known_face(tmp_path, monkeypatch):
    unknown, known = (read_rig_file(Path(f"examples/rigs/{name}.toml")) for name in ("bench", "standa"))
    endoscope = {"cameras": (Path("stereo.toml"),), "images": "left right"}
    for rig in ({"settings": known}, {"settings": unknown, **endoscope}):
        shared, asked = searches([], tmp_path, monkeypatch, **rig)
        with pytest.raises(SearchError, match="cannot register"):
            shared.start(USUAL_REGISTRATION, asked_by=BROWSER)
        assert asked == []
    shared, asked = searches(
        [ScriptedChild()],
        tmp_path,
        monkeypatch,
        settings=known,
        file=Path("r.toml"),
        **endoscope,
    )
    shared.start(USUAL_REGISTRATION, asked_by=BROWSER)
    shared.registration.end(5)
    *arguments, _, record, asked_by = asked[0]
    assert asked_by == f"--asked-by={BROWSER}"
    # A rig of devices has no seed and no pace, and only a person in the terminal arms it.
    assert arguments == [
        *("register", "--rig", "r.toml", "--cameras", "stereo.toml", "--images", "left right", "--sweep"),
    ]
    assert record.startswith(str(tmp_path))


def test_what_nobody_watches_is_stopped_by_a_program_and_says_so(stream, tmp_path, monkeypatch):
    search = ScriptedChild(stream[:5], endless=True)
    session = ScriptedChild(endless=True)
    shared, _ = searches([search], tmp_path, monkeypatch)
    shared.start(USUAL, asked_by=BROWSER)
    shared.stop_unwatched(4.9)
    assert not search.stopped.is_set()
    shared.stop_unwatched(5.1)
    shared.search.end(10)
    # In the record it is no person either.
    assert search.number == signal.SIGTERM
    said = "nobody had the page open for 5 s; the laser is disarmed, and the probe stays where it was"
    assert shared.search.verdict(shared.search.run.last if shared.search.run else None).reason == said
    shared, _ = searches([session], tmp_path, monkeypatch)
    session.running = True
    session.wait = lambda: session.stopped.wait(0.01)
    shared.start(USUAL_REGISTRATION, asked_by=BROWSER)
    shared.stop_unwatched(59.0)
    assert not session.stopped.is_set()
    shared.stop_unwatched(61.0)
    session.running = False
    shared.registration.end(10)
    assert shared.registration.said.reason.startswith("nobody had the page open for 60 s; the laser")


def test_a_person_who_has_pressed_stop_is_not_called_nobody(stream, followed):
    child = ScriptedChild(stream[:5], endless=True)
    live = followed(child, waits=False)
    live.stop()
    assert child.number == signal.SIGINT
    live.stop(because="nobody had the page open for 5 s")
    live.end(30)
    assert live.message == STOPPED_LINE


def test_what_goes_on_is_starting_until_it_writes(tmp_path, monkeypatch, stream):
    first = ScriptedChild(stream[:5])
    second = ScriptedChild(stream[:5], endless=True)
    first.outcome = lambda: STOPPED
    shared, _ = searches([first, second], tmp_path, monkeypatch)
    shared.start(USUAL, asked_by=BROWSER)
    shared.search.end(10)
    shared.search.journal.touch()
    shared.go_on(shared.search, asked_by=BROWSER)
    wait_until(lambda: shared.search.run is not None and len(shared.search.run.views) >= 3)
    # What is in the journal is of the search that was stopped.
    second.has_written = False
    assert shared.search.verdict(shared.search.run.last).word == "STARTING"
    second.has_written = True
    assert shared.search.verdict(shared.search.run.last).word == "SEARCHING"
    shared.close()
