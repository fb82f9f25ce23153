"""A registration session in the browser: seen from its first spot to its end, stopped, killed, and reloaded."""

from __future__ import annotations

import json
import os
import re
import select
import signal
from pathlib import Path

import msgspec
import pytest

from markerseek.records.journal import Interrupted, read_journal
from markerseek.registration import Registered, SpotSeen, TakenMarker, Waiting, read_session
from tests.page.page_browser import needs_browser, open_tab, require_legible, served, sync_api

pytestmark = [pytest.mark.real_time, needs_browser]

BADGE = ".ms-badge"
ROWS = ".ms-table tbody tr"

# A session of the simulated rig computes for half a minute, more on a busy computer.
SESSION_MS = 400_000

RECORDED = """() => { window.marks = {}; window.badges = [];
    new MutationObserver(() => {
        const badge = document.querySelector(".ms-badge").innerText;
        if (window.badges.at(-1) !== badge) window.badges.push(badge);
        for (const side of ["left", "right"])
            for (const kind of ["place", "spot"])
                for (const each of document.querySelectorAll(`.ms-panel-${side} .ms-mark-${kind}`)) {
                    const key = `${side} ${kind}`;
                    window.marks[key] ??= [];
                    const at = each.getAttribute("d") ?? `${each.getAttribute("cx")} ${each.getAttribute("cy")}`;
                    if (!window.marks[key].includes(at)) window.marks[key].push(at);
                }
    }).observe(document.body, { subtree: true, childList: true, characterData: true, attributes: true }); }"""
"""Notes all places of circle and cross, and all words of the badge."""


def folder_of(page) -> Path:
    (folder,) = (page.data / "markerseek" / "registrations").iterdir()
    return folder


