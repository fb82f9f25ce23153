"""A child that is followed: its events, its end, STOP at any time, and streams that cannot be shown."""

from __future__ import annotations

import contextlib
import queue
import signal
import threading
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.bridges.child import ChildRun
from markerseek.bridges.outcome import Outcome
from markerseek.bridges.page.children import ChildRegistration, ChildSearch
from markerseek.bridges.page.controls import USUAL, USUAL_REGISTRATION
from markerseek.bridges.page.page_searches import PageRig, PageSearches
from markerseek.core import Failed, MoveError, RecordError, SearchError, SearchPlan
from markerseek.files import replace_file
from markerseek.records.journal import Interrupted, Journal, JournalEntry
from markerseek.registration import SPOT_IS_SET, Ended, MovedMarker, SessionRecord, Spot, SpotSeen, Waiting
from markerseek.rigs import read_rig_file
from markerseek.runs import new_run, plan_on
from markerseek.show import STOPPED as STOPPED_LINE
from markerseek.show import event_line
from markerseek.sim import GaussianCurve
from tests.registration_sessions import BEGUN, begin, taken
from tests.waiting import wait_until

SPOT = Spot(left_px=(600.0, 500.0), right_px=(560.0, 500.0), sigma_px=0.1)
BROWSER = "a browser at 127.0.0.1"
STOPPED = Outcome.of(130, b'{"error": "stopped by the user"}')
RESUMED = "Start begins a new search;"
RESUME = "markerseek resume JOURNAL --rig rig.toml"
IN_TERMINAL = "in the terminal, goes on with this one"
GO_ON = "Go on continues it; Start begins a new search"
FOUND = Outcome.of(0, b'{"answer": "found", "angle_deg": 1.0, "reason": null}')


class ScriptedChild:
    """Sends what it is given; `stop` ends it."""

    images = None

    def __init__(self, items=(), *, endless=False, error=None):
        self.sent = queue.SimpleQueue()
        for item in items:
            self.sent.put(item)
        if not endless:
            self.sent.put(None)
        self.error = error
        self.stopped = threading.Event()
        self.has_written = False

    def items(self):
        while (item := self.sent.get()) is not None:
            self.has_written = True
            yield item
        if self.error is not None:
            raise self.error

    def stop(self, number=signal.SIGINT):
        self.number = number
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


def interrupted_session(tmp_path, monkeypatch, *steps, **rig):
    """A page that began a session, whose record has these steps beside the first, and its command."""
    shared, asked = searches([ScriptedChild()], tmp_path, monkeypatch, **rig)
    shared.start(USUAL_REGISTRATION.changed(seed=17, markers=5), asked_by=BROWSER)
    shared.registration.end(10)
    with contextlib.closing(SessionRecord.create(shared.registration.journal, BEGUN)) as record:
        for step in steps:
            record.add(step)
    return shared, asked[0]


def test_a_page_started_again_offers_the_session_that_was_interrupted_and_continues_it(tmp_path, monkeypatch):
    waiting = Waiting(name="1", place=None, said="light a spot")
    before, begun = interrupted_session(tmp_path, monkeypatch, waiting)
    child = ScriptedChild(endless=True)
    shared, asked = searches([child], tmp_path, monkeypatch)
    assert shared.registration is None
    shared.offer_interrupted()
    offered = shared.registration
    offered.end(10)
    assert not shared.busy
    assert (offered.said.word, offered.can_go_on) == ("STOPPED", True)
    assert offered.said.reason.startswith("the program that ran this session has ended; the laser is disarmed")
    assert "Go on continues this one" in offered.said.next_step
    assert (offered.asked.simulation.seed, offered.asked.plan.markers) == (17, 5)
    shared.go_on(offered, asked_by="a browser at 10.0.0.7")
    *command, _, _, _ = begun
    assert asked == [[*command, "--continue", str(before.registration.journal), "--asked-by=a browser at 10.0.0.7"]]
    shared.stop()


