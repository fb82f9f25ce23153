"""The replay in a headless Chromium."""

from __future__ import annotations

import json
import re

import pytest

from tests.page.page_browser import angle_of, needs_browser, sync_api

pytestmark = [pytest.mark.real_time, needs_browser]

STATUS, ANGLE = ".ms-status", ".ms-angles"


def wait_for_density(tab, *, drawn):
    """Wait until the area below the density is drawn in the chart, or nothing has its colour."""
    script = """drawn => { const areas = document.querySelectorAll('.ms-panel-curve svg > .ms-density');
        const widths = Array.from(areas, each => each.getBoundingClientRect().width);
        return drawn ? Math.max(0, ...widths) > 100 : Math.max(0, ...widths) === 0; }"""
    tab.wait_for_function(script, arg=drawn)


@pytest.fixture
def journal(page):
    """A path in the folder of the journals, where no other test finds it as the newest."""
    path = page.data / "markerseek" / "journals" / "seed-3.journal"
    path.parent.mkdir(parents=True, exist_ok=True)
    yield path
    path.unlink(missing_ok=True)


def test_replay_of_a_journal(opened, journal, shell):
    result = json.loads(shell("search", "--seed", "3", "--journal", journal, "--json")[1])
    watched = opened("/replay")
    watched.tab.get_by_label("recording").click()
    # The list says what the run has found, in which tissue, and with which seed.
    found = f"found at {result['angle_deg']:.3f}°".replace("-", "−")
    listed = watched.tab.get_by_role("option", name=re.compile(rf"{journal.name}: {found}; .*, seed 3"))
    sync_api.expect(listed).to_have_count(1)
    listed.click()
    watched.wait_for(ANGLE, "^" + angle_of(result))
    watched.tab.wait_for_url(f"**/replay?recording={journal.name}")
    again = opened("/replay", f"&recording={journal.name}")
    again.wait_for(ANGLE, "^" + angle_of(result))
    unknown = opened("/replay", "&recording=nobody.journal")
    unknown.wait_for(".ms-next", "'nobody.journal' is no recording here")
    slider = watched.tab.locator(".ms-foot .q-slider__track-container").first
    slider.focus()
    for _ in range(3):
        slider.press("PageDown")
    watched.wait_for(ANGLE, "^$")
    watched.tab.get_by_label("play").click()
    watched.wait_for(ANGLE, "±")
    assert watched.text(".ms-banner").startswith("SIMULATED")
    # While little is known the density is wide.
    watched.press("newest")
    for _ in range(4):
        slider.press("PageDown")
    wait_for_density(watched.tab, drawn=False)
    log = watched.tab.locator(".ms-log")
    while not re.search("acquisition 1:", before := watched.text(".ms-log")):
        slider.press("ArrowRight")
        # Each event is a line of the log; a second key before that would go past the first acquisition.
        sync_api.expect(log).not_to_have_text(before)
    # What the policy believes after an acquisition comes with the angle that it asks for next.
    slider.press("ArrowRight")
    wait_for_density(watched.tab, drawn=True)
    # Nothing of a recording is left once another is chosen.
    watched.tab.get_by_label("recording").click()
    watched.tab.get_by_role("option", name="simulated_scan.csv").click()
    watched.wait_for(ANGLE, "^$")
    watched.wait_for(".ms-next", "^choose a method, then search$")
    wait_for_density(watched.tab, drawn=False)
    sync_api.expect(log).to_have_text("")


@pytest.mark.long
def test_replay_of_a_bank_is_a_search_on_it(opened, shell):
    watched = opened("/replay")
    watched.tab.get_by_label("recording").click()
    watched.tab.get_by_role("option", name="simulated_scan.csv").click()
    watched.press("Search it")
    watched.wait_for(STATUS, "^(found at|unsure|not found|at bound|ambiguous)")
    expected = json.loads(shell("replay", "examples/simulated_scan.csv", "--json")[1])
    watched.wait_for(ANGLE, r"^(best guess)?\s*" + angle_of(expected))
    # The answer is from all angles; what a search would have said stands below it.
    assert expected["search"]["acquisitions"] < expected["acquisitions"]
    took = f"{expected['search']['acquisitions']} acquisitions"
    watched.wait_for(".ms-next", f"^a search would have said: posterior, after {took} and .*: found, ")
    assert watched.text(".ms-banner").startswith("REPLAYED")
