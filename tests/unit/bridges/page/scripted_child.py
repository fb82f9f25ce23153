"""A child whose record and end are those of a script, and the searches of a page with such children."""

from __future__ import annotations

import queue
import signal
import threading

from markerseek.bridges.outcome import Outcome
from markerseek.bridges.page.page_searches import PageRig, PageSearches
from markerseek.registration import Spot

SPOT = Spot(left_px=(600.0, 500.0), right_px=(560.0, 500.0), sigma_px=0.1)
BROWSER = "a browser at 127.0.0.1"
STOPPED = Outcome.of(130, b'{"error": "stopped by the user"}')
FOUND = Outcome.of(0, b'{"answer": "found", "angle_deg": 1.0, "reason": null}')


class ScriptedChild:
    """Sends what it is given; `stop` ends it."""

    images = None

    def __init__(self, items=(), *, endless=False, error=None):
        self.sent = queue.SimpleQueue()
        for item in items:
            self.sent.put(item)
        if not endless:
            self.sent.put(None)
        self.error = error
        self.stopped = threading.Event()
        self.has_written = False

    def items(self):
        while (item := self.sent.get()) is not None:
            self.has_written = True
            yield item
        if self.error is not None:
            raise self.error

    def stop(self, number=signal.SIGINT):
        self.number = number
        self.stopped.set()
        self.sent.put(None)

    kill = stop

    # Of a session: it has written nothing, and is over.
    running = False

    def wait(self):
        raise AssertionError("what is over is not waited for")

    def beating(self, items):
        return items

    def outcome(self):
        return STOPPED if self.stopped.is_set() else FOUND


def searches(children, tmp_path, monkeypatch, **rig):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    asked = []

    def launch(arguments, journal):
        asked.append(list(arguments))
        return children.pop(0)

    return PageSearches(PageRig(**rig), launch=launch), asked
