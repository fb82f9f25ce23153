"""Draws docs/figures/page.png and page.gif: the live page during a search on the simulated rig.

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
from itertools import pairwise
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
QUERY = "&seed=3&pace=0.06"
"""A search whose marker is near an end of the range, a second of the page for 17 of the rig."""

EVENT = 16
"""Event that the still picture shows: the posterior has found a side, and the probe is on its way."""

GIF_WIDTH, GIF_COLOURS, MOST_BYTES = 900, 96, 2_000_000

LONGEST_MS = 1200
"""Longest time that one picture of the GIF stays, in ms: a busy machine takes pictures late."""


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


def record(tab: Page) -> list[tuple[float, Image.Image]]:
    """Screenshots from the start of a search to its end, with their times."""
    tab.get_by_role("button", name="Start", exact=True).click()
    shots = []
    while not tab.locator("text=copy the angle").is_visible():
        shots.append((time.monotonic(), Image.open(io.BytesIO(tab.screenshot()))))
    shots.append((time.monotonic(), Image.open(io.BytesIO(tab.screenshot()))))
    return shots


def save_gif(shots: list[tuple[float, Image.Image]], path: Path) -> None:
    """One loop of the screenshots, each picture once; the last one stays for three seconds."""
    # Pillow would join equal pictures to one that stays as long as all of them.
    shots = [shots[0], *(now for before, now in pairwise(shots) if now[1].tobytes() != before[1].tobytes())]
    times_s = [at_s for at_s, _ in shots]
    durations_ms = [min(round(1000 * (end - begin)), LONGEST_MS) for begin, end in pairwise(times_s)]
    small = [each.convert("RGB").resize((GIF_WIDTH, GIF_WIDTH * each.height // each.width)) for _, each in shots]
    # One palette for all: with one each, still parts of the picture would flicker.
    palette = small[-1].quantize(GIF_COLOURS)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in small]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=[*durations_ms, 3000], loop=0, optimize=True)
    if path.stat().st_size > MOST_BYTES:
        sys.exit(f"{path} has {path.stat().st_size} bytes, more than {MOST_BYTES}; lower GIF_WIDTH or GIF_COLOURS")


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
        tab.goto(link + QUERY)
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
