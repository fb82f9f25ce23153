"""Sessions of the page: interrupted, kept, continued, shown and deleted."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from markerseek import rigs
from markerseek.bridges.child import ChildRun
from markerseek.bridges.page.children import ChildRegistration
from markerseek.bridges.page.controls import USUAL_REGISTRATION
from markerseek.core import SearchError, SearchPlan
from markerseek.files import replace_file
from markerseek.records.journal import Journal
from markerseek.registration import SPOT_IS_SET, Ended, MovedMarker, SessionRecord, SpotSeen, Waiting
from markerseek.rigs import read_rig_file
from markerseek.runs import new_run, plan_on
from tests.registration_sessions import BEGUN, begin, taken
from tests.unit.bridges.page.scripted_child import BROWSER, SPOT, ScriptedChild, searches
from tests.waiting import wait_until


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
