"""The live page under load: memory, processor time, delay of an update, and what the search notices of its viewers.

Run it from the environment of the tests: ``python -m benchmarks.page --minutes 10``. It needs Chromium.
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from datetime import datetime
from pathlib import Path
from urllib.parse import urlsplit

from tests.page.page_browser import CHROMIUM, Served, Watched, browsing, open_tab, served

from benchmarks.loop_times import PACE, described, own_times_s
from markerseek.bridges.page.state import RunState
from markerseek.records.journal import read_journal

WATCH_LOG = """() => {
    const log = document.querySelector('.ms-log');
    window.seenLines = [];
    window.logWatcher?.disconnect();
    window.logWatcher = new MutationObserver(
        () => window.seenLines.push(...log.innerText.split('\\n').slice(0, 3).map(each => [Date.now() / 1000, each])));
    window.logWatcher.observe(log, {childList: true, characterData: true, subtree: true}); }"""


def resident_mb(process: int) -> float:
    """Resident memory of a process in MB."""
    line = next(each for each in Path(f"/proc/{process}/status").read_text().splitlines() if each.startswith("VmRSS"))
    return int(line.split()[1]) / 1e3


def processor_s(process: int) -> float:
    """Processor time of a process so far, in seconds."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def heap_mb(watched: Watched) -> float:
    """Memory of a tab's JavaScript in MB, after its garbage is collected."""
    session = watched.tab.context.new_cdp_session(watched.tab)
    session.send("HeapProfiler.collectGarbage")
    used = session.send("Runtime.getHeapUsage")["usedSize"] / 1e6
    session.detach()
    return float(used)


def search(watched: Watched, seed: int) -> None:
    """One search with that seed, from its start to its end."""
    watched.tab.get_by_label("seed").fill(str(seed))
    watched.tab.wait_for_timeout(700)
    watched.search()


def delays_s(page: Served, lines: list[tuple[float, str]]) -> list[float]:
    """From the commit of each acquisition to its line on the page, in seconds."""
    written: dict[str, float] = {}
    for journal in page.journals():
        held = read_journal(journal, frames=False)
        state = RunState(held.configuration, believes=False)
        for entry in held.entries:
            snapshot = state.add(entry.event, clock_s=entry.clock_s)
            if snapshot.phase == "measured":
                text = f"{snapshot.elapsed_s:7.1f} s  {snapshot.line}".strip()
                written[text] = datetime.fromisoformat(entry.written).timestamp()
    first: dict[str, float] = {}
    for at_s, text in lines:
        first.setdefault(text.strip(), at_s)
    return [at_s - written[text] for text, at_s in first.items() if text in written]


def endurance(minutes: float) -> None:
    """Searches one after another with three viewers."""
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as page, browsing() as browser:
        viewers = [open_tab(browser, page, "/", f"&pace={PACE}") for _ in range(3)]
        began_s, used_s, seed, reports = time.monotonic(), processor_s(page.process.pid), 0, []
        lines: list[tuple[float, str]] = []
        while (spent_s := time.monotonic() - began_s) < 60 * minutes or seed < 3:
            seed += 1
            viewers[1].tab.evaluate(WATCH_LOG)
            search(viewers[0], seed)
            # None where the tab lost its connection and loaded the page again.
            lines += viewers[1].tab.evaluate("window.seenLines") or []
            if spent_s >= 30 * len(reports):
                reports.append((spent_s, resident_mb(page.process.pid), heap_mb(viewers[1])))
                print("{:6.0f} s: page {:.0f} MB, tab {:.1f} MB".format(*reports[-1]), flush=True)
        share = (processor_s(page.process.pid) - used_s) / (time.monotonic() - began_s)
        print(f"{seed} searches, page {share:.1%} of a core")
        print("from the commit of an acquisition to the page:", described(delays_s(page, lines)))
        print("problems in the tabs:", [each.problems for each in viewers])


def chromium_processes() -> set[int]:
    """Process numbers of every Chromium."""
    return {
        int(each.name)
        for each in Path("/proc").iterdir()
        if each.name.isdigit() and b"chromium" in (each / "cmdline").read_bytes()
    }


class Flood:
    """Requests without a token, from several threads, as fast as they are refused."""

    def __init__(self, address: str, *, threads: int = 4) -> None:
        place = urlsplit(address)
        self._place = (place.hostname, place.port)
        self._over = threading.Event()
        self.refused = 0
        self._threads = [threading.Thread(target=self._ask, daemon=True) for _ in range(threads)]
        for each in self._threads:
            each.start()

    def _ask(self) -> None:
        while not self._over.is_set():
            with socket.create_connection(self._place, timeout=30) as connection:
                connection.sendall(b"GET / HTTP/1.1\r\nHost: evil.example\r\nConnection: close\r\n\r\n")
                self.refused += b"403" in connection.recv(64)

    def end(self) -> int:
        """How many were refused."""
        self._over.set()
        for each in self._threads:
            each.join()
        return self.refused


def unnoticed(searches: int) -> None:
    """The loop's own time of paced searches with no page, one viewer, and three, one of which has stopped."""
    common = ["--pace", str(PACE), "--method", "exhaustive", "--acquisitions", "60"]
    with tempfile.TemporaryDirectory() as folder:
        alone: list[float] = []
        for seed in range(1, searches + 1):
            journal = Path(folder) / f"{seed}.journal"
            command = [sys.executable, "-P", "-m", "markerseek", "search", "--seed", str(seed), *common]
            subprocess.run([*command, "--journal", str(journal)], check=False, capture_output=True)
            alone += own_times_s(journal)
        print("no page:", described(alone), flush=True)
    query = f"&pace={PACE}&method=exhaustive&acquisitions=60"
    for viewers, flooded in ((1, False), (3, False), (1, True)):
        with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as page, browsing() as browser:
            tabs = [open_tab(browser, page, "/", query) for _ in range(min(viewers, 2))]
            stopped: set[int] = set()
            before = chromium_processes()
            if viewers == 3:
                other = browser.browser_type.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
                open_tab(other, page, "/", query)
                stopped = chromium_processes() - before
                for each in stopped:
                    os.kill(each, signal.SIGSTOP)
            flood = Flood(page.address) if flooded else None
            for seed in range(1, searches + 1):
                search(tabs[0], seed)
            refused = 0 if flood is None else flood.end()
            for each in stopped:
                os.kill(each, signal.SIGCONT)
            steps = [step for journal in page.journals() for step in own_times_s(journal)]
            name = f"{viewers} viewers" + (", one of them stopped" if stopped else "")
            print(f"{name}{f', {refused} requests refused' if flooded else ''}:", described(steps), flush=True)


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--searches", type=int, default=3)
    given = parser.parse_args()
    if given.searches:
        unnoticed(given.searches)
    if given.minutes:
        endurance(given.minutes)


if __name__ == "__main__":
    main()
