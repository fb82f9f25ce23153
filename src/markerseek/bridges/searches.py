"""Searches that other programs ask for, one at a time."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.child import ChildRun, FollowedChild, Outcome
from markerseek.core import RecordError, SearchError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import JournalItem, default_journal, make_folder
from markerseek.rigs import read_rig_file

_REPORTED_S = 2.0
"""Longest time in which the end of a search is reported, in seconds: without a wait for anybody."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchOptions:
    """What the person who starts a bridge chooses for all its searches."""

    rig: Path | None = None
    """None for the simulated rig with its defaults."""
    pace: float = 0.0
    """Real seconds per virtual second of a simulated rig."""

    def arguments(self) -> list[str]:
        """Options of ``markerseek search``."""
        options = [] if self.rig is None else [f"--rig={self.rig}"]
        return [*options, f"--pace={self.pace}"] if self.pace else options

    def new_journal(self, *, method: str) -> Path | None:
        """Journal of a new search, in the data folder; None if that takes none, and the rig is simulated.

        Raises `SearchError` for a rig of devices: exposure of tissue without a record must be asked for.
        """
        try:
            path = default_journal(method=method)
            try:
                make_folder(path.parent)
                if not os.access(path.parent, os.W_OK):
                    raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
            except OSError as problem:
                raise RecordError(f"{path}: no journal can be written there ({problem.strerror})") from problem
        except RecordError as problem:
            if self.rig is None or not isinstance(read_rig_file(self.rig), BenchSettings):
                return None
            raise SearchError(
                f"{problem}; end the bridge and start it with a data folder in XDG_DATA_HOME that can be written"
            ) from problem
        return path


class Searches:
    """The searches of one bridge, one at a time; each is followed by a thread of its own to its end.

    ``on_start``: called with the process id when a search has been started. ``on_item``, ``on_end``: called by the
    thread with each item of the journal, and with how the search ended.
    """

    def __init__(
        self,
        options: SearchOptions,
        *,
        on_start: Callable[[int], None],
        on_item: Callable[[JournalItem], None],
        on_end: Callable[[Outcome], None],
    ) -> None:
        self._options = options
        self._on_start, self._on_item, self._on_end = on_start, on_item, on_end
        self._lock = threading.Lock()
        self._followed: FollowedChild | None = None

    @property
    def running(self) -> bool:
        """Whether a search runs, or its end has not been reported."""
        return self._followed is not None and not self._followed.join(0)

    def start(self, asked: AskedSearch, *, asked_by: str | None = None) -> None:
        """Start a search.

        ``asked_by``: who asked, for the person who arms the rig; None for the user of the bridge's terminal. Raises
        `SearchError` if a search is running.
        """
        # Two requests can come at once, from two threads of a bridge.
        with self._lock:
            if self._followed is not None and not self._followed.child.running:
                # A client that just learned of the end may ask for the next search before the thread has ended.
                self._followed.join(_REPORTED_S)
            if self.running:
                raise SearchError("a search is running; stop it, or wait for its end")
            arguments = ["search", *asked.arguments(), *self._options.arguments()]
            journal = self._options.new_journal(method=asked.plan.method)
            arguments.append("--no-journal" if journal is None else f"--journal={journal}")
            if asked_by is not None:
                arguments.append(f"--asked-by={asked_by}")
            child = ChildRun(arguments, journal=journal)
            self._on_start(child.process_id)
            self._followed = FollowedChild(child, take=self._take, on_end=self._on_end)

    def stop(self) -> tuple[bool, str]:
        """Stop the search that runs; returns at once whether there is one, and a sentence for whoever asked."""
        with self._lock:
            if self._followed is None or not self._followed.child.running:
                return False, "no search is running"
            self._followed.child.stop()
            return True, "the search is being stopped"

    def close(self) -> None:
        """Stop the search that runs, and wait until its end has been reported."""
        self.stop()
        if self._followed is not None:
            self._followed.join()

    def _take(self, child: ChildRun) -> None:
        for item in child.items():
            self._on_item(item)
