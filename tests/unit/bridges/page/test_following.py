"""A run that follows, as the page starts it, shows it and takes places for it."""

from __future__ import annotations

import re
import threading
from pathlib import Path

import pytest
from msgspec import structs

from markerseek.bridges.outcome import Outcome
from markerseek.bridges.page.children import ChildFollowing
from markerseek.bridges.page.following_display import follow_chart, follow_marks, follow_rows, follow_verdict
from markerseek.bridges.page.page_searches import PageRig, PageSearches
from markerseek.bridges.request import FollowRequest, SessionRequest
from markerseek.core import ConfigError, SceneOptions, SearchError
from markerseek.following import FollowBegun, FollowPlan, FollowRecord, FollowStep
from markerseek.registration import POINTED_AT, SPOT_IS_SET, SessionRecord, SessionView, camera_text
from tests import registration_sessions as sessions
from tests.waiting import wait_until

STEP = FollowStep(
    at_s=100.0,
    word="turning",
    said="turns, the target is 8.2 deg from the image plane",
    probe_deg=-1.0,
    target_deg=7.2,
    sigma_deg=0.4,
    within_deg=1.0,
    turning=True,
    davinci_to_trus=[[1.0, 0.0, 0.0, 0.0]],
    tre_m=0.94e-3,
    target_camera_m=[0.0, 0.0, 0.1],
)
BEGUN = FollowBegun(
    what="the laser spot", rig="r", simulated=True, registration="", plan=FollowPlan(), lit=True, by="a test", begun=""
)


class WrittenChild:
    """A child whose record is written by the test; it ends when it is told to."""

    images = None

    def __init__(self, command, *, journal):
        self.command = command
        self.running = True
        self.has_written = True
        self.ends = Outcome(exit_code=0)
        self.record = FollowRecord.create(journal, BEGUN)

    def beating(self, lines):
        return lines

    def wait(self):
        threading.Event().wait(0.01)

    def stop(self, number=None):
        self.ends = Outcome.of(130, b'{"error": "stopped by the user"}')
        self.running = False

    kill = stop

    def outcome(self):
        return self.ends


def kept(data: Path) -> Path:
    """A session with a registration, in the data folder of a page."""
    folder = data / "markerseek" / "registrations" / "a"
    begun = structs.replace(sessions.BEGUN, seed=7, cameras=camera_text(sessions.stereo()), size_px=(1280, 1024))
    record = SessionRecord.create(folder, begun)
    record.add(sessions.registered(4))
    record.add(sessions.ENDED)
    record.close()
    return folder


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page with a session, which it shows."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    folder = kept(tmp_path)
    searches = PageSearches(PageRig(), launch=WrittenChild)
    searches.show_session(folder, usual=SessionRequest())
    searches.registration.end(10)
    yield searches, folder
    searches.close()


def following(searches: PageSearches, folder: Path, **asked) -> ChildFollowing:
    searches.follow(FollowRequest(folder=str(folder), **asked), asked_by="a browser")
    return searches.following


def child_of(live: ChildFollowing) -> WrittenChild:
    return live._followed.child


def test_the_command_says_what_is_permitted(page):
    searches, folder = page
    live = following(
        searches,
        folder,
        plan=FollowPlan(speed_deg_s=3, minutes=2),
        simulation=SceneOptions(seed=7, pace=1.0),
        pixel=(700.04, 480.0),
        still_valid=True,
    )
    words = child_of(live).command
    assert words == [
        *("follow", "--simulate", "--speed-deg-s=3", "--minutes=2", "--seed=7", "--pace=1"),
        *("--registration", str(folder), "--pixel", "700.0", "480.0", "--still-valid", "--seconds", "121"),
        *("--record", str(folder / "following-1.jsonl"), "--asked-by=a browser"),
    ]


def test_a_rig_of_devices_is_followed_with_its_cameras_and_no_option_of_a_simulation():
    rig = PageRig(file=Path("rig.toml"), settings=None, cameras=(Path("c.toml"),), images="l r")
    asked = FollowRequest(folder="S", simulation=SceneOptions(seed=3), endoscope_held=True)
    words = ["follow", "--rig", "rig.toml", "--cameras", "c.toml", "--images", "l r"]
    assert rig.command(asked) == [*words, "--registration", "S", "--spot", "--endoscope-held"]


