"""The live page under load: memory, processor time, delay of an update, and what the search notices of its viewers.

Run it from the environment of the tests: ``python -m benchmarks.page --minutes 10``. Memory and the way to the screen
are measured with Chromium; what the search notices is measured with viewers without a browser, because Chromium itself
loads a computer of two cores.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from urllib.parse import urlsplit

from benchmarks.loop_times import PACE, described, own_times_s
from markerseek.core import Failed
from markerseek.records.journal import RunView, read_journal
from markerseek.show import event_line
from tests.page.page_browser import Served, Watched, browsing, open_tab, served

# The log is another element for each search, so that the whole page is watched.
WATCH_LOG = """() => {
    window.seenLines = [];
    window.logWatcher?.disconnect();
    window.logWatcher = new MutationObserver(() => window.seenLines.push(
        ...(document.querySelector('.ms-log')?.innerText ?? '').split('\\n').slice(0, 3)
            .map(each => [Date.now() / 1000, each])));
    window.logWatcher.observe(document.body, {childList: true, characterData: true, subtree: true}); }"""


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
        view = RunView.of(held.configuration)
        for entry in held.entries:
            view = view.add_entry(entry)
            if view.phase == "measured":
                text = f"{view.elapsed_s:7.1f} s  {event_line(view)}".strip()
                written[text] = datetime.fromisoformat(entry.written).timestamp()
    first: dict[str, float] = {}
    for at_s, text in lines:
        first.setdefault(text.strip(), at_s)
    return [at_s - written[text] for text, at_s in first.items() if text in written]


def endurance(minutes: float) -> None:
    """Searches one after another with three viewers."""
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as page, browsing() as browser:
        viewers = [open_tab(browser, page, "/search", f"&pace={PACE}") for _ in range(3)]
        began_s = time.monotonic()
        used_s = processor_s(page.process.pid)
        seed = 0
        reports = []
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
        print(f"load average {os.getloadavg()[0]:.1f}")
        print("from the commit of an acquisition to the page:", described(delays_s(page, lines)))
        print("problems in the tabs:", [each.problems for each in viewers])


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
                self.refused += b"400" in connection.recv(64)

    def end(self) -> int:
        """How many were refused."""
        self._over.set()
        for each in self._threads:
            each.join()
        return self.refused


SCAN = {"pace": PACE, "method": "exhaustive", "acquisitions": 60}
"""Search whose steps are timed: long, and the same at each seed."""

CONDITIONS = (("1 viewer", 1, False), ("3 viewers", 3, False), ("1 viewer and a flood", 1, True))
"""Who watches: a name, the number of viewers, and whether requests without a token come as well."""


@contextmanager
def watching(link: str, viewers: int, **query: object) -> Iterator[list[subprocess.Popen[str]]]:
    """Viewers without a browser, each a process; the first starts the search, and of three the last has stopped."""
    command = [sys.executable, "-m", "tests.page.page_viewer", link, "--query", json.dumps(query)]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(viewers - 1)]
    stopped = started[1:]
    if stopped:
        # Until it is connected.
        time.sleep(5)
    for each in stopped:
        each.send_signal(signal.SIGSTOP)
    started.insert(0, subprocess.Popen([*command, "--starts"], stdout=subprocess.PIPE, text=True))
    try:
        yield started
    finally:
        for each in started:
            each.kill()
            each.communicate()


def unnoticed(searches: int) -> None:
    """The loop's own time of paced searches without a page, with one viewer, and with three of whom one has stopped."""
    steps: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory() as folder, served(Path(folder)) as page:
        # The page has loaded its kernels.
        time.sleep(10)
        # In turns: what else the computer does changes from minute to minute.
        for seed in range(1, searches + 1):
            journal = Path(folder) / f"{seed}.journal"
            options = [text for name, value in SCAN.items() for text in (f"--{name}", str(value))]
            command = [sys.executable, "-P", "-m", "markerseek", "search", "--seed", str(seed), *options]
            subprocess.run([*command, "--journal", str(journal)], check=False, capture_output=True)
            steps.setdefault("no page", []).extend(own_times_s(journal))
            for name, viewers, flooded in CONDITIONS:
                flood = Flood(page.address) if flooded else None
                with watching(page.link, viewers, seed=seed, **SCAN) as started:
                    started[0].wait(200)
                if flood is not None:
                    print(f"{flood.end()} requests refused")
                steps.setdefault(name, []).extend(own_times_s(page.journals()[-1]))
    print(f"load average {os.getloadavg()[0]:.1f}")
    for name, values in steps.items():
        print(f"own time of the loop, {name}:", described(values), flush=True)


def leases(searches: int) -> None:
    """Searches over emulated devices with one viewer and with three of whom one has stopped: whether a lease lapses."""
    from tests.emulated import fixed_bench

    for viewers in (1, 3):
        for seed in range(1, searches + 1):
            terminal, inside = os.openpty()
            with (
                tempfile.TemporaryDirectory() as folder,
                fixed_bench(Path(folder), seed=seed) as devices,
                served(Path(folder), "--rig", str(devices.rig), stdin=inside) as page,
                watching(page.link, viewers, method="weighted-average", acquisitions=8, as_published=1) as started,
            ):
                # What is typed before the question counts for nothing.
                page.wait_for_text("name of the rig: ")
                os.write(terminal, f"{devices.rig.name}\n".encode())
                started[0].wait(200)
                last = read_journal(page.journals()[-1], frames=False).entries[-1].event
                told = last.error if isinstance(last, Failed) else "no lease has lapsed"
                print(f"{viewers} viewers, load {os.getloadavg()[0]:.1f}: {type(last).__name__}, {told}", flush=True)
            os.close(terminal)
            os.close(inside)


def main() -> None:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--searches", type=int, default=3)
    parser.add_argument("--leases", type=int, default=1)
    given = parser.parse_args()
    if given.leases:
        leases(given.leases)
    if given.searches:
        unnoticed(given.searches)
    if given.minutes:
        endurance(given.minutes)


if __name__ == "__main__":
    main()
