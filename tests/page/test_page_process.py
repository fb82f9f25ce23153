"""The page as a process: what it refuses at its start, and what happens to a search when the page or its viewers go."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest
from page_browser import START, needs_browser, open_tab, served

from markerseek.bridges.page.server import UNWATCHED_S
from markerseek.records.journal import Interrupted, read_journal

pytestmark = pytest.mark.real_time


ENDS_S = 3
"""Time within which a page ends, in seconds."""


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
    refused(shell("page"), "nicegui", "pip install 'markerseek[page]'")


def test_no_browser():
    # A process of its own: Python looks for browsers once.
    done = subprocess.run(
        [sys.executable, "-P", "-c", START, "page", "--open"],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
        env=os.environ | {"PATH": "/nowhere", "DISPLAY": "", "BROWSER": ""},
        stdin=subprocess.DEVNULL,
    )
    refused((done.returncode, done.stdout, done.stderr), "no browser")
    assert "Traceback" not in done.stderr


def test_other_address_needs_a_certificate(shell):
    refused(shell("page", "--host", "192.168.1.5"), "needs TLS", "--tls-certificate")
    refused(shell("page", "--host", "192.168.1.5", "--tls-certificate", "a.pem"), "both")
    refused(shell("page", "--host", "0.0.0.0"), "name the one address")
    refused(shell("page", "--host", "LOCALHOST"), "small letters")
    refused(shell("page", "--tls-certificate", "a.pem", "--tls-key", "b.pem"), "no certificate")


def test_recording_that_does_not_exist(shell):
    refused(shell("page", "nothing.journal"), "nothing.journal", "no such file")


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
        watched = open_tab(browser, page, "/", "&seed=4&pace=0.1")
        watched.start()
        watched.wait_for(".ms-log", "acquisition 1:")
        (child,) = page.children()
        page.process.kill()
        until(lambda: not Path(f"/proc/{child}").exists(), page, watched.tab)
        watched.tab.context.close()
    (journal,) = page.journals()
    assert isinstance(read_journal(journal).entries[-1].event, Interrupted)
    resumed = subprocess.run(
        [sys.executable, "-P", "-m", "markerseek", "resume", str(journal), "--arm", "--json"],
        capture_output=True,
        check=False,
    )
    straight = subprocess.run(
        [sys.executable, "-P", "-m", "markerseek", "search", "--seed", "4", "--no-journal", "--json"],
        capture_output=True,
        check=False,
    )
    assert json.loads(resumed.stdout) == json.loads(straight.stdout)


@needs_browser
def test_search_that_nobody_watches_is_stopped(opened, page):
    watched = opened("/", "&seed=4&pace=1")
    watched.start()
    watched.wait_for(".ms-status", "^(moving|measured)$")
    other = opened("/")
    watched.tab.goto("about:blank")
    # The other tab still watches.
    other.tab.wait_for_timeout(1000 * (UNWATCHED_S + 2))
    assert len(page.children()) == 1
    other.tab.goto("about:blank")
    until(lambda: not page.children(), page, other.tab)
    assert isinstance(read_journal(page.journals()[-1]).entries[-1].event, Interrupted)


@needs_browser
def test_ctrl_c_in_the_terminal_ends_page_and_search(browser, tmp_path):
    with served(tmp_path) as page:
        watched = open_tab(browser, page, "/", "&pace=1")
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


def test_page_ends_though_one_of_its_threads_works(tmp_path):
    work = "import time; from markerseek.bridges.page import watched; watched.warm_up = lambda: time.sleep(60)"
    with served(tmp_path, start=f"{work}; {START}") as page:
        # It answers: its threads have begun.
        urllib.request.build_opener(urllib.request.HTTPCookieProcessor()).open(page.link).close()
        page.process.send_signal(signal.SIGINT)
        assert page.process.wait(ENDS_S) == 0


@needs_browser
def test_search_runs_at_the_priority_of_the_terminal(opened, page):
    watched = opened("/", "&pace=1")
    watched.start()
    # The log may still be that of the test before.
    watched.wait_for(".ms-status", "^(moving|measured)$")
    (child,) = page.children()
    own = os.getpriority(os.PRIO_PROCESS, os.getpid())
    assert os.getpriority(os.PRIO_PROCESS, child) == own
    threads = [int(each.name) for each in Path(f"/proc/{page.process.pid}/task").iterdir()]
    # One of them starts the searches; none of the others may have the priority of a search.
    priorities = [(os.getpriority(os.PRIO_PROCESS, each), os.sched_getscheduler(each)) for each in threads]
    lowered = (min(19, own + 10), os.SCHED_BATCH)
    assert sorted(priorities) == [(own, os.SCHED_OTHER), *[lowered] * (len(threads) - 1)]
    watched.tab.locator(".ms-stop").click()
    watched.wait_for(".ms-status", "^stopped by SIG")
