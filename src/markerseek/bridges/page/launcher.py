"""Starts searches at the priority of the terminal, while the page itself runs at a lower one."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

from markerseek.bridges.child import ChildRun

NICENESS = 10
"""Niceness of the page, so that it never takes processor time from a search."""


class Launcher:
    """Starts children at the priority of the terminal, whatever that of the page is.

    On Linux priority belongs to a thread, and a child inherits that of the thread which starts it. The one thread here
    keeps that of the terminal.
    """

    def __init__(self) -> None:
        self._starter = ThreadPoolExecutor(max_workers=1, thread_name_prefix="launcher")
        # The thread is made now, not at the first child.
        self._thread_id = self._starter.submit(threading.get_native_id).result()

    def __call__(self, arguments: Sequence[str], journal: Path | None) -> ChildRun:
        """Start a command; arguments as of `ChildRun`."""
        return self._starter.submit(ChildRun, arguments, journal=journal).result()

    def lower_others(self) -> None:
        """Lower the priority of all other threads of this process, and so of those that they make."""
        threads = [int(each.name) for each in Path("/proc/self/task").iterdir()]
        # NumPy's libraries have begun threads of their own, which keep their priority where only this thread's changes.
        for thread in threads:
            # One that has ended since needs no priority.
            with suppress(ProcessLookupError):
                if thread != self._thread_id:
                    os.setpriority(os.PRIO_PROCESS, thread, os.getpriority(os.PRIO_PROCESS, thread) + NICENESS)
                    # What wakes up in the page never takes the processor from a search at once.
                    os.sched_setscheduler(thread, os.SCHED_BATCH, os.sched_param(0))
