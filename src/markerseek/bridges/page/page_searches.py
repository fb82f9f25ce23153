"""What all viewers of the page share: the search and the registration, and what may be started now."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from markerseek.bridges.asked import AnyAsked, AskedSearch
from markerseek.bridges.child import ChildRun
from markerseek.bridges.page.children import ChildRegistration, ChildSearch
from markerseek.core import Interval, SearchError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import default_journal, make_folder
from markerseek.registration import default_folder
from markerseek.sim import SimulatedSettings

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

    def command(self, asked: AnyAsked) -> list[str]:
        """The command that this becomes on the rig."""
        rig = [] if self.file is None else ["--rig", str(self.file)]
        options = asked.arguments(simulated=self.simulated)
        if isinstance(asked, AskedSearch):
            return ["search", *rig, *options]
        if self.images is not None:
            rig += [*(text for path in self.cameras for text in ("--cameras", str(path))), "--images", self.images]
        return ["register", *rig, *options]


class PageSearches:
    """The search and the registration of one page; only one runs at a time. ``launch``: starts a command."""

    def __init__(self, rig: PageRig, *, launch: Callable[..., ChildRun] = ChildRun) -> None:
        self.rig = rig
        self.registration: ChildRegistration | None = None
        self.search: ChildSearch | None = None
        self._launch = launch
        # Held while something starts, so that STOP waits for what it would otherwise miss.
        self._lock = threading.Lock()

    @property
    def _running(self) -> list[ChildSearch]:
        return [each for each in (self.registration, self.search) if each is not None and each.outcome is None]

    @property
    def busy(self) -> bool:
        """Whether anything runs."""
        return bool(self._running)

    def start(self, asked: AnyAsked, *, asked_by: str) -> None:
        """Start a search or a session; a rig of devices asks in the terminal, with the name of who asked for a search.

        Raises `SearchError` if anything runs, or the rig cannot register. Raises `OSError` if the folder of journals
        cannot be made.
        """
        with self._idle():
            if isinstance(asked, AskedSearch):
                journal = default_journal(method=asked.plan.method)
                make_folder(journal.parent)
                # Armed at once: nothing here emits light.
                goes_on = ["resume", str(journal), "--arm"] if self.rig.simulated else []
                command = [*self.rig.command(asked), "--journal", str(journal), f"--asked-by={asked_by}"]
                self._begin(ChildSearch, command, asked, journal, goes_on)
            elif not self.rig.registers:
                raise SearchError("this rig cannot register: start the page with --cameras and --images")
            else:
                command, folder = self.rig.command(asked), default_folder()
                goes_on = [*command, "--continue", str(folder)]
                self._begin(ChildRegistration, [*command, "--record", str(folder)], asked, folder, goes_on)

    def go_on(self, before: ChildSearch | None) -> None:
        """Continue what was broken off; raises as `start`."""
        with self._idle():
            if before is None or not before.can_go_on:
                raise SearchError("there is nothing to go on with here; press Start, or resume it in the terminal")
            self._begin(type(before), before.goes_on, before.asked, before.journal, before.goes_on)

    def stop(self) -> None:
        """Stop what runs; allowed at any time, by any thread."""
        with self._lock:
            for each in self._running:
                each.stop()

    def close(self) -> None:
        """Stop what runs and wait for its end; what has not ended after `END_S` or `DEVICES_END_S` is killed."""
        self.stop()
        ends_s = time.monotonic() + (END_S if self.rig.simulated else DEVICES_END_S)
        for each in self._running:
            each.end(max(0.0, ends_s - time.monotonic()))

    @contextmanager
    def _idle(self) -> Iterator[None]:
        """One start at a time, and none while anything runs."""
        with self._lock:
            if self.busy:
                raise SearchError("a search or a registration runs; stop it, or wait for its end")
            yield

    def _begin(
        self, kind: type[ChildSearch], command: Sequence[str], asked: AnyAsked, journal: Path, goes_on: Sequence[str]
    ) -> None:
        child = kind(
            self._launch(command, journal=journal),
            asked=asked,
            journal=journal,
            goes_on=goes_on,
            simulated=self.rig.simulated,
        )
        if isinstance(child, ChildRegistration):
            self.registration = child
        else:
            self.search = child
