"""A page that is served by the ordinary command, and a headless browser that opens it."""

from __future__ import annotations

import os
import re
import select
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from decimal import Context, Decimal
from pathlib import Path

import pytest

sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
pytest.importorskip("nicegui", reason="NiceGUI is not installed")

CHROMIUM = os.environ.get("MARKERSEEK_CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
WAIT_MS = 60_000
"""Longest wait for anything: a busy machine is no fault."""

LOST_MS = 20_000
"""After that a press had no effect: the page had gone stale, because the machine was busy."""

START = "from markerseek.cli import main; main()"
"""The program, as it is started."""

COLOURS = """canvas => { const c = canvas.getContext('2d');
    const d = c.getImageData(0, 0, canvas.width, canvas.height).data; const seen = new Set();
    for (let i = 0; i < d.length; i += 4) seen.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]);
    return seen.size; }"""
"""How many different colours a canvas has, as a function of the browser."""

AA = {"runOnly": ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"], "resultTypes": ["violations"]}
"""Rules of WCAG 2.2 AA."""

needs_browser = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: apt-get install chromium")


def angle_of(result: dict) -> str:
    """Pattern of the angle and its standard deviation on the page, from the result of the command."""
    sigma = Decimal(result["sigma_deg"]).normalize(Context(prec=2))
    # Two significant digits also where the second is a zero.
    places = 1 - sigma.adjusted()
    angle = f"{result['angle_deg']:.{places}f}".replace("-", "−")
    return rf"{re.escape(angle)}°\s*± {re.escape(f'{sigma:.{places}f}')}°$"


@dataclass
class Served:
    """A page that is served."""

    process: subprocess.Popen
    link: str
    data: Path

    @property
    def address(self) -> str:
        return self.link.split("/?")[0]

    @property
    def token(self) -> str:
        return self.link.split("token=")[1]

    def children(self) -> list[int]:
        """Process numbers of its children."""
        listed = Path(f"/proc/{self.process.pid}/task").glob("*/children")
        return [int(number) for file in listed for number in file.read_text().split()]

    def journals(self) -> list[Path]:
        return sorted((self.data / "markerseek" / "journals").glob("*.journal"))

    def wait_for_text(self, text: str) -> None:
        """Wait until its process has written a text to its standard error."""
        said = self.data / "page.stderr"
        for _ in range(600):
            if text in said.read_text():
                return
            select.select([], [], [], 0.1)
        raise AssertionError(f"{text!r} was not said: {said.read_text()}")


@contextmanager
def served(
    folder: Path,
    *arguments: str,
    stdin: int = subprocess.DEVNULL,
    start: str = START,
) -> Iterator[Served]:
    """A page on a free port, with a data folder of its own; ended as by Ctrl-C."""
    errors = (folder / "page.stderr").open("w")
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", start, "page", "--port", "0", *arguments],
        stdin=stdin,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
        env=os.environ | {"XDG_DATA_HOME": str(folder), "PYTHONUNBUFFERED": "1", "PYTHONFAULTHANDLER": "1"},
    )
    try:
        first = process.stdout.readline()
        found = re.search(r"open (\S+)", first)
        assert found, first + (folder / "page.stderr").read_text()
        yield Served(process=process, link=found[1], data=folder)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(20)
        except subprocess.TimeoutExpired as hung:
            # Where each thread is goes to its standard error.
            process.send_signal(signal.SIGABRT)
            process.wait(20)
            raise AssertionError((folder / "page.stderr").read_text()) from hung
        finally:
            process.kill()
            process.wait()
            process.stdout.close()
            errors.close()


def certified(folder: Path) -> tuple[str, ...]:
    """Options with a new certificate."""
    certificate = folder / "page.pem"
    key = folder / "page.key"
    made = subprocess.run(
        [
            *("openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=page"),
            *("-keyout", str(key), "-out", str(certificate)),
        ],
        check=False,
        capture_output=True,
    )
    if made.returncode:
        pytest.skip("no openssl to make a certificate")
    return ("--tls-certificate", str(certificate), "--tls-key", str(key))


@dataclass
class Watched:
    """A tab, and everything that went wrong in it."""

    tab: sync_api.Page
    problems: list[str] = field(default_factory=list)

    def text(self, css: str) -> str:
        return self.tab.locator(css).inner_text()

    def wait_for(self, css: str, pattern: str, timeout_ms: float = WAIT_MS) -> None:
        sync_api.expect(self.tab.locator(css)).to_have_text(re.compile(pattern), timeout=timeout_ms)

    def wait_for_colours(self, css: str, *, more_than: int) -> None:
        """Wait until a canvas has more different colours: an empty one has few, without any error."""
        script = f"([css, least]) => ({COLOURS})(document.querySelector(css)) > least"
        self.tab.wait_for_function(script, arg=[css, more_than])

    def search(self, name: str = "Start") -> None:
        """Start a search and wait until it is over."""
        start = self.tab.get_by_role("button", name=name, exact=True)
        self.start(name)
        sync_api.expect(start).to_be_enabled(timeout=WAIT_MS)

    def start(self, name: str = "Start") -> None:
        """Start a search; a busy machine may let a page go stale, which then has to be asked again."""
        start = self.tab.get_by_role("button", name=name, exact=True)
        for _ in range(5):
            sync_api.expect(start).to_be_enabled(timeout=WAIT_MS)
            start.click(timeout=WAIT_MS)
            try:
                sync_api.expect(start).to_be_disabled(timeout=LOST_MS)
            except AssertionError:
                continue
            return
        raise AssertionError(f"{name} was pressed five times without effect")

    def unfold(self) -> None:
        """Show the settings that are folded."""
        self.tab.locator(".ms-settings").evaluate_all("all => all.forEach(each => each.open = true)")

    def press(self, name: str) -> None:
        self.tab.get_by_role("button", name=name, exact=True).click(timeout=WAIT_MS)


@contextmanager
def browsing() -> Iterator[sync_api.Browser]:
    """A headless Chromium."""
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield browser
        browser.close()


def open_tab(browser: sync_api.Browser, page: Served, path: str = "/search", query: str = "", **options) -> Watched:
    """A tab with the page, whose requests and messages are watched."""
    options.setdefault("viewport", {"width": 1280, "height": 800})
    tab = browser.new_context(**options).new_page()
    tab.set_default_timeout(WAIT_MS)
    watched = Watched(tab)

    own = (page.address + "/", page.address.replace("http", "ws", 1) + "/", "data:", "blob:")

    def note_request(request) -> None:
        if not request.url.startswith(own):
            watched.problems.append(f"external request: {request.url}")

    tab.on("request", note_request)
    tab.on("websocket", note_request)
    tab.on("pageerror", lambda error: watched.problems.append(f"page error: {error}"))

    def note_line(line) -> None:
        if line.type == "error":
            watched.problems.append(f"console: {line.text}")

    tab.on("console", note_line)
    tab.goto(f"{page.address}{path}?token={page.token}{query}")
    # The first beat: the page is connected.
    tab.wait_for_function("window.markerseekBeat > 0")
    return watched


SETTLED = """(scheme) => document.body.classList.contains(`body--${scheme}`)
    && !document.body.classList.contains("ms-stale")
    && !document.getAnimations().some(
        (each) => each.playState === "running" && isFinite(each.effect.getTiming().iterations)
    )"""
"""That a page has news, and the colours of its theme: they turn within 0.3 s, and a page without news is dim."""


def violations(watched: Watched, scheme: str | None = None) -> list[tuple[str, list[str]]]:
    """What axe-core finds on a page that has settled: rule, and the elements.

    `scheme`: ``"dark"`` or ``"light"``, which is set before; without it the theme stays.
    """
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    if scheme is None:
        scheme = watched.tab.evaluate("matchMedia('(prefers-color-scheme: dark)').matches ? 'dark' : 'light'")
    watched.tab.emulate_media(color_scheme=scheme)
    for _ in range(5):
        watched.tab.wait_for_function(SETTLED, arg=scheme)
        found = axe.Axe().run(watched.tab, options=AA).response["violations"]
        # On a busy machine a page can be without news for a moment just then.
        if watched.tab.evaluate(SETTLED, scheme):
            break
    return [(each["id"], [node["html"] for node in each["nodes"]]) for each in found]


def require_legible(watched: Watched, *widths: int) -> None:
    """In both themes axe-core finds nothing, and at none of these widths in pixels the page scrolls sideways."""
    for scheme in ("dark", "light"):
        found = violations(watched, scheme)
        assert found == [], f"{scheme}: {found}"
    for width in widths:
        watched.tab.set_viewport_size({"width": width, "height": 900})
        watched.tab.wait_for_timeout(300)
        assert watched.tab.evaluate("document.documentElement.scrollWidth") <= width
