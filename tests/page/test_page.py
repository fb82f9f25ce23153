"""The live page from the browser to the search and back, in a headless Chromium."""

from __future__ import annotations

import base64
import json
import os
import signal
from pathlib import Path

import numpy as np
import pytest

from markerseek.bridges import page as page_package
from markerseek.bridges.page.run_history import fan_model
from markerseek.core import PAPER_RANGE, RigFacts, SearchPlan
from markerseek.records.journal import RunView
from markerseek.show import DrawnAngle, DrawnCurve
from tests.page.page_browser import COLOURS, angle_of, needs_browser, sync_api

pytestmark = [pytest.mark.real_time, needs_browser]

BADGE = ".ms-badge"
ANGLE = ".ms-angles"
LOG = ".ms-log"

FACTS = RigFacts(kind="simulated", description="", fingerprint="", search=PAPER_RANGE)

STATIC = Path(page_package.__file__).parent / "static"


def downloaded(watched, name):
    with watched.tab.expect_download() as waiting:
        watched.press(name)
    with open(waiting.value.path(), "rb") as file:  # noqa: PTH123
        return file.read()


def test_search_gives_the_result_of_the_command(fresh_page, opened, command_result):
    watched = opened(query="&seed=3&pace=0", of=fresh_page)
    assert watched.text(".ms-banner").startswith("SIMULATED")
    assert "token" not in watched.tab.url
    assert watched.text(BADGE) == "READY"
    assert watched.text(".ms-next") == "press Start"
    fan = ".ms-panel-fan canvas"
    before = watched.tab.locator(".ms-panel-fan canvas").evaluate(COLOURS)
    watched.search()
    expected = command_result("--seed", "3")
    assert json.loads(downloaded(watched, "report JSON")) == expected
    watched.wait_for(BADGE, "^FOUND$")
    watched.wait_for(ANGLE, angle_of(expected))
    # The confirmation moves the answer a little, away from the probe.
    watched.wait_for(".ms-turn", r"^(the probe is on it|turn by [+−]0\.1°$)")
    watched.wait_for(".ms-interval", r"^95 %: −?\d")
    # Of the angle where the needle is, though images are formed later than the needle moves.
    sync_api.expect(watched.tab.locator(".ms-elsewhere")).to_have_count(0)
    watched.wait_for(".ms-image-title", r"^image of −?\d+\.\d\d°$")
    # Charts can stay empty without any error.
    watched.wait_for_colours(fan, more_than=before)
    assert watched.tab.locator(".ms-panel-curve svg circle").count() > 8
    assert watched.tab.locator(".ms-panel-curve svg .ms-inset path").count() > 3
    watched.wait_for_colours(".ms-panel-image canvas", more_than=100)


@pytest.mark.parametrize(("is_claimed", "share"), [(True, 1.0), (False, 8 / 12)])
def test_the_fan_draws_the_angle_of_the_curve_dashed_until_it_is_claimed(browser, is_claimed, share):
    """Straight up at 0 degrees, from the face of the probe to beyond the fan: 8 of 12 pixels of a dashed line."""
    curve = DrawnCurve(
        low_deg=-35.0, high_deg=35.0, answers=(DrawnAngle(angle_deg=0.0, text="0.00°"),), is_claimed=is_claimed
    )
    # On its way to an end, so that no needle lies on the answer.
    view = RunView(plan=SearchPlan(method="ternary"), facts=FACTS, probe_deg=-35.0, target_deg=-35.0)
    script = """async ([module, view]) => {
        const { default: fan } = await import(module);
        const canvas = document.body.appendChild(document.createElement("canvas"));
        canvas.style = "width: 400px; height: 400px";
        fan.methods.draw.call({ ...fan.methods, $el: canvas, view, curve: view.curve });
        const { data } = canvas.getContext("2d").getImageData(200, 0, 1, 400);
        const isAnswer = (row) => data[4 * row] > 120 && data[4 * row + 2] < 90;
        return Array.from({ length: 400 }, (_, row) => row).filter(isAnswer); }"""
    module = "data:text/javascript;base64," + base64.b64encode((STATIC / "fan.js").read_bytes()).decode()
    tab = browser.new_page()
    rows = tab.evaluate(script, [module, fan_model(view, curve)])
    tab.close()
    length = rows[-1] - rows[0]
    assert length > 150
    assert len(rows) == pytest.approx(share * length, abs=0.1 * length)


