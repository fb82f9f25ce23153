"""The page on an emulated rig of devices: armed in the terminal, never in the browser."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from markerseek.core import Measured
from markerseek.records.journal import Interrupted, read_journal
from tests.emulated import WORLD, emulation, fixed_bench
from tests.page.page_browser import needs_browser, open_tab, served, sync_api

pytestmark = [pytest.mark.real_time, needs_browser]

VIEWER = Path(__file__).with_name("page_viewer.py")


@pytest.mark.long
def test_nobody_at_the_terminal_is_not_armed(browser, tmp_path):
    with fixed_bench(tmp_path, seed=3) as devices:
        with served(tmp_path, "--rig", str(devices.rig)) as page:
            watched = open_tab(browser, page)
            assert watched.text(".ms-banner").startswith("A RIG OF DEVICES")
            # Settings of a simulation are not on the page of a bench.
            assert watched.tab.get_by_label("seed").count() == 0
            watched.press("Start")
            watched.wait_for(".ms-badge", "^NOT ARMED$")
            watched.wait_for(".ms-answer", "^nothing moved and nothing was fired")
            watched.wait_for(".ms-next", "^Start begins a new search$")
            assert page.journals() == []
            watched.tab.context.close()
        low_deg, high_deg, pulses = devices.end()
    assert (low_deg, high_deg, pulses) == (0.0, 0.0, 0)


def test_armed_in_the_terminal_and_stopped_in_the_browser(browser, tmp_path):
    terminal, inside = os.openpty()
    with fixed_bench(tmp_path, seed=3) as devices:
        with served(tmp_path, "--rig", str(devices.rig), stdin=inside) as page:
            watched = open_tab(browser, page, "/search", "&method=weighted-average&acquisitions=8&as_published=1")
            others = [subprocess.Popen([sys.executable, str(VIEWER), page.link]) for _ in range(2)]
            watched.press("Start")
            page.wait_for_text("name of the rig: ")
            said = (page.data / "page.stderr").read_text()
            assert "asked by: a browser at 127.0.0.1\nArm the laser and search?" in said
            watched.wait_for(".ms-badge", "^STARTING$")
            watched.wait_for(".ms-next", "^answer in the terminal where the page was started$")
            os.write(terminal, b"rig.toml\n")
            watched.wait_for(".ms-log", "acquisition 1:", timeout_ms=120_000)
            others[0].send_signal(signal.SIGSTOP)
            watched.wait_for(".ms-log", "acquisition 2:", timeout_ms=120_000)
            watched.tab.locator(".ms-stop").click()
            watched.wait_for(".ms-badge", "^STOPPED$")
            # Three viewers, one of them stopped, and no lease has lapsed: that would have ended the search before.
            events = [entry.event for entry in read_journal(page.journals()[-1]).entries]
            assert isinstance(events[-1], Interrupted)
            lit = sum(isinstance(event, Measured) and not event.sample.dark for event in events)
            for each in others:
                each.kill()
                each.wait()
            # The rig would have to be armed again, which is for the terminal.
            sync_api.expect(watched.tab.get_by_role("button", name="Go on", exact=True)).to_be_hidden()
            watched.tab.context.close()
            assert watched.problems == []
        low_deg, high_deg, pulses = devices.end()
    os.close(terminal)
    os.close(inside)
    # As the emulator knows in truth: inside the limits of travel, and no pulses but those of the acquisitions in the
    # journal and of the one that was stopped.
    assert -36.5 <= low_deg <= high_deg <= 36.5
    assert lit >= 2
    assert 16 * lit <= pulses <= 16 * (lit + 1)


@pytest.mark.long
def test_a_spot_that_is_set_in_the_browser_is_looked_for(browser, tmp_path):
    terminal, inside = os.openpty()
    world = WORLD.replace("[marker]\nangle_deg = 6.4\n", "")
    with emulation(tmp_path, "--endoscope", seed=3, text=world) as devices:
        bench = devices.folder
        images = f"{bench / 'left'} {bench / 'right'}"
        rig = ("--rig", str(devices.rig), "--cameras", str(bench / "stereo.toml"), "--images", images)
        with served(tmp_path, *rig, stdin=inside) as page:
            watched = open_tab(browser, page, "/", "&sweep=0&markers=3&endoscope_held=1")
            button = watched.tab.get_by_role("button", name="Spot is set", exact=True)
            sync_api.expect(button).to_be_hidden()
            watched.press("Start")
            page.wait_for_text("name of the rig: ")
            os.write(terminal, b"rig.toml\n")
            watched.wait_for(".ms-turn", "the laser is dark: press Spot is set", timeout_ms=120_000)
            watched.press("Spot is set")
            watched.wait_for(".ms-badge", "^SEARCHING$", timeout_ms=120_000)
            sync_api.expect(button).to_be_hidden()
            watched.tab.locator(".ms-stop").click()
            watched.wait_for(".ms-badge", "^STOPPED$")
            watched.tab.context.close()
            assert watched.problems == []
        devices.ended()
    os.close(terminal)
    os.close(inside)
