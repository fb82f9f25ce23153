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
    assert violations(opened("/", color_scheme=scheme)) == []


@pytest.mark.parametrize("path", ["/", "/search"])
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


def test_fault_with_a_long_path_stays_inside_a_phone(opened):
    watched = opened("/search", "&pace=0&seed=3", **PHONE)
    path = "/" + "verylongnameofafolder" * 4
    watched.tab.evaluate(
        """text => { document.querySelector(".ms-verdict").className = "ms-verdict ms-verdict-fault";
            for (const name of [".ms-fault", ".ms-log", ".ms-answer"])
                document.querySelector(name).textContent = text; }""",
        path,
    )
    assert watched.tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    for name in (".ms-fault", ".ms-log", ".ms-answer"):
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


SAID = {
    "short": ("light marker 2", "", "", ""),
    "usual": ("marker 12 is searched: hold laser, tissue and camera still", "", "registered: 0.91 mm", ""),
    "refused": (
        "light marker 5 in the circle",
        "no bright spot is in the left image; light it, or dim the room",
        "",
        "",
    ),
    "long": (
        "light marker 5 in the circle " * 3,
        "the spot moved by 3.2 px while it was measured " * 3,
        "so " * 90,
        "/a" * 99,
    ),
}
"""Sentences of different lengths: what to do, what went wrong, why, and what next."""

PARTS = (".ms-turn", ".ms-fault", ".ms-answer", ".ms-next")

LAYOUT = """([parts, said]) => {
    parts.forEach((css, i) => { document.querySelector(css).innerText = said[i]; });
    return [".ms-verdict", ".ms-panel-fan", ".ms-panel-curve"].map((css) => {
        const { top, height } = document.querySelector(css).getBoundingClientRect();
        return [Math.round(top), Math.round(height)];
    }); }"""
"""Says other sentences, and returns where the verdict and the panels are."""


@pytest.mark.parametrize("path", ["/", "/search"])
def test_nothing_moves_with_the_length_of_a_sentence(opened, path):
    watched = opened(path)
    for width in (1900, 1280, 900, 390):
        watched.tab.set_viewport_size({"width": width, "height": 900})
        watched.tab.wait_for_timeout(300)
        layouts = [watched.tab.evaluate(LAYOUT, [PARTS, said]) for said in SAID.values()]
        assert all(each == layouts[0] for each in layouts), (width, layouts)
        # What has no room is scrolled, and is not cut off.
        hidden = watched.tab.locator(".ms-where").evaluate("each => getComputedStyle(each).overflowY")
        assert hidden == "auto"


@pytest.mark.parametrize("path", ["/", "/search"])
def test_the_reason_and_the_table_grow_with_the_window(opened, path):
    watched = opened(path)
    parts = [".ms-answer", ".ms-next", *([".ms-table"] if path == "/" else [])]
    sizes = []
    for width in (1000, 1400, 1900):
        watched.tab.set_viewport_size({"width": width, "height": 1000})
        script = "parts => parts.map(css => parseFloat(getComputedStyle(document.querySelector(css)).fontSize))"
        sizes.append(watched.tab.evaluate(script, parts))
    for narrow, middle, wide in zip(*sizes, strict=True):
        assert 15 <= narrow <= middle < wide
        # 6 mm of a usual screen: read from two metres.
        assert wide >= 22


@pytest.mark.parametrize("path", ["/", "/search"])
def test_what_to_do_and_what_went_wrong_are_read_aloud(opened, path):
    watched = opened(path)
    for css, how in ((".ms-turn", "polite"), (".ms-fault", "assertive")):
        part = watched.tab.locator(css)
        assert part.get_attribute("aria-live") == how
        # It is there before it says anything: a reader hears changes only of what it knows.
        assert part.evaluate("each => getComputedStyle(each).display") == "block"