def test_only_a_session_that_can_be_continued_here_is_offered(tmp_path, monkeypatch):
    def offered(**rig):
        shared, _ = searches([], tmp_path, monkeypatch, **rig)
        shared.offer_interrupted()
        return shared.registration

    # No page has begun one.
    assert offered() is None
    before, _ = interrupted_session(tmp_path, monkeypatch)
    assert offered() is not None
    # On another rig, while a program runs it, with a damaged record, and when it has ended.
    assert offered(file=tmp_path / "rig.toml") is None
    with contextlib.closing(SessionRecord.reopen(before.registration.journal)):
        assert offered() is None
    kept = (tmp_path / "markerseek" / "page.json").read_bytes()
    (tmp_path / "markerseek" / "page.json").write_bytes(kept[:-9])
    assert offered() is None
    interrupted_session(tmp_path, monkeypatch, Ended(registered=False, said="over", rig_s=1.0))
    assert offered() is None
    # Nothing that is measured now makes a registration of it hold.
    moved = MovedMarker(name="1", moved_m=4e-3, sigma_m=3e-4, moved=True, said="marker 1 has moved by 4.0 mm")
    interrupted_session(tmp_path, monkeypatch, moved)
    assert offered() is None


def test_a_command_that_continues_a_record_has_written_once_the_record_grows(tmp_path, monkeypatch):
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "session.jsonl").write_text("before\n")
    (folder / "1.journal").write_text("before\n")
    monkeypatch.setattr("markerseek.bridges.child.sys.executable", "/bin/true")
    child = ChildRun(["register"], journal=folder)
    child.outcome()
    assert not child.has_written
    with (folder / "session.jsonl").open("a") as file:
        file.write("its own\n")
    assert child.has_written


def test_who_asked_for_a_session_of_devices_is_handed_on_also_by_go_on(tmp_path, monkeypatch):
    known = read_rig_file(Path("examples/rigs/standa.toml"))
    devices = {"settings": known, "cameras": (Path("stereo.toml"),), "images": "left right", "file": Path("r.toml")}
    before, begun = interrupted_session(tmp_path, monkeypatch, **devices)
    assert begun[-1] == f"--asked-by={BROWSER}"
    shared, asked = searches([ScriptedChild()], tmp_path, monkeypatch, **devices)
    shared.offer_interrupted()
    shared.registration.end(10)
    # The command that a person types in a terminal asks as that person.
    assert "--asked-by" not in shared.registration.said.next_step
    shared.go_on(shared.registration, asked_by="a browser at 10.0.0.9")
    assert asked[0][-1] == "--asked-by=a browser at 10.0.0.9"
    assert not any(each.startswith("--arm") for each in asked[0])
    assert before.registration.journal == shared.registration.journal


class RunningSession(ScriptedChild):
    """A session of devices that runs until it is stopped."""

    @property
    def running(self):
        return not self.stopped.is_set()

    def wait(self):
        self.stopped.wait(0.01)


def test_the_page_says_that_the_spot_is_set_only_while_the_session_waits_in_the_dark_for_that(tmp_path):
    folder = tmp_path / "session"
    record = begin(folder)
    live = ChildRegistration(
        RunningSession(endless=True), asked=USUAL_REGISTRATION, journal=folder, goes_on=["register"], simulated=False
    )
    said = folder / SPOT_IS_SET

    def asks(*, expected):
        wait_until(lambda: live.asks_whether_set is expected)
        live.say_spot_is_set()
        assert said.exists() is expected
        said.unlink(missing_ok=True)

    asks(expected=False)
    record.add(Waiting(name="1", place=None, said="light a spot", dark=True))
    asks(expected=True)
    # Nothing is written through a link.
    said.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(OSError, match="symbolic links"):
        live.say_spot_is_set()
    assert not (tmp_path / "elsewhere").exists()
    said.unlink()
    record.add(SpotSeen(name="1", spot=SPOT, camera_m=(0.0, 0.0, 0.1), prediction=None, journal=None, pulses=9))
    asks(expected=False)
    record.add(Waiting(name="1", place=None, said="light a spot"))
    asks(expected=False)
    live.stop()
    live.end(30)
    record.close()


