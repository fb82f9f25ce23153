"""Following in the browser: register in simulation, click into the left image, permit it, the probe turns, STOP."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from msgspec import structs

from markerseek.following import FollowBegun, FollowedRoom, FollowEnded, FollowStep, TargetPath, follow_record
from markerseek.registration import SessionRecord, SimulatedRoomSettings, camera_text
from markerseek.sim import STREAMING
from tests import registration_sessions as sessions
from tests.page.page_browser import LOST_MS, needs_browser, open_tab, require_legible, served, sync_api, violations

pytestmark = [pytest.mark.real_time, needs_browser]

BADGE = ".ms-badge"
IMAGE = ".ms-panel-left .ms-marks svg"
SESSION_MS = 900_000
RUN_MS = 120_000


def click_at(watched, x_share: float, y_share: float) -> tuple[float, float]:
    """Click into the left image; returns the pixel that is meant."""
    box = watched.tab.locator(IMAGE).bounding_box()
    # The image is as high as its panel, or as wide.
    scale = min(box["width"] / 1280, box["height"] / 1024)
    left = box["x"] + (box["width"] - 1280 * scale) / 2
    top = box["y"] + (box["height"] - 1024 * scale) / 2
    watched.tab.mouse.click(left + x_share * 1280 * scale, top + y_share * 1024 * scale)
    return 1280 * x_share, 1024 * y_share


def repeat(act, wanted) -> None:
    """Do something until what it brings is seen: on a busy machine a page goes stale, and has to be asked again."""
    for _ in range(8):
        act()
        try:
            sync_api.expect(wanted).to_be_visible(timeout=LOST_MS)
        except AssertionError:
            continue
        return
    raise AssertionError("it was asked for eight times without effect")


def number(watched, name: str) -> float:
    return float(watched.tab.get_by_role("spinbutton", name=name, exact=True).input_value())


def keep(data: Path) -> None:
    """A simulated session with the registration of its own room, in the data folder of a page."""
    room = FollowedRoom(SimulatedRoomSettings(rig=STREAMING), TargetPath(motion="still"), seed=1)
    begun = structs.replace(sessions.BEGUN, seed=1, cameras=camera_text(room.stereo), size_px=(1280, 1024))
    record = SessionRecord.create(data / "markerseek" / "registrations" / "a", begun)
    record.add(structs.replace(sessions.registered(4), report=room.registration().report))
    record.add(sessions.ENDED)
    record.close()


def permit_a_click(watched) -> None:
    """Click into the left image, permit it, and wait until the probe is there."""
    yes = watched.tab.get_by_role("button", name="Permit and follow")
    repeat(lambda: click_at(watched, 0.53, 0.5), yes)
    x = 0.53 * 1280
    y = 0.5 * 1024
    assert (number(watched, "x"), number(watched, "y")) == pytest.approx((x, y), abs=3.0)
    watched.tab.locator(".ms-valid").click()
    repeat(lambda: yes.click() if yes.is_visible() else None, watched.tab.locator(".ms-follows"))
    watched.wait_for(BADGE, "^THERE$", timeout_ms=RUN_MS)
    depth = watched.tab.wait_for_selector(".ms-panel-left .ms-mark-depth")
    assert re.fullmatch(r"\d+\.\d mm deep", depth.text_content())
    assert watched.tab.locator(".ms-panel-follow svg polyline").count() == 2
    assert "holds, expected error" in watched.text(".ms-panel-holds")


def require_turned(page) -> None:
    """The record of the run says that the probe was at the first place, and turned to the second one."""
    (path,) = (page.data / "markerseek" / "registrations").glob("*/following-1.jsonl")
    begun, *steps, ended = follow_record(path, is_over=lambda: True, wait=lambda: None)
    assert isinstance(begun, FollowBegun)
    assert ended == FollowEnded(said="stopped by the user")
    assert all(isinstance(step, FollowStep) for step in steps)
    first = [step for step in steps if step.word == "there"][-1]
    assert first.probe_deg == pytest.approx(first.target_deg, abs=0.25)
    assert abs(steps[-1].target_deg - first.target_deg) > 2.0


def test_a_click_into_the_left_image_turns_the_probe_there_and_stop_ends_it(browser, tmp_path):
    keep(tmp_path)
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/sessions")
        repeat(lambda: watched.press("open"), watched.tab.get_by_role("button", name="Follow a place"))
        follow = watched.tab.get_by_role("button", name="Follow a place")
        sync_api.expect(follow).to_be_visible()
        yes = watched.tab.get_by_role("button", name="Permit and follow")
        repeat(follow.click, yes)
        for scheme in ("dark", "light"):
            # Behind a question the page is dim, and does not answer.
            assert [rule for rule, _ in violations(watched, scheme) if rule != "color-contrast"] == [], scheme
        # Without light nothing confirms the registration: a person must.
        repeat(yes.click, watched.tab.get_by_text("without light nothing confirms the registration").first)
        watched.press("cancel")
        sync_api.expect(yes).to_be_hidden()
        permit_a_click(watched)
        require_legible(watched, 390, 900, 1280)
        # Another place, under the same permit.
        repeat(lambda: click_at(watched, 0.47, 0.5), watched.tab.get_by_text("TURNING", exact=True))
        watched.tab.locator(".ms-stop").click()
        watched.wait_for(BADGE, "^STOPPED$", timeout_ms=RUN_MS)
        assert page.children() == []
        require_turned(page)
        sync_api.expect(follow).to_be_visible()
        assert watched.problems == []
        watched.tab.context.close()


@pytest.mark.long
def test_a_session_that_was_registered_here_is_followed_with(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/", "&seed=3&markers=3&pace=0")
        follow = watched.tab.get_by_role("button", name="Follow a place")
        sync_api.expect(follow).to_be_hidden()
        watched.start()
        watched.wait_for(BADGE, "^REGISTERED", timeout_ms=SESSION_MS)
        # What the cameras have seen move during the last search.
        watched.wait_for(".ms-panel-motion .ms-note", "^marker 3: the tissue is at rest, within ± 0")
        assert watched.tab.locator(".ms-panel-motion svg polyline").count() == 1
        sync_api.expect(follow).to_be_visible()
        permit_a_click(watched)
        repeat(lambda: click_at(watched, 0.47, 0.5), watched.tab.get_by_text("TURNING", exact=True))
        watched.tab.locator(".ms-stop").click()
        watched.wait_for(BADGE, "^STOPPED$", timeout_ms=RUN_MS)
        require_turned(page)
        assert watched.problems == []
        watched.tab.context.close()