def test_the_image_is_drawn_where_its_edges_say(browser):
    """Two bright pixels; it fills 280 by 400 pixels of the canvas, 10 for a millimetre."""

    pixels = bytearray(40 * 28)
    pixels[3 * 28 + 6] = pixels[15 * 28 + 20] = 255
    image = {"pixels": base64.b64encode(pixels).decode(), "rows": 40, "columns": 28, "deg": 0, "peak": None}
    image |= {"lateral_mm": (-14, 14), "depth_mm": (0, 40)}
    script = """async ([module, view]) => {
        const { default: image } = await import(module);
        const canvas = document.body.appendChild(document.createElement("canvas"));
        canvas.style = "width: 332px; height: 448px";
        image.methods.draw.call({ $el: canvas, view });
        // Without the ticks around it and the scale bar; what is not black, as number of the pixel and level of red.
        const { data } = canvas.getContext("2d").getImageData(44, 8, 280, 360);
        const red = Array.from({ length: 280 * 360 }, (_, i) => [i, data[4 * i]]);
        return red.filter((each) => each[1] > 0); }"""
    module = "data:text/javascript;base64," + base64.b64encode((STATIC / "image.js").read_bytes()).decode()
    tab = browser.new_page()
    number, level = np.array(tab.evaluate(script, [module, image]), float).T
    tab.close()
    across_mm = (number % 280 + 0.5) / 10 - 14
    down_mm = (number // 280 + 0.5) / 10
    for half, place_mm in ((across_mm < 0, (-7.5, 3.5)), (across_mm > 0, (6.5, 15.5))):
        middle_mm = [np.average(each[half], weights=level[half]) for each in (across_mm, down_mm)]
        # Half a pixel of the canvas.
        assert middle_mm == pytest.approx(place_mm, abs=0.05)
        assert level[half].max() > 240


@pytest.mark.long
def test_everything_is_on_the_first_screen(opened):
    watched = opened(query="&pace=0")
    watched.search()
    watched.wait_for(BADGE, "^FOUND$")
    watched.tab.wait_for_selector("text=copy the angle")
    assert watched.tab.evaluate("document.documentElement.scrollHeight") <= 800
    assert watched.tab.evaluate("document.documentElement.scrollWidth") <= 1280


def assert_as_good(result, whole, *, kept):
    """The result of a search that went on is as good as that of one without a stop, and has its first samples."""
    assert result["answer"] == whole["answer"] == "found"
    assert abs(result["angle_deg"] - whole["angle_deg"]) < 3 * max(result["sigma_deg"], whole["sigma_deg"])
    assert result["samples"][:kept] == whole["samples"][:kept]
    assert len(result["samples"]) == result["acquisitions"]


@pytest.mark.long
def test_a_stopped_search_goes_on_to_a_result_as_good(opened, command_result):
    watched = opened(query="&seed=4&pace=0.02")
    watched.start()
    watched.wait_for(LOG, "acquisition 3:")
    watched.tab.locator(".ms-stop").click()
    watched.wait_for(BADGE, "^STOPPED$")
    watched.press("Go on")
    watched.wait_for(BADGE, "^FOUND$")
    assert_as_good(json.loads(downloaded(watched, "report JSON")), command_result("--seed", "4"), kept=3)
    # Images of acquisitions before the stop are still there.
    watched.wait_for_colours(".ms-panel-image canvas", more_than=100)


@pytest.mark.long
def test_killed_child_is_said_and_can_go_on(opened, page, command_result):
    watched = opened(query="&seed=6&pace=0.02")
    watched.start()
    watched.wait_for(LOG, "acquisition 2:")
    for child in page.children():
        os.kill(child, signal.SIGKILL)
    watched.wait_for(BADGE, "^FAULT$")
    watched.wait_for(".ms-fault", "exit code 137")
    watched.wait_for(".ms-next", "^Go on continues it")
    watched.press("Go on")
    watched.wait_for(BADGE, "^FOUND$")
    assert_as_good(json.loads(downloaded(watched, "report JSON")), command_result("--seed", "6"), kept=2)


@pytest.mark.long
def test_link_holds_the_settings(opened, command_result):
    watched = opened(query="&method=ternary&seed=7&snr_db=30&pace=0&tissue=liver")
    watched.tab.get_by_label("seed").fill("8")
    watched.tab.wait_for_url("**/search?method=ternary&seed=8&snr_db=30&tissue=liver&pace=0")
    watched.search()
    watched.wait_for(BADGE, "^(FOUND|UNSURE|NOT FOUND|AMBIGUOUS|AT BOUND)$")
    options = ("--method", "ternary", "--tissue", "liver", "--snr-db", "30", "--seed", "8")
    assert json.loads(downloaded(watched, "report JSON")) == command_result(*options)


def test_link_that_cannot_be_used_is_said(opened):
    watched = opened(query="&seed=-5&method=magic")
    problem = watched.text(".ms-problem:visible")
    assert all(each in problem for each in ("'magic' is unknown", "seed is −5", "left out")), problem
    assert watched.tab.get_by_label("seed").input_value() == "1"


def test_setting_that_cannot_be_used_is_said(opened):
    # A link with a setting is not changed by what another test has searched.
    watched = opened(query="&method=posterior")
    watched.unfold()
    watched.tab.get_by_label("acquisitions").fill("1")
    watched.tab.wait_for_selector("text=at least 2 are needed")
    # Nor is another search started than the one that is shown.
    watched.tab.get_by_label("acquisitions").fill("")
    # One change after the other: the page answers the first before a person makes the second.
    watched.tab.wait_for_selector("text=at least 2 are needed", state="hidden")
    watched.tab.get_by_role("checkbox", name="as published").click()
    watched.tab.wait_for_selector("text=it is markerseek's own")
    # Said once, below the fields, and nothing can be started.
    assert watched.tab.locator(".q-notification").count() == 0
    # The buttons follow with the next update of the page.
    sync_api.expect(watched.tab.get_by_role("button", name="Start", exact=True)).to_be_disabled()
    watched.tab.get_by_label("method").click()
    watched.tab.get_by_role("option", name="ternary").click()
    watched.tab.wait_for_url("**/search?method=ternary&as_published=1*")
    sync_api.expect(watched.tab.locator(".ms-problem:visible")).to_have_count(0)
    sync_api.expect(watched.tab.get_by_role("button", name="Start", exact=True)).to_be_enabled()


@pytest.mark.parametrize(
    ("path", "label", "typed", "said"),
    [
        ("/", "markers", "4.25", "markers is '4.25', it must be a whole number"),
        ("/", "seed", "", "seed is empty, it needs a value, such as 1"),
        ("/", "TRE [mm]", "31", "TRE [mm] is 31.0 mm, it must lie in"),
        ("/search", "seed", "", "seed is empty"),
        ("/search", "seed", "2.5", "seed is '2.5', it must be a whole number"),
        ("/search", "acquisitions", "7.5", "acquisitions is '7.5', it must be a whole number"),
        ("/search", "± [mm]", "0", "± [mm] is 0"),
        ("/search", "SNR [dB]", "400", "SNR [dB]: noise: peak_snr_db is 400.0 dB, it must lie in"),
    ],
)
def test_a_field_refuses_what_it_cannot_mean_and_names_itself_by_its_label(opened, path, label, typed, said):
    watched = opened(path, "&pace=0.2" if path == "/" else "&method=posterior")
    watched.unfold()
    field = watched.tab.get_by_role("spinbutton", name=label, exact=True)
    usual = field.input_value()
    field.fill(typed)
    watched.tab.wait_for_selector(f".ms-problem:visible >> text={said}")
    start = watched.tab.get_by_role("button", name="Start", exact=True)
    sync_api.expect(start).to_be_disabled()
    # Another field that is right does not make this one right.
    watched.tab.get_by_role("checkbox", name="sweep").click()
    watched.tab.wait_for_timeout(600)
    assert said in watched.text(".ms-problem:visible")
    sync_api.expect(start).to_be_disabled()
    field.fill(usual)
    sync_api.expect(watched.tab.locator(".ms-problem:visible")).to_have_count(0)
    sync_api.expect(start).to_be_enabled()


def test_escape_stops(opened, page):
    watched = opened(query="&pace=1")
    watched.start()
    watched.wait_for(LOG, "dark frame 1")
    watched.tab.keyboard.press("Escape")
    watched.wait_for(BADGE, "^STOPPED$")
    assert page.children() == []


@pytest.mark.long
def test_angle_is_copied(opened):
    watched = opened(query="&seed=3&pace=0", permissions=["clipboard-read", "clipboard-write"])
    watched.search()
    watched.press("copy the angle")
    watched.tab.wait_for_selector("text=in the clipboard")
    # The browser writes it when it comes to it.
    watched.tab.wait_for_function("navigator.clipboard.readText().then(text => text !== '')")
    copied = watched.tab.evaluate("navigator.clipboard.readText()")
    # On a slow machine the buttons are there before the angle is.
    watched.wait_for(".ms-angle", r"\d")
    shown = watched.text(".ms-angle").rstrip("°").replace("−", "-")
    # Both are rounded, the copy to four digits.
    assert float(shown) == pytest.approx(float(copied), abs=0.51 * 10.0 ** -len(shown.partition(".")[2]))


@pytest.mark.long
def test_slider_goes_back_and_forth(opened):
    watched = opened(query="&seed=3&pace=0")
    watched.search()
    watched.wait_for(BADGE, "^FOUND$")
    watched.tab.locator(".ms-foot .q-slider__track-container").first.focus()
    for _ in range(3):
        watched.tab.keyboard.press("PageDown")
    # Before the first acquisition there is no angle.
    watched.wait_for(ANGLE, "^–?$")
    watched.press("newest")
    watched.wait_for(ANGLE, "±")


@pytest.mark.long
def test_three_viewers_see_the_same(opened, command_result):
    expected = command_result("--seed", "9")
    one, two, three = (opened(query="&seed=9&pace=0") for _ in range(3))
    one.search()
    for each in (one, two, three):
        each.wait_for(BADGE, "^FOUND$")
        each.wait_for(ANGLE, angle_of(expected))


@pytest.mark.long
def test_report_is_drawn(opened):
    watched = opened(query="&seed=3&pace=0")
    watched.search()
    watched.wait_for(BADGE, "^FOUND$")
    assert downloaded(watched, "report PNG").startswith(b"\x89PNG")
    assert b"<html" in downloaded(watched, "report HTML")
