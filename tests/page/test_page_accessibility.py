"""WCAG 2.2 AA on every page by axe-core, and the sizes that it does not measure."""

from __future__ import annotations

import pytest

from tests.page.page_browser import needs_browser, sync_api, violations

pytestmark = [pytest.mark.long, pytest.mark.real_time, needs_browser]

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_page_violates_aa_in_any_state(opened, scheme):
    watched = opened("/search", "&pace=0.02&seed=3&magic=1", color_scheme=scheme)
    # With a link that is partly wrong, while a search runs, and with its answer.
    assert violations(watched) == []
    watched.start()
    watched.wait_for(".ms-badge", "SEARCHING")
    assert violations(watched) == []
    watched.wait_for(".ms-badge", "FOUND")
    watched.tab.wait_for_selector("text=copy the angle")
    assert violations(watched) == []
    watched.unfold()
    watched.tab.get_by_label("acquisitions").fill("1")
    watched.tab.wait_for_selector(".ms-problem:visible")
    assert violations(watched) == []
    for path in ("/", "/race", "/replay"):
        assert violations(opened(path, color_scheme=scheme)) == [], path


@pytest.mark.parametrize("path", ["/", "/search", "/race", "/replay"])
def test_targets_of_a_finger_and_width_of_a_phone(opened, path):
    watched = opened(path, **PHONE)
    assert watched.tab.evaluate("document.documentElement.scrollWidth") <= 390
    targets = watched.tab.locator("a:visible, button:visible, .q-checkbox:visible, .q-field__control:visible")
    sizes = targets.evaluate_all("all => all.map(each => [each.innerText, each.getBoundingClientRect().toJSON()])")
    assert len(sizes) > 5
    assert [text for text, box in sizes if min(box["width"], box["height"]) < 44] == []


@pytest.mark.parametrize("options", [{}, PHONE], ids=["window", "phone"])
def test_no_name_in_a_field_is_cut(opened, options):
    watched = opened("/search", "&method=weighted-average&tissue=plastisol-phantom&readout_s=10&pace=0.01", **options)
    watched.unfold()
    shown = watched.tab.locator(".q-select .q-field__native span")
    sizes = shown.evaluate_all("all => all.map(each => [each.innerText, each.scrollWidth, each.clientWidth])")
    assert [text for text, _, _ in sizes] == ["weighted-average", "plastisol-phantom", "SonixDAQ, 10 s", "100 × faster"]
    assert [text for text, needed, has in sizes if needed > has] == []
    assert watched.tab.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_verdict_of_a_phone_is_read_from_two_metres(opened):
    watched = opened("/search", "&pace=0&seed=3", **PHONE)
    watched.search()
    watched.wait_for(".ms-badge", "FOUND")
    height = "each => parseFloat(getComputedStyle(each).fontSize)"
    # A capital of 0.7 of the size has 5 mm on a phone of 0.16 mm a pixel: 9 minutes of arc, of which 5 can be read.
    assert watched.tab.locator(".ms-badge").evaluate(height) >= 45
    assert watched.tab.locator(".ms-angle").evaluate(height) >= 60
    # Without scrolling.
    assert watched.tab.locator(".ms-interval").bounding_box()["y"] < 700


def test_answer_of_two_angles_stays_inside_a_phone(opened):
    watched = opened("/search", "&pace=0&seed=3", **PHONE)
    watched.search()
    watched.wait_for(".ms-badge", "^FOUND$")
    # Which search ends so depends on its last digits: the texts of one are shown in the place of those of another.
    watched.tab.evaluate(
        """() => { document.querySelector(".ms-badge").textContent = "AMBIGUOUS";
            document.querySelector(".ms-angle").textContent = "−28.9° or −12.5°"; }"""
    )
    assert watched.tab.evaluate("document.documentElement.scrollWidth") <= 390
    for name in (".ms-badge", ".ms-angle"):
        box = watched.tab.locator(name).bounding_box()
        assert box["x"] >= 0, name
        assert box["x"] + box["width"] <= 390, name


def test_fault_with_a_long_path_stays_inside_a_phone(opened):
    watched = opened("/search", "&pace=0&seed=3", **PHONE)
    path = "/" + "verylongnameofafolder" * 4
    watched.tab.evaluate(
        """text => { document.querySelector(".ms-verdict").className = "ms-verdict ms-verdict-fault";
            for (const name of [".ms-fault", ".ms-status", ".ms-log", ".ms-answer"])
                document.querySelector(name).textContent = text; }""",
        path,
    )
    assert watched.tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for name in (".ms-fault", ".ms-status", ".ms-log", ".ms-answer"):
        needed, has = watched.tab.locator(name).evaluate("each => [each.scrollWidth, each.clientWidth]")
        assert needed <= has, name


def test_keyboard_has_a_focus_that_is_seen(opened):
    watched = opened()
    for name in ("Start", "STOP"):
        target = watched.tab.get_by_role("button", name=name, exact=True)
        sync_api.expect(target).to_be_enabled()
        # With a key before: a focus by the pointer shows no ring.
        watched.tab.keyboard.press("Tab")
        target.focus()
        assert "5px" in target.evaluate("each => getComputedStyle(each).boxShadow")


def test_pictures_do_not_hold_a_page_open(opened):
    narrow = {"width": 820, "height": 1180}
    watched = opened("/search", "&pace=0&seed=3", viewport=narrow, has_touch=True, is_mobile=True)
    watched.search()
    watched.wait_for(".ms-badge", "FOUND")
    height = "document.querySelector('.ms-panel-fan').clientHeight"
    before = watched.tab.evaluate(height)
    # As a tablet that is turned, and turned back.
    for size, more in (({"width": 820, "height": 2400}, True), (narrow, False)):
        watched.tab.set_viewport_size(size)
        watched.tab.wait_for_function(f"({height} > {before} + 200) === {str(more).lower()}")
    watched.tab.wait_for_function(f"{height} === {before}")


def test_controls_of_a_search_are_one_row_on_a_laptop(opened):
    watched = opened("/search", "&readout_s=0.1", viewport={"width": 1280, "height": 800})
    assert watched.tab.locator(".ms-controls").first.bounding_box()["height"] < 60


def test_rows_use_the_height_of_the_window(opened):
    watched = opened("/search", "&pace=0&seed=3", viewport={"width": 1440, "height": 1400})
    watched.search()
    watched.tab.wait_for_selector("text=copy the angle")
    panels = watched.tab.locator(".ms-panels").bounding_box()
    assert panels["height"] > 1000
    assert watched.tab.locator(".ms-panel-fan").bounding_box()["height"] > 600
    assert watched.tab.evaluate("document.documentElement.scrollHeight") <= 1400
