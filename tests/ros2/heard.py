"""What a listener of default settings prints, for the tests that follow it."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

LISTENER = (sys.executable, "-P", str(Path(__file__).with_name("registration_listener.py")))

LONGEST_S = 90.0


class Heard:
    """What a listener of default settings prints."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=lambda: [*map(self._lines.put, process.stdout)], daemon=True).start()

    def next(self, within_s: float) -> dict[str, Any] | None:
        try:
            return json.loads(self._lines.get(timeout=within_s))
        except queue.Empty:
            return None

    def until(self, *wanted: Callable[[dict[str, Any]], bool]) -> list[dict[str, Any]]:
        """Messages until each that is wanted has come, in any order: topics are not in step with one another."""
        messages, missing, ends_s = [], set(wanted), time.monotonic() + LONGEST_S
        while missing:
            assert time.monotonic() < ends_s, messages[-5:]
            if (message := self.next(1.0)) is not None:
                messages.append(message)
                missing = {each for each in missing if not each(message)}
        return messages


def state(**known: object) -> Callable[[dict[str, Any]], bool]:
    """Whether the state of the registration says this."""
    return lambda message: message["topic"] == "state" and message.items() >= known.items()
