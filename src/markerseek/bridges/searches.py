"""Searches that other programs ask for: what they may choose, and one at a time."""

from __future__ import annotations

import errno
import os
import threading
from dataclasses import dataclass
from pathlib import Path

from markerseek.bridges.child import ChildRun
from markerseek.core import MAX_ACQUISITIONS, ConfigError, PolicyPlan, RecordError, SearchError, Tolerance, is_whole
from markerseek.drivers import BenchSettings
from markerseek.records.journal import default_journal, make_folder
from markerseek.rigs import read_rig_file
from markerseek.search import method_named, require_sweeping


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchRequest:
    """What a program on the network may choose of a search: never a file, a rig, or whether it is armed."""

    method: str = "posterior"
    acquisitions: int | None = None
    as_published: bool = False
    stay: bool = False
    sweep: bool = False
    """Whether the probe turns while the laser fires."""
    tolerance_mm: float | None = None
    """How well the angle of a marker that is found must be known, as in `markerseek.core.Tolerance`; None: as usual."""
    seed: int | None = None
    """Seed of a simulated rig; None for its default."""

    def __post_init__(self) -> None:
        if not isinstance(self.method, str):
            raise ConfigError(f"method is {self.method!r}, it must be the name of a method")
        method_named(self.method)
        number = self.acquisitions
        if number is not None and not (is_whole(number) and 2 <= number <= MAX_ACQUISITIONS):
            raise ConfigError(
                f"acquisitions is {number!r}, it must be a whole number from 2 to {MAX_ACQUISITIONS}; leave it out "
                "for the number of the method"
            )
        for name in ("as_published", "stay", "sweep"):
            if not isinstance(getattr(self, name), bool):
                raise ConfigError(f"{name} is {getattr(self, name)!r}, it must be true or false")
        if self.sweep:
            require_sweeping(PolicyPlan(method=self.method, as_published=self.as_published))
        if self.tolerance_mm is not None:
            Tolerance(mm=self.tolerance_mm)
        if self.seed is not None and not (is_whole(self.seed) and 0 <= self.seed < 2**63):
            raise ConfigError(f"seed is {self.seed!r}, it must be a whole number from 0 to 2**63 - 1")

    def arguments(self) -> list[str]:
        """Options of ``markerseek search``."""
        options = [f"--method={self.method}"]
        if self.acquisitions is not None:
            options.append(f"--acquisitions={self.acquisitions}")
        if self.tolerance_mm is not None:
            options.append(f"--tolerance-mm={self.tolerance_mm}")
        if self.seed is not None:
            options.append(f"--seed={self.seed}")
        forms = {"--as-published": self.as_published, "--stay": self.stay, "--sweep": self.sweep}
        return options + [name for name, wanted in forms.items() if wanted]


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

    def start(self, request: SearchRequest, *, asked_by: str | None = None) -> ChildRun:
        """Start a search.

        ``asked_by``: who asked, for the person who arms the rig; None for the user of the bridge's terminal. Raises
        `SearchError` if one is running.
        """
        # Two requests can come at once, from two threads of a bridge.
        with self._lock:
            if self._running is not None and self._running.running:
                raise SearchError("a search is running; cancel it, or wait for its result")
            arguments = ["search", *request.arguments(), *self._options.arguments()]
            journal = self._options.new_journal(method=request.method)
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
