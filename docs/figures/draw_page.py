"""Draws docs/figures/registration-page.png, page.png and page.gif: the live page of a session, and of a search.

Run by ``make figures``; it needs Chromium and the packages of the tests.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
QUERY = "&seed=3&readout_s=0.1&pace=1.6"
"""A search whose marker is near an end of the range, with a receiver that streams. It runs slower than a rig would, so
that a busy computer has the time to take all pictures."""

SESSION_SEED = 2
"""A session in which more than four markers are needed."""

EVENT = 16
"""Event that the still picture shows: the posterior has found a side, and the probe is on its way."""

STEP_S, SHOWN_MS, LAST_MS = 1.6, 180, 3000
"""Time from one picture to the next in the recording in s, and for which each, and the last, is shown in the GIF in ms:
five times faster than the rig."""

GIF_WIDTH, GIF_COLOURS, MAX_BYTES = 900, 200, 2_000_000


@contextmanager
def served(folder: str) -> Iterator[str]:
    """The link of a page on a free port, with a data folder of its own."""
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "markerseek", "page", "--port", "0"],
        stdout=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
        env=os.environ | {"XDG_DATA_HOME": folder, "PYTHONUNBUFFERED": "1"},
    )
    try:
        line = "" if process.stdout is None else process.stdout.readline()
        found = re.search(r"open (\S+)", line)
        if found is None:
            sys.exit(f"the page did not start: {line}")
        yield found[1]
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20)


def record(tab: Page) -> list[Image.Image]:
    """Screenshots from the start of a search to its end, one in `STEP_S`."""
    tab.get_by_role("button", name="Start", exact=True).click()
    began_s = time.monotonic()
    shots = []
    over = False
    while not over:
        over = tab.locator("text=copy the angle").is_visible()
        shots.append(Image.open(io.BytesIO(tab.screenshot())))
        tab.wait_for_timeout(1000 * max(0.0, began_s + STEP_S * len(shots) - time.monotonic()))
    return shots


def register(tab: Page, link: str) -> None:
    """A screenshot of a session on the simulated rig, once it asks for the fifth marker."""
    tab.set_viewport_size({"width": 1400, "height": 900})
    tab.goto(f"{link}&seed={SESSION_SEED}")
    tab.wait_for_function("window.markerseekBeat > 0")
    tab.get_by_role("button", name="Start", exact=True).click()
    asks = "document.querySelectorAll('.ms-table tbody tr').length > 3 && document.querySelector('.ms-mark-place')"
    tab.wait_for_function(asks, timeout=600_000)
    # An image is loaded after the marks over it.
    tab.wait_for_timeout(300)
    tab.screenshot(path=HERE / "registration-page.png")
    tab.locator(".ms-stop").click()
    tab.wait_for_selector("text=STOPPED")
    tab.set_viewport_size({"width": 1280, "height": 800})


def save_gif(shots: list[Image.Image], path: Path) -> None:
    """One loop of the screenshots."""
    small = [each.convert("RGB").resize((GIF_WIDTH, GIF_WIDTH * each.height // each.width)) for each in shots]
    # One palette for all: with one each, still parts of the picture would flicker.
    few = [np.asarray(each) for each in small[:: max(1, len(small) // 6)]]
    palette = Image.fromarray(np.vstack([*few, np.asarray(small[-1])])).quantize(GIF_COLOURS)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in small]
    durations_ms = [SHOWN_MS] * (len(frames) - 1) + [LAST_MS]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=durations_ms, loop=0, optimize=True)
    if path.stat().st_size > MAX_BYTES:
        sys.exit(f"{path} has {path.stat().st_size} bytes, more than {MAX_BYTES}; lower GIF_WIDTH or GIF_COLOURS")


def main() -> None:
    """Draw both."""
    chromium = os.environ.get("MARKERSEEK_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("no Chromium: apt-get install chromium, or name one in MARKERSEEK_CHROMIUM")
    with tempfile.TemporaryDirectory() as folder, served(folder) as link, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1280, "height": 800})
        # A busy computer is slow, not broken.
        tab.set_default_timeout(120_000)
        register(tab, link)
        tab.goto(link.replace("/?", "/search?") + QUERY)
        tab.wait_for_function("window.markerseekBeat > 0")
        # The kernels of posterior and images are loaded in the background.
        tab.wait_for_timeout(4000)
        save_gif(record(tab), HERE / "page.gif")
        slider = tab.locator(".ms-foot .q-slider__track-container").first
        slider.focus()
        while not tab.locator(".ms-foot .ms-note").first.inner_text().startswith(f"event {EVENT} "):
            slider.press("ArrowLeft")
            tab.wait_for_timeout(400)
        # Without its focus the slider has no label over the picture.
        slider.blur()
        tab.mouse.move(640, 790)
        tab.wait_for_timeout(1500)
        tab.screenshot(path=HERE / "page.png")
        browser.close()


if __name__ == "__main__":
    main()
