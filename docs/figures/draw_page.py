"""Draws docs/figures/registration-page.png: the live page of a session.

Run by ``make figures``; it needs Chromium and the packages of the tests.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
SESSION_SEED = 2
"""A session in which more than four markers are needed."""


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


def register(tab: Page, link: str) -> None:
    """A screenshot of a session on the simulated rig, once it asks for the fourth marker."""
    tab.goto(f"{link}&seed={SESSION_SEED}")
    tab.wait_for_function("window.markerseekBeat > 0")
    tab.get_by_role("button", name="Start", exact=True).click()
    asks = "document.querySelectorAll('.ms-table tbody tr').length > 2 && document.querySelector('.ms-mark-place')"
    tab.wait_for_function(asks, timeout=600_000)
    # An image is loaded after the marks over it.
    tab.wait_for_timeout(300)
    tab.screenshot(path=HERE / "registration-page.png")
    tab.locator(".ms-stop").click()
    tab.wait_for_selector("text=STOPPED")


def main() -> None:
    """Draw it."""
    chromium = os.environ.get("MARKERSEEK_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        sys.exit("no Chromium: apt-get install chromium, or name one in MARKERSEEK_CHROMIUM")
    with tempfile.TemporaryDirectory() as folder, served(folder) as link, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        tab = browser.new_page(viewport={"width": 1400, "height": 900})
        # A busy computer is slow, not broken.
        tab.set_default_timeout(120_000)
        register(tab, link)
        browser.close()


if __name__ == "__main__":
    main()
