"""Searches that other programs ask for, one at a time."""

from __future__ import annotations

import errno
import os
import threading
from dataclasses import dataclass
from pathlib import Path

from markerseek.bridges.asked import AskedSearch
from markerseek.bridges.child import ChildRun
from markerseek.core import RecordError, SearchError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import default_journal, make_folder
from markerseek.rigs import read_rig_file


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
        """Journal of a new search, in the data folder; None where that takes none, and the rig is simulated.

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
    """The searches of one bridge, one at a time."""

    def __init__(self, options: SearchOptions) -> None:
        self._options = options
        self._lock = threading.Lock()
        self._running: ChildRun | None = None

    def start(self, asked: AskedSearch, *, asked_by: str | None = None) -> ChildRun:
        """Start a search.

        ``asked_by``: who asked, for the person who arms the rig; None for the user of the bridge's terminal. Raises
        `SearchError` if one is running.
        """
        # Two requests can come at once, from two threads of a bridge.
        with self._lock:
            if self._running is not None and self._running.running:
                raise SearchError("a search is running; cancel it, or wait for its result")
            arguments = ["search", *asked.arguments(), *self._options.arguments()]
            journal = self._options.new_journal(method=asked.plan.method)
            arguments.append("--no-journal" if journal is None else f"--journal={journal}")
            if asked_by is not None:
                arguments.append(f"--asked-by={asked_by}")
            self._running = ChildRun(arguments, journal=journal)
            return self._running

    def cancel(self) -> bool:
        """Stop the search that is running; returns at once, False if there is none."""
        with self._lock:
            if self._running is None or not self._running.running:
                return False
            self._running.stop()
            return True
