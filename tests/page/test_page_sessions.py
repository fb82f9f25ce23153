"""The page of the sessions that are kept: opened, checked by one more spot, reported, and deleted after a question."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec import structs

from markerseek.registration import SessionRecord, camera_text, read_session
from markerseek.registration.steps import SpotChecked
from tests import registration_sessions as sessions
from tests.page.page_browser import needs_browser, open_tab, require_legible, served, sync_api

pytestmark = [pytest.mark.real_time, needs_browser]

CARDS = ".ms-kept"
BADGE = ".ms-badge"
SESSION_MS = 400_000


def keep(data: Path, name: str, *, year: int, ended: bool = True) -> Path:
    """A session in the data folder of a page."""
    folder = data / "markerseek" / "registrations" / name
    begun = structs.replace(
        sessions.BEGUN,
        begun=f"{year}-01-01T00:00:00+00:00",
        cameras=camera_text(sessions.stereo()),
        size_px=(1280, 1024),
    )
    record = SessionRecord.create(folder, begun)
    for number in range(1, 5):
        record.add(sessions.registered(number))
    if ended:
        record.add(sessions.ENDED)
    record.close()
    return folder


def test_sessions_are_listed_opened_and_deleted_after_a_question(browser, tmp_path):
    old = keep(tmp_path, "a", year=2024)
    new = keep(tmp_path, "b", year=2025, ended=False)
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/sessions")
        cards = watched.tab.locator(CARDS)
        sync_api.expect(cards).to_have_count(2)
        headings = [each.inner_text() for each in watched.tab.locator(f"{CARDS} h2").all()]
        assert headings == [
            "2025-01-01 00:00 UTC: stopped, registered above the goal",
            "2024-01-01 00:00 UTC: registered above the goal",
        ]
        # What was stopped goes on, and what is over gets one marker more.
        assert cards.nth(0).get_by_role("button", name="go on").count() == 1
        assert cards.nth(1).get_by_role("button", name="go on").count() == 0
        assert cards.nth(1).get_by_role("button", name="one more marker").count() == 1
        require_legible(watched, 390, 1400)
        cards.nth(0).get_by_role("button", name="delete").click()
        watched.tab.wait_for_selector("text=are removed from the disk for good")
        watched.press("keep it")
        assert new.exists()
        cards.nth(0).get_by_role("button", name="delete").click()
        watched.press("delete it")
        sync_api.expect(cards).to_have_count(1)
        assert (new.exists(), old.exists()) == (False, True)
        watched.press("open")
        watched.wait_for(BADGE, "^REGISTERED ABOVE GOAL$")
        assert watched.problems == []
        watched.tab.context.close()


@pytest.mark.long
def test_a_session_that_has_ended_is_checked_by_one_more_spot_and_gives_its_report(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/", "&seed=3&markers=3&pace=0")
        watched.start()
        watched.wait_for(BADGE, "^REGISTERED", timeout_ms=SESSION_MS)
        watched.tab.get_by_role("link", name="sessions").click()
        watched.tab.wait_for_selector(CARDS)
        watched.press("check")
        watched.wait_for(".ms-answer", "^check-1: off by ", timeout_ms=SESSION_MS)
        watched.wait_for(BADGE, "^REGISTERED")
        for side in ("left", "right"):
            assert watched.tab.locator(f".ms-panel-{side} .ms-mark-check").count() == 1
        (folder,) = (tmp_path / "markerseek" / "registrations").iterdir()
        [checked] = [step for step in read_session(folder) if isinstance(step, SpotChecked)]
        assert f"{1e3 * checked.check.off_m:.2f} mm" in watched.text(".ms-answer")
        with watched.tab.expect_download(timeout=120_000) as waiting:
            watched.press("report PDF")
        assert Path(waiting.value.path()).read_bytes().startswith(b"%PDF")
        assert watched.problems == []
        watched.tab.context.close()
