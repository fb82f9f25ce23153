"""Race, your turn and replay in a headless Chromium."""

from __future__ import annotations

import json
import re

import pytest

from tests.page.page_browser import needs_browser, sync_api

pytestmark = [pytest.mark.real_time, needs_browser]

STATUS, ANGLE = ".ms-status", ".ms-angle"


def test_race_on_the_same_scene(opened, command_result):
    watched = opened("/race", "&seed=2")
    watched.tab.get_by_label("speed").click()
    watched.tab.get_by_role("option", name="no waiting").click()
    # The link holds what was chosen.
    watched.tab.wait_for_url("**/race?seed=2&pace=0*")
    watched.search("Start the race")
    watched.wait_for(STATUS, "^over$")
    watched.tab.wait_for_selector("text=posterior is first")
    results = [command_result("--seed", "2", "--method", method) for method in ("posterior", "ternary")]
    assert watched.tab.locator(ANGLE).count() == len(results)
    for place, each in enumerate(results):
        name = f"{each['method']}, seed 2"
        angle = f"{each['angle_deg']:.3f}° ± {each['sigma_deg']:.3f}°"
        watched.wait_for(f"{ANGLE} >> nth={place}", re.escape(angle))
        watched.wait_for(f".ms-counts >> nth={place}", f"^{name}: {each['acquisitions']} acquisitions")


def test_your_turn_by_keys(opened):
    watched = opened("/turn")
    watched.tab.locator("body").click(position={"x": 4, "y": 790})
    for _ in range(3):
        watched.tab.keyboard.press("Shift+ArrowLeft")
    watched.wait_for(".ms-foot .ms-note >> nth=0", r"turn to -15\.0")
    watched.tab.keyboard.press("Enter")
    watched.wait_for(".ms-log", r"acquisition 1: -15\.0")
    watched.press("It is here")
    watched.wait_for(".ms-help", r"^You named -15\.0°, the marker is at -16\.69°: 1\.69° off, after 1 acquisition,")
    watched.press("See the posterior do it")
    watched.tab.wait_for_url("**/?seed=2*")
    watched.wait_for(STATUS, r"^found at -16\.", timeout_ms=120_000)


def wait_for_density(tab, *, drawn):
    """Wait until the area below the density is drawn in the chart, or nothing has its colour."""
    script = """drawn => { const canvas = document.querySelector('.ms-panel-curve canvas');
        const d = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data; let seen = 0;
        for (let i = 0; i < d.length; i += 4)
            seen += [86, 180, 233, 89].every((level, n) => Math.abs(d[i + n] - level) < 8);
        return drawn ? seen > 1000 : seen === 0; }"""
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
    watched.tab.get_by_role("option", name=journal.name).click()
    watched.wait_for(ANGLE, f"^{result['angle_deg']:.3f}° ± {result['sigma_deg']:.3f}°$")
    slider = watched.tab.locator(".ms-foot .q-slider__track-container").first
    slider.focus()
    for _ in range(3):
        slider.press("PageDown")
    watched.wait_for(ANGLE, "^–$")
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
    watched.wait_for(ANGLE, "^–$")
    wait_for_density(watched.tab, drawn=False)
    sync_api.expect(log).to_have_text("")


def test_replay_of_a_bank_is_a_search_on_it(opened, shell):
    watched = opened("/replay")
    watched.tab.get_by_label("recording").click()
    watched.tab.get_by_role("option", name="simulated_scan.csv").click()
    watched.press("Search it")
    watched.wait_for(STATUS, "^(found at|unsure|not found|at bound|ambiguous)")
    expected = json.loads(shell("replay", "examples/simulated_scan.csv", "--json")[1])
    watched.wait_for(ANGLE, "^" + re.escape(f"{expected['angle_deg']:.3f}°"))
    assert watched.text(".ms-banner").startswith("REPLAYED")