def kept_session(tmp_path, monkeypatch, *, ended=True):
    """The folder of a session of four markers in the user's data folder."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    record = begin(tmp_path / "markerseek" / "registrations" / "a", markers=4)
    if ended:
        record.add(Ended(registered=True, said="over", rig_s=1.0))
    record.close()
    return record.folder


@pytest.mark.parametrize(
    ("further", "options"),
    [("go on", []), ("one more marker", ["--markers=5"]), ("check", ["--markers=4", "--check"])],
)
def test_a_session_that_is_kept_is_continued_as_its_record_says(tmp_path, monkeypatch, further, options):
    folder = kept_session(tmp_path, monkeypatch)
    shared, asked = searches([RunningSession(endless=True)], tmp_path, monkeypatch)
    shared.continue_session(folder, further, usual=USUAL_REGISTRATION, asked_by=BROWSER)
    [command] = asked
    assert command[:2] == ["register", "--simulate"]
    assert command[-3:] == ["--continue", str(folder), f"--asked-by={BROWSER}"]
    assert sorted(each for each in command if each in {"--check"} or each.startswith("--markers")) == sorted(options)
    assert shared.registration.journal == folder
    # Nothing else while it runs.
    for another in (
        lambda: shared.delete_session(folder),
        lambda: shared.show_session(folder, usual=USUAL_REGISTRATION),
    ):
        with pytest.raises(SearchError, match="a search or a registration runs"):
            another()
    assert folder.exists()
    shared.stop()


def test_a_session_that_is_kept_is_shown_and_deleted(tmp_path, monkeypatch):
    folder = kept_session(tmp_path, monkeypatch)
    shared, asked = searches([], tmp_path, monkeypatch)
    [kept] = shared.kept_sessions()
    assert (kept.folder, kept.state) == (str(folder), "registered above the goal")
    shared.show_session(folder, usual=USUAL_REGISTRATION)
    shared.registration.end(10)
    assert shared.registration.said.word == "REGISTERED ABOVE GOAL"
    assert not shared.busy
    assert shared.delete_session(folder) == []
    assert (shared.registration, shared.kept_sessions(), asked) == (None, [], [])
    assert not folder.exists()


def test_a_session_of_sweeps_is_continued_by_sweeps(tmp_path, monkeypatch):
    folder = kept_session(tmp_path, monkeypatch, ended=False)
    for sweep in (False, True):
        rig = rigs.simulated(seed=1)
        search = new_run(rig, plan_on(rig, SearchPlan(sweep=sweep)))
        Journal.create(folder / f"{sweep}.journal", search.configuration).close()
        with contextlib.closing(SessionRecord.reopen(folder)) as record:
            record.add(taken(str(1 + len(record.view.markers)), journal=f"{sweep}.journal"))
    # The first search says how.
    shared, asked = searches([ScriptedChild()], tmp_path, monkeypatch)
    shared.continue_session(folder, "go on", usual=USUAL_REGISTRATION, asked_by=BROWSER)
    assert "--sweep" not in asked[0]


def test_the_images_of_the_cameras_are_live_while_a_session_waits(tmp_path):
    folder = tmp_path / "session"
    begin(folder)
    live = ChildRegistration(
        RunningSession(endless=True), asked=USUAL_REGISTRATION, journal=folder, goes_on=["register"], simulated=False
    )
    for content in (b"a", b"b"):
        before = live.images_ns
        # In one step, as a session does.
        with replace_file(folder / "right.jpg") as part:
            part.write_bytes(content)
        # No step comes meanwhile.
        wait_until(lambda before=before: live.images_ns != before)
        assert live.images_ns == (folder / "right.jpg").stat().st_mtime_ns
    live.stop()
