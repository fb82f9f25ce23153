"""What all viewers of the page share: the search and the registration, and what may be done now."""

from __future__ import annotations

import asyncio
import threading
import time
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from markerseek.bridges.asked import AskedRegistration, AskedSearch
from markerseek.bridges.child import ChildRun
from markerseek.bridges.page.child_registration import ChildRegistration
from markerseek.bridges.page.child_search import ChildSearch, Launch
from markerseek.core import Interval, SearchError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import default_journal, make_folder
from markerseek.registration import default_folder
from markerseek.sim import SimulatedSettings


class ChangeSignal:
    """One event of asyncio for each viewer, all set together."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        # Weak: a viewer who is gone waits no more.
        self._viewers: weakref.WeakSet[asyncio.Event] = weakref.WeakSet()

    def subscribe(self) -> asyncio.Event:
        """The event of a new viewer, who clears it himself; only in the event loop of the server."""
        self._loop = asyncio.get_running_loop()
        event = asyncio.Event()
        self._viewers.add(event)
        return event

    def tell(self) -> None:
        """Wake all viewers; by any thread, at any time."""
        if self._loop is not None:
            # A loop that is closed has no viewers.
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for each in self._viewers:
            each.set()


END_S, DEVICES_END_S = 2.5, 10.0
"""Time for a search to end with the page, in seconds, on a simulated rig and on one of devices, which must stop too."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageRig:
    """Rig that the page was started for."""

    file: Path | None = None
    """None for the simulated rig with its defaults."""
    settings: SimulatedSettings | BenchSettings = field(default_factory=SimulatedSettings)
    cameras: tuple[Path, ...] = ()
    """Calibration of the endoscope beside a rig of devices; a simulated rig has a simulated endoscope."""
    images: str | None = None
    """Where the images of that endoscope come from, as `markerseek register` takes them."""

    @property
    def search(self) -> Interval:
        """Range of its searches."""
        return self.settings.limits.search

    @property
    def simulated(self) -> bool:
        """Whether no hardware is involved."""
        return isinstance(self.settings, SimulatedSettings)

    @property
    def registers(self) -> bool:
        """Whether the rig can register: the distance of the array from the axis, and the endoscope, are known."""
        return self.simulated or (self.settings.probe.face_radius_m is not None and self.images is not None)

    def arguments(self, *, cameras: bool = False) -> list[str]:
        """Options that name the rig, and its endoscope if ``cameras``."""
        options = [] if self.file is None else ["--rig", str(self.file)]
        if cameras and self.images is not None:
            options += [*(text for path in self.cameras for text in ("--cameras", str(path))), "--images", self.images]
        return options


class PageSearches:
    """The searches of one page."""

    def __init__(self, rig: PageRig, *, launch: Launch = ChildRun) -> None:
        self.rig = rig
        self.changes = ChangeSignal()
        self.registration: ChildRegistration | None = None
        self.search: ChildSearch[AskedSearch] | None = None
        self._launch = launch
        # Held while something starts, so that STOP waits for what it would otherwise miss.
        self._lock = threading.Lock()
        self._closed = False

    @property
    def searching(self) -> bool:
        """Whether the search runs."""
        return self.search is not None and self.search.status != "ended"

    @property
    def busy(self) -> bool:
        """Whether anything runs."""
        return any(run.status != "ended" for run in self._runs())

    def _runs(self) -> tuple[ChildSearch[Any], ...]:
        return tuple(each for each in (self.registration, self.search) if each is not None)

    def register(self, asked: AskedRegistration) -> None:
        """Start a registration session; the terminal asks whether to arm a rig of devices.

        Raises `SearchError` if anything runs, or the rig cannot register.
        """
        with self._idle():
            if not self.rig.registers:
                raise SearchError("this rig cannot register: start the page with --cameras and --images")
            arguments = ["register", *self.rig.arguments(cameras=True), *asked.arguments(simulated=self.rig.simulated)]
            self.registration = ChildRegistration(
                self._launch, arguments, asked=asked, folder=default_folder(), on_change=self.changes.tell
            )

    def go_on_registering(self) -> None:
        """Continue the session that was broken off; raises as `register`."""
        with self._idle():
            before = self.registration
            if before is None or before.journal is None or not before.can_go_on:
                raise SearchError("there is no session to go on with here; start one")
            self.registration = ChildRegistration(
                self._launch,
                before.arguments,
                asked=before.asked,
                folder=before.journal,
                continued=True,
                on_change=self.changes.tell,
            )

    def start(self, asked: AskedSearch, *, asked_by: str) -> None:
        """Start a search; the terminal names who asked when it asks whether to arm.

        Raises `SearchError` if one runs. Raises `OSError` if the folder of journals cannot be made.
        """
        journal = default_journal(method=asked.plan.method)
        make_folder(journal.parent)
        with self._idle():
            arguments = ["search", *self.rig.arguments(), *asked.arguments(simulated=self.rig.simulated)]
            arguments += ["--journal", str(journal), f"--asked-by={asked_by}"]
            self.search = self._live(arguments, asked, journal=journal)

    def go_on(self) -> None:
        """Continue the search that was stopped, on a simulated rig."""
        with self._idle():
            before = self.search
            if before is None or before.journal is None or not self.paused:
                raise SearchError("there is no search to go on with here; start one, or resume it in the terminal")
            # Armed at once: nothing here emits light.
            arguments = ["resume", str(before.journal), "--arm"]
            self.search = self._live(arguments, before.asked, journal=before.journal)

    @property
    def paused(self) -> bool:
        """Whether the last search was stopped before its end and can go on here."""
        last = self.search
        if not self.rig.simulated or last is None or last.status != "ended" or last.journal is None:
            return False
        answered = last.outcome is not None and last.outcome.answered
        run = last.run
        if answered or not last.journal.exists():
            return False
        return run is None or run.last.phase not in {"finished", "fault"}

    def stop(self) -> None:
        """Stop whatever runs; allowed at any time, by any thread."""
        with self._lock:
            for run in self._runs():
                if run.status != "ended":
                    run.stop()

    def close(self) -> None:
        """Stop whatever runs and wait for its end; what has not ended after `END_S` or `DEVICES_END_S` is killed.

        Nothing can be started afterwards.
        """
        with self._lock:
            self._closed = True
        self.stop()
        ends_s = time.monotonic() + (END_S if self.rig.simulated else DEVICES_END_S)
        for run in self._runs():
            if not run.join(max(0.0, ends_s - time.monotonic())):
                run.kill()

    @contextmanager
    def _idle(self) -> Iterator[None]:
        """One start at a time, and none while a search runs."""
        with self._lock:
            if self._closed:
                raise SearchError("the page is being closed")
            if self.busy:
                raise SearchError("a search or a registration runs; stop it, or wait for its end")
            yield

    def _live(
        self, arguments: Sequence[str], asked: AskedSearch, *, journal: Path | None = None
    ) -> ChildSearch[AskedSearch]:
        return ChildSearch(self._launch, arguments, asked=asked, journal=journal, on_change=self.changes.tell)
