"""A child that is followed: its events, its end, STOP at any time, and streams that cannot be shown."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from msgspec import structs

from markerseek import rigs
from markerseek.bridges.child import Outcome
from markerseek.bridges.page.child_search import ChildSearch
from markerseek.bridges.page.controls import USUAL, USUAL_REGISTRATION
from markerseek.bridges.page.page_searches import PageRig, PageSearches
from markerseek.core import RecordError, SearchError, SearchPlan
from markerseek.records.journal import Entry
from markerseek.rigs import read_rig_file
from markerseek.runs import STOPPED as STOPPED_LINE
from markerseek.runs import RunView, new_session, plan_on, verdict_of
from markerseek.sim import GaussianCurve

BROWSER = "a browser at 127.0.0.1"
STOPPED = Outcome(exit_code=130, answer={"error": "stopped by the user"})
RESUMED = "Start begins a new search;"
IN_TERMINAL = "in the terminal, goes on with this one"
FOUND = Outcome(exit_code=0, answer={"answer": "found", "angle_deg": 1.0, "reason": None})


class ScriptedChild:
    """Sends what it is given; `stop` ends it."""

    def __init__(self, items=(), *, endless=False, error=None):
        self.sent = queue.SimpleQueue()
        for item in items:
            self.sent.put(item)
        if not endless:
            self.sent.put(None)
        self.error, self.stopped = error, threading.Event()

    def items(self):
        while (item := self.sent.get()) is not None:
            yield item
        if self.error is not None:
            raise self.error

    def stop(self):
        self.stopped.set()
        self.sent.put(None)

    kill = stop

    # Of a session: it has written nothing, and is over.
    running = False

    def wait(self):
        raise AssertionError("what is over is not waited for")

    def beating(self, items):
        return items

    def outcome(self):
        return STOPPED if self.stopped.is_set() else FOUND


@pytest.fixture(scope="module")
def stream():
    """What the journal of a short search holds."""
    rig = rigs.of_intensities(seed=2, curve=GaussianCurve(fwhm_deg=12.0), marker_deg=3.0)
    session = new_session(rig, plan_on(rig, SearchPlan(method="ternary", acquisitions=8, start_deg=0.0)))
    items = [session.configuration]
    for number, event in enumerate(session.events(), start=1):
        items.append(Entry(number=number, written="", clock_s=rig.scanner.clock.now_s(), event=event))
    return items


def test_stop_ends_it(stream):
    child = ScriptedChild(stream[:5], endless=True)
    live = ChildSearch(lambda *_, **__: child, ["search"], asked=USUAL)
    live.stop()
    assert live.join(30)
    assert (live.status, live.message) == ("ended", STOPPED_LINE)
    assert live.run is None or live.run.last.line == STOPPED_LINE


@pytest.mark.parametrize(
    ("kind", "said"), [("bench", "; its supervisor disarms the laser and stops the stage"), ("simulated", "")]
)
def test_search_that_is_killed_says_what_laser_and_stage_do(stream, kind, said):
    begun, *events = stream[:5]
    facts = replace(begun.facts, kind=kind)
    child = ScriptedChild([structs.replace(begun, facts=facts), *events])
    child.outcome = lambda: Outcome(exit_code=137, answer=None)
    live = ChildSearch(lambda *_, **__: child, ["search"], asked=USUAL)
    assert live.join(30)
    assert (live.failed, live.message) == (True, f"the command ended with exit code 137, by SIGKILL{said}")
    status_text = pytest.importorskip("markerseek.bridges.page.search_page", reason="needs the extra page").status_text
    verdict = verdict_of(live.run.last)
    assert (verdict.word, verdict.problem) == ("FAULT", "the command ended with exit code 137, by SIGKILL")
    assert verdict.reason == said.removeprefix("; ")
    # Once is enough.
    assert status_text(live) == verdict.line == "fault"


@pytest.mark.parametrize(
    ("simulated", "state", "phase", "said"),
    [
        (True, "none", None, "press Start"),
        (True, "busy", "moving", ""),
        (True, "starting", None, ""),
        (False, "starting", None, "answer in the terminal where the page was started"),
        (True, "paused", "stopped", "Go on continues it; Start begins a new search"),
        (True, "ended", "fault", "Start begins a new search"),
        (False, "ended", None, "Start begins a new search"),
        (False, "ended", "stopped", f"{RESUMED} markerseek resume, {IN_TERMINAL}"),
        (False, "ended", "cut off", f"{RESUMED} markerseek resume, {IN_TERMINAL}"),
        # The journal holds the fault: without the option the terminal would refuse.
        (
            False,
            "ended",
            "fault",
            f"{RESUMED} once the fault is repaired, markerseek resume --reset-fault, {IN_TERMINAL}",
        ),
    ],
)
def test_what_a_person_can_do_next(stream, simulated, state, phase, said):
    page = pytest.importorskip("markerseek.bridges.page.search_page", reason="needs the extra page")
    view = RunView(plan=SearchPlan(method="ternary"), facts=stream[0].facts, phase=phase or "ready")
    run = None if phase is None else SimpleNamespace(last=view)
    search = None if state == "none" else SimpleNamespace(run=run, status=state)
    busy = state in {"busy", "starting"}
    rig = SimpleNamespace(simulated=simulated)
    searches = SimpleNamespace(rig=rig, busy=busy, paused=state == "paused", search=search)
    assert page.next_step_text(searches) == said


@pytest.mark.parametrize(
    ("status", "message", "failed", "word", "said"),
    [
        ("starting", "", False, "STARTING", ""),
        ("stopping", "", False, "STOPPING", ""),
        ("ended", "no answer from the stage", True, "FAULT", "no answer from the stage"),
        ("ended", "not armed: nothing moved; a person must arm it", False, "NOT ARMED", "nothing moved; a person"),
        ("ended", STOPPED_LINE, False, "STOPPED", "the laser is disarmed"),
    ],
)
def test_search_without_an_event_is_not_called_ready(status, message, failed, word, said):
    page = pytest.importorskip("markerseek.bridges.page.search_page", reason="needs the extra page")
    live = SimpleNamespace(run=None, status=status, message=message, failed=failed)
    verdict = page.verdict_before(live, next_step="arm it")
    assert (verdict.word, verdict.angle, verdict.next_step) == (word, "", "arm it")
    assert (verdict.problem if failed else verdict.reason).startswith(said)
    # Once is enough.
    assert page.status_text(live) == word.lower()


def test_stop_before_the_child_is_there(stream):
    begun, child = threading.Event(), ScriptedChild(stream[:5], endless=True)

    def launch(*_, **__):
        begun.wait(30)
        return child

    live = ChildSearch(launch, ["search"], asked=USUAL)
    live.stop()
    assert live.status == "stopping"
    begun.set()
    assert live.join(30)
    assert child.stopped.is_set()


def test_stream_that_cannot_be_read_stops_the_child(stream):
    child = ScriptedChild(stream[:5], error=RecordError("stream: no stream"))
    live = ChildSearch(lambda *_, **__: child, ["search"], asked=USUAL)
    assert live.join(30)
    assert (child.stopped.is_set(), live.message) == (True, "stream: no stream")
    # Nobody knows where the probe is that was on its way.
    last = live.run.last
    assert (last.phase, last.target_deg, last.line) == ("cut off", None, "stream: no stream")


# The thread's own error is printed, as that of any thread.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_search_that_cannot_be_shown_is_stopped(stream, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError

    monkeypatch.setattr("markerseek.bridges.page.run_history.RunHistory.add", broken)
    child = ScriptedChild(stream[:5], endless=True)
    live = ChildSearch(lambda *_, **__: child, ["search"], asked=USUAL)
    assert live.join(30)
    assert (child.stopped.is_set(), live.message) == (True, "the page cannot show this search; it was stopped")


def searches(children, tmp_path, monkeypatch, **rig):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    asked = []

    def launch(arguments, journal):
        asked.append(list(arguments))
        return children.pop(0)

    return PageSearches(PageRig(**rig), launch=launch), asked


def test_one_search_at_a_time(stream, tmp_path, monkeypatch):
    shared, asked = searches([ScriptedChild(stream[:5], endless=True)], tmp_path, monkeypatch)
    shared.start(USUAL.changed(seed=4), asked_by=BROWSER)
    for another in (
        lambda: shared.start(USUAL, asked_by=BROWSER),
        shared.go_on,
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
    assert shared.search.join(10)
    assert asked[0][:4] == ["search", "--rig", str(tmp_path / "rig.toml"), "--journal"]
    assert not any(each.startswith(("--arm", "--reset-fault", "--seed", "--tissue")) for each in asked[0])
    # For the question in the terminal.
    assert asked[0][-1] == "--asked-by=a browser at 127.0.0.1"
    assert not shared.paused
    with pytest.raises(SearchError, match="resume it in the terminal"):
        shared.go_on()


def test_pause_while_a_search_goes_on_can_go_on_again(stream, tmp_path, monkeypatch):
    children = [ScriptedChild(stream[:5], endless=True), ScriptedChild(endless=True), ScriptedChild(stream)]
    shared, asked = searches(children, tmp_path, monkeypatch)
    shared.start(USUAL, asked_by=BROWSER)
    while shared.search.run is None or len(shared.search.run.views) < 3:
        time.sleep(0.01)
    shared.search.journal.touch()
    for going_on in (True, True, False):
        if going_on:
            shared.stop()
        assert shared.search.join(10)
        assert shared.paused is going_on
        if going_on:
            # The second is stopped before it has sent anything.
            shared.go_on()
    assert [each[0] for each in asked] == ["search", "resume", "resume"]


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_whatever_goes_wrong_has_a_sentence():
    def launch(*_, **__):
        raise RuntimeError("can't start new thread")

    live = ChildSearch(launch, [], asked=USUAL)
    assert live.join(10)
    assert (live.failed, live.message) == (True, "the page cannot show this search; it was stopped")


def test_child_that_does_not_stop_is_killed(stream, tmp_path, monkeypatch):
    monkeypatch.setattr("markerseek.bridges.page.page_searches.END_S", 0.1)
    child = ScriptedChild(stream[:5], endless=True)
    child.stop = lambda: None
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
            shared.register(USUAL_REGISTRATION)
        assert asked == []
    shared, asked = searches(
        [ScriptedChild()],
        tmp_path,
        monkeypatch,
        settings=known,
        file=Path("r.toml"),
        **endoscope,
    )
    shared.register(USUAL_REGISTRATION)
    assert shared.registration.join(5)
    *arguments, record = asked[0]
    # A rig of devices has no seed and no pace, and only a person in the terminal arms it.
    assert arguments == [
        *("register", "--rig", "r.toml", "--cameras", "stereo.toml", "--images", "left right", "--sweep"),
    ]
    assert record.startswith(f"--record={tmp_path}")
