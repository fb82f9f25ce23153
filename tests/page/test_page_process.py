"""The page as a process: what it refuses at its start, and what happens to a search when the page or its viewers go."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from markerseek.bridges.page import Address
from markerseek.bridges.page.children import ChildSearch
from markerseek.core import ConfigError
from markerseek.records.journal import Interrupted, read_journal
from tests.emulated import ran
from tests.page.page_browser import WAIT_MS, certified, needs_browser, open_tab, served, sync_api

pytestmark = pytest.mark.real_time


ENDS_S = 10
"""Time within which a page ends on a busy computer, in seconds; what it must not wait for takes a minute or longer."""

STOPS_S = 9
"""Time within which a search without its page ends on a busy computer: 5 s are promised. By itself it takes longer."""


def refused(outcome, *words):
    code, _, errors = outcome
    assert code == 2, errors
    assert all(word in errors.replace("\n", " ") for word in words), errors


def test_taken_port(shell):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        refused(shell("page", "--port", port), f"127.0.0.1:{port}", "already in use", "--port")


def test_rig_file_with_a_misspelt_key(shell, tmp_path):
    rig = tmp_path / "rig.toml"
    rig.write_text('kind = "simulated"\ntisue = "liver"\n')
    refused(shell("page", "--rig", rig), "tisue", "tissue")


def test_missing_extra(shell, monkeypatch):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    refused(shell("page"), "nicegui", "pip install '.[page]'")


def test_no_browser():
    # A process of its own: Python looks for browsers once.
    nowhere = os.environ | {"PATH": "/nowhere", "DISPLAY": "", "BROWSER": ""}
    done = ran("page", "--open", timeout=120, env=nowhere, stdin=subprocess.DEVNULL)
    refused((done.returncode, done.stdout, done.stderr), "no browser")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("host", "said"),
    [
        *((host, "name the one address") for host in ("0", "0x0", "00.0", "")),
        *((host, "name the one address") for host in ("::", "[::]", "0::0", "::ffff:0.0.0.0", "::ffff:0:0")),
        *((host, "name an address") for host in ("a" * 64, "::g", "[::1", "1::2::3")),
    ],
)
def test_all_addresses_and_unknown_ones_are_refused_however_they_are_spelt(tmp_path, host, said):
    _, certificate, _, key = certified(tmp_path)
    with pytest.raises(ConfigError, match=said):
        Address(host=host, certificate=Path(certificate), key=Path(key))


def test_other_address_needs_a_certificate(shell):
    refused(shell("page", "--host", "192.168.1.5"), "needs TLS", "--tls-certificate")
    refused(shell("page", "--host", "192.168.1.5", "--tls-certificate", "a.pem"), "both")
    refused(shell("page", "--host", "0.0.0.0"), "name the one address")
    refused(shell("page", "--tls-certificate", "a.pem", "--tls-key", "b.pem"), "no certificate")


def until(condition, page, tab, *, timeout_s=30):
    """Wait for something outside of the browser."""
    for _ in range(10 * timeout_s):
        if condition():
            return
        tab.wait_for_timeout(100)
    raise AssertionError(f"it did not happen; children {page.children()}")


@needs_browser
def test_killed_page_stops_the_search_and_it_can_be_resumed(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/search", "&seed=4&pace=0.1")
        watched.start()
        watched.wait_for(".ms-log", "acquisition 1:")
        (child,) = page.children()
        page.process.kill()
        until(lambda: not Path(f"/proc/{child}").exists(), page, watched.tab)
        watched.tab.context.close()
    (journal,) = page.journals()
    assert isinstance(read_journal(journal).entries[-1].event, Interrupted)
    resumed = ran("resume", journal, "--arm", "--json")
    straight = ran("search", "--seed", 4, "--no-journal", "--json")
    result = json.loads(resumed.stdout)
    whole = json.loads(straight.stdout)
    assert result["samples"][:1] == whole["samples"][:1]
    assert abs(result["angle_deg"] - whole["angle_deg"]) < 3 * max(result["sigma_deg"], whole["sigma_deg"])


@pytest.mark.long
@needs_browser
def test_search_that_nobody_watches_is_stopped(opened, page):
    watched = opened("/search", "&seed=4&pace=1")
    watched.start()
    watched.wait_for(".ms-badge", "^SEARCHING$")
    other = opened("/search")
    watched.tab.goto("about:blank")
    # The other tab still watches.
    other.tab.wait_for_timeout(1000 * (ChildSearch.unwatched_s + 2))
    assert len(page.children()) == 1
    other.tab.goto("about:blank")
    until(lambda: not page.children(), page, other.tab)
    assert read_journal(page.journals()[-1]).entries[-1].event == Interrupted(reason="another program (SIGTERM)")
    again = opened("/search")
    again.wait_for(".ms-answer", "^nobody had the page open for 5 s; the laser is disarmed")


@pytest.mark.long
@needs_browser
def test_ctrl_c_in_the_terminal_ends_page_and_search(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/search", "&pace=1")
        watched.start()
        watched.wait_for(".ms-log", "dark frame 1")
        (child,) = page.children()
        page.process.send_signal(signal.SIGINT)
        page.process.wait(ENDS_S)
        assert not Path(f"/proc/{child}").exists()
        # The page says that it has no news, and commands are off.
        watched.tab.wait_for_selector(".ms-silent:visible")
        watched.tab.context.close()
    assert isinstance(read_journal(page.journals()[-1]).entries[-1].event, Interrupted)


LINE = ".ms-silent"
"""The red line at the top of the page."""


@pytest.mark.long
@needs_browser
def test_26_7_hung_page_says_that_stop_was_not_delivered_and_its_search_ends_within_5_s(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/search", "&pace=1")
        watched.start()
        watched.wait_for(".ms-log", "dark frame 1")
        (child,) = page.children()
        ended = os.pidfd_open(child)
        page.process.send_signal(signal.SIGSTOP)
        hung_s = time.monotonic()
        try:
            watched.tab.locator(".ms-stop").click()
            # One second for the answer, the others for a computer that is busy.
            watched.wait_for(LINE, "STOP was not delivered \\(no answer within 1 s\\)", timeout_ms=5000)
            assert select.select([ended], [], [], hung_s + STOPS_S - time.monotonic())[0]
        finally:
            os.close(ended)
            page.process.send_signal(signal.SIGCONT)
        # It comes back, says how the search ended, and STOP is heard again.
        watched.wait_for(".ms-badge", "^STOPPED$")
        watched.tab.keyboard.press("Escape")
        sync_api.expect(watched.tab.locator(LINE)).to_be_hidden(timeout=WAIT_MS)
        watched.tab.context.close()
    assert isinstance(read_journal(page.journals()[-1]).entries[-1].event, Interrupted)