def test_a_whole_session_is_seen_and_a_reload_shows_it_too(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/", "&seed=3&markers=3&pace=0")
        assert watched.text(".ms-next").startswith("press Start")
        watched.tab.evaluate(RECORDED)
        watched.start()
        watched.wait_for(BADGE, "^REGISTERED", timeout_ms=SESSION_MS)
        steps = read_session(folder_of(page))
        last = [step for step in steps if isinstance(step, Registered)][-1]
        taken = [step for step in steps if isinstance(step, TakenMarker)]
        assert len(taken) == 3
        # Every spot had its cross, and every place its circle, in the pixels of the record.
        marks = watched.tab.evaluate("window.marks")
        places = [step.place for step in steps if isinstance(step, Waiting) and step.place is not None]
        for side in ("left", "right"):
            seen = [getattr(place, f"{side}_px") for place in places]
            assert marks[f"{side} place"] == [f"{x:.1f} {y:.1f}" for x, y in seen]
            spots = [getattr(step.spot, f"{side}_px") for step in steps if isinstance(step, SpotSeen)]
            middles = [middle_of(path) for path in marks[f"{side} spot"]]
            assert middles == [pytest.approx(spot, abs=0.1) for spot in spots]
        assert {"LIGHT A SPOT", "SEARCHING"} <= set(watched.tab.evaluate("window.badges"))
        tre = f"{1e3 * last.report.tre_m:.2f} mm"
        for again in (False, True):
            if again:
                watched.tab.reload()
                watched.wait_for(BADGE, "^REGISTERED")
            assert watched.text(".ms-angle") == tre
            rows = [row.split() for row in watched.tab.locator(ROWS).all_inner_texts()]
            residuals = {point.name: f"{1e3 * point.residual_m:.2f}" for point in last.report.points}
            assert rows == [
                [
                    marker.name,
                    "found",
                    f"{marker.candidates[0].angle_deg:.2f}".replace("-", "−"),
                    str(marker.acquisitions),
                    residuals[marker.name],
                    "used",
                ]
                for marker in taken
            ]
            for side in ("left", "right"):
                image = watched.tab.locator(f".ms-panel-{side} img")
                watched.tab.wait_for_function("each => each.naturalWidth > 100", arg=image.element_handle())
                assert watched.tab.locator(f".ms-panel-{side} .ms-mark-target").count() == 1
                assert watched.tab.locator(f".ms-panel-{side} .ms-mark-marker").count() == 3
            # The chart of the expected error, and the fan of the last search.
            assert watched.tab.locator(".ms-panel-tre svg circle").count() == 1
            watched.wait_for_colours(".ms-panel-fan canvas", more_than=10)
        with watched.tab.expect_download() as waiting:
            watched.press("registration JSON")
        given = json.loads(Path(waiting.value.path()).read_bytes())
        assert given.pop("simulation") == {"simulated": True, "seed": 3}
        assert given == json.loads(msgspec.json.encode(last.report))
        require_legible(watched, 390, 900, 1400)
        assert watched.problems == []
        watched.tab.context.close()


def middle_of(path: str) -> tuple[float, float]:
    """Where the arms of a cross meet."""
    ends = [float(number) for number in re.findall(r"[\d.]+", path)]
    return sum(ends[::2]) / len(ends[::2]), sum(ends[1::2]) / len(ends[1::2])


def test_stop_in_a_session_ends_it_and_a_killed_one_is_said(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/", "&pace=1")
        watched.start()
        watched.wait_for(BADGE, "^SEARCHING$")
        # The first frame of the search.
        watched.tab.wait_for_selector(".ms-panel-curve svg circle")
        watched.tab.locator(".ms-stop").click()
        watched.wait_for(BADGE, "^STOPPED$")
        assert page.children() == []
        folder = folder_of(page)
        assert isinstance(read_journal(folder / "1.journal").entries[-1].event, Interrupted)
        watched.tab.reload()
        watched.wait_for(BADGE, "^STOPPED$")
        command = f"markerseek register --simulate --sweep --seed=1 --pace=1 --textured --continue {folder}"
        watched.wait_for(".ms-next", f"{re.escape(command)}$")
        # It goes on with the spot whose search was stopped, in the same folder.
        watched.press("Go on")
        watched.wait_for(BADGE, "^SEARCHING$")
        assert folder_of(page) == folder
        # Nothing else runs beside a session.
        search = open_tab(browser, page, "/search")
        sync_api.expect(search.tab.get_by_role("button", name="Start", exact=True)).to_be_disabled()
        (child,) = page.children()
        os.kill(child, signal.SIGKILL)
        watched.wait_for(BADGE, "^FAULT$")
        watched.wait_for(".ms-fault", "exit code 137, by SIGKILL")
        assert watched.problems == []
        for each in (watched, search):
            each.tab.context.close()


def test_a_page_that_is_started_again_continues_the_session_of_one_that_was_killed(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/", "&pace=1&seed=6")
        watched.start()
        watched.wait_for(BADGE, "^SEARCHING$")
        watched.tab.wait_for_selector(".ms-panel-curve svg circle")
        folder = folder_of(page)
        (child,) = page.children()
        page.process.kill()
        # It ends within 5 s; the others are for a busy computer.
        ended = os.pidfd_open(child)
        assert select.select([ended], [], [], 15)[0]
        os.close(ended)
        watched.tab.context.close()
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/")
        watched.wait_for(BADGE, "^STOPPED$")
        watched.wait_for(".ms-answer", "^the program that ran this session has ended; the laser is disarmed")
        assert watched.tab.get_by_role("spinbutton", name="seed").input_value() == "6"
        watched.tab.evaluate(RECORDED)
        watched.press("Go on")
        watched.wait_for(BADGE, "^SEARCHING$")
        assert folder_of(page) == folder
        # While the command starts, the page does not say that it searches.
        badges = watched.tab.evaluate("window.badges")
        assert badges.index("STARTING") < badges.index("SEARCHING")
        assert watched.problems == []
        watched.tab.context.close()
