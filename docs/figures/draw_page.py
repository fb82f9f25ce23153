"""Draws the live page of a session: docs/figures/registration-page.png, and session.gif, which moves.

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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
SESSION_SEED = 31
"""That of the tutorial: more than four markers are needed."""

MOST_LOOKS = 5_000
"""Most looks at the page until the session must be over, some 0.5 s apart."""

GIF_WIDTH = 860
"""Width of the moving picture in pixels."""

MOST_FRAMES = 26
FRAME_MS = 400
LAST_MS = 2500
"""Most pictures of it, how long each is shown, and the last one, in milliseconds."""


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


ASKS = "document.querySelectorAll('.ms-table tbody tr').length > 2 && !!document.querySelector('.ms-mark-place')"
BEGINS = "document.querySelector('.ms-badge').innerText.startsWith('LIGHT')"
OVER = "document.querySelector('.ms-badge').innerText.startsWith('REGISTERED')"


def register(tab: Page, link: str) -> list[bytes]:
    """Return pictures of a session on the simulated rig; that in which it asks for the fourth marker is written."""
    tab.goto(f"{link}&seed={SESSION_SEED}&pace=0")
    tab.wait_for_function("window.markerseekBeat > 0")
    tab.get_by_role("button", name="Start", exact=True).click()
    tab.wait_for_function(BEGINS)
    seen: list[bytes] = []
    is_drawn = False
    for _ in range(MOST_LOOKS):
        if not is_drawn and tab.evaluate(ASKS):
            # An image is loaded after the marks over it.
            tab.wait_for_timeout(300)
            tab.screenshot(path=HERE / "registration-page.png")
            is_drawn = True
        picture = tab.screenshot()
        if not seen or picture != seen[-1]:
            seen.append(picture)
        if tab.evaluate(OVER):
            return [*seen, tab.screenshot()]
        tab.wait_for_timeout(400)
    sys.exit("the session did not end")


def move(pictures: Sequence[bytes]) -> None:
    """Write the moving picture, of pictures that are evenly chosen; the last one stays."""
    chosen = sorted({round(n * (len(pictures) - 1) / (MOST_FRAMES - 1)) for n in range(MOST_FRAMES)})
    small = []
    for n in chosen:
        picture = Image.open(io.BytesIO(pictures[n])).convert("RGB")
        height = round(picture.height * GIF_WIDTH / picture.width)
        small.append(picture.resize((GIF_WIDTH, height), Image.Resampling.LANCZOS))
    # One palette for all, or each picture flickers: of the first, a middle and the last one.
    sample = Image.new("RGB", (GIF_WIDTH, 3 * small[0].height))
    for row, each in enumerate((small[0], small[len(small) // 2], small[-1])):
        sample.paste(each, (0, row * each.height))
    palette = sample.quantize(128, method=Image.Quantize.FASTOCTREE)
    flat = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in small]
    shown_ms = [FRAME_MS] * (len(flat) - 1) + [LAST_MS]
    flat[0].save(HERE / "session.gif", save_all=True, append_images=flat[1:], duration=shown_ms, loop=0, optimize=True)


def main() -> None:
    """Draw it."""
    chromium = os.environ.get("MARKERSEEK_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("no Chromium: apt-get install chromium, or name one in MARKERSEEK_CHROMIUM")
    with tempfile.TemporaryDirectory() as folder, served(folder) as link, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1400, "height": 1180})
        # A busy computer is slow, not broken.
        tab.set_default_timeout(600_000)
        move(register(tab, link))
        browser.close()


if __name__ == "__main__":
    main()