def test_steps_become_the_verdict_the_marks_and_the_rows(page):
    searches, folder = page
    live = following(searches, folder, pixel=(700.0, 480.0))
    record = child_of(live).record
    record.add(STEP)
    there = structs.replace(STEP, at_s=102.0, word="there", said="there: the target is 0.2 deg away", probe_deg=7.0)
    record.add(structs.replace(there, turning=False))
    wait_until(lambda: live.last is not None and live.last.word == "there")
    verdict = follow_verdict(live)
    assert (verdict.word, verdict.kind) == ("THERE", "found")
    assert (verdict.angle, verdict.sigma) == ("7.0°", "target 7.2° ± 0.4°")
    assert verdict.interval == "the target is 0.2° away"
    rows = dict(follow_rows(live))
    assert rows["transform"] == "holds, expected error 0.94 mm"
    assert rows["follows"] == "a place of the left image, 100.0 mm deep"
    assert rows["permit"].endswith("10.0 min left")
    left, right = (follow_marks(live, searches.registration.view, side) for side in ("left", "right"))
    centre = re.compile(r'cx="([\d.]+)" cy="([\d.]+)"')
    # On the axis of the left camera, and to the left of it in the right image.
    assert centre.search(left).groups() == ("639.5", "511.5")
    assert float(centre.search(right)[1]) == pytest.approx(639.5 - 1100 * 5e-3 / 0.1, abs=0.1)
    assert "100.0 mm deep" in left
    assert "7.0°, the target at 7.2°; there" in follow_chart(live)
    assert follow_marks(live, SessionView(), "left") == ""


@pytest.mark.parametrize(
    ("word", "kind", "next_step"),
    [
        ("lost", "unsure", "goes on by itself, once the target is back for 0.5 s"),
        ("tissue", "unsure", "look at rig and patient; Follow goes on, with a new permit"),
        ("fault", "fault", "look at rig and patient; Follow goes on, with a new permit"),
    ],
)
def test_what_holds_the_probe_is_a_word_with_what_to_do(page, word, kind, next_step):
    searches, folder = page
    live = following(searches, folder)
    child_of(live).record.add(structs.replace(STEP, word=word, said="why"))
    wait_until(lambda: live.last is not None)
    verdict = follow_verdict(live)
    assert (verdict.word, verdict.kind, verdict.turn, verdict.next_step) == (word.upper(), kind, "why", next_step)


def test_stop_ends_it_and_the_next_one_has_another_record(page):
    searches, folder = page
    live = following(searches, folder)
    child_of(live).record.add(STEP)
    wait_until(lambda: live.last is not None)
    with pytest.raises(SearchError, match="a search or a registration runs"):
        following(searches, folder)
    searches.stop()
    live.end(10)
    assert follow_verdict(live).word == "STOPPED"
    assert follow_verdict(live).turn == "the laser is disarmed, and the probe stays where it was"
    assert child_of(following(searches, folder)).command[-2] == str(folder / "following-2.jsonl")


def test_places_are_handed_on_while_one_is_followed_and_else_refused(page):
    searches, folder = page
    live = following(searches, folder, pixel=(1.0, 2.0))
    with pytest.raises(SearchError, match="press Follow first"):
        live.point_at((3.0, 4.0))
    child_of(live).record.add(STEP)
    wait_until(lambda: live.last is not None)
    live.point_at((30.26, 4.0))
    assert (folder / POINTED_AT).read_text() == "30.3 4.0\n"
    searches.stop()
    live.end(10)
    with pytest.raises(SearchError, match="press Follow first"):
        live.point_at((3.0, 4.0))


def test_spot_is_set_is_asked_where_the_laser_waits_in_the_dark(page):
    searches, folder = page
    live = following(searches, folder)
    live._simulated = False
    record = child_of(live).record
    record.add(STEP)
    wait_until(lambda: live.last is not None)
    live.say_spot_is_set()
    assert not (folder / SPOT_IS_SET).exists()
    record.add(structs.replace(STEP, word="lost"))
    wait_until(lambda: live.last.word == "lost")
    assert follow_verdict(live).next_step == "the laser is dark: press Spot is set once it is there"
    live.say_spot_is_set()
    assert (folder / SPOT_IS_SET).exists()


def test_a_place_that_is_refused_at_once_is_no_fault(page):
    searches, folder = page
    live = following(searches, folder, pixel=(1.0, 2.0))
    child = child_of(live)
    child.ends = Outcome.of(2, b'{"error": "--pixel is 1, 2, it is dark", "kind": "ConfigError"}')
    child.running = False
    live.end(10)
    verdict = follow_verdict(live)
    assert (verdict.word, verdict.kind) == ("NOT FOLLOWED", "unsure")
    assert verdict.problem == "--pixel is 1, 2, it is dark"


def test_without_a_registration_nothing_follows(page):
    searches, folder = page
    with pytest.raises(SearchError, match="no registration holds by which one could follow"):
        following(searches, folder.parent)
    searches.delete_session(folder)
    with pytest.raises(SearchError, match="no registration holds"):
        following(searches, folder)


def test_a_permit_that_cannot_be_is_refused():
    with pytest.raises(ConfigError, match="minutes is 90 min"):
        FollowPlan(minutes=90)
