"""What the page starts: a search or a registration session as a child whose events become what is drawn.

All viewers share both; only one runs at a time.
"""

from __future__ import annotations

import shlex
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeAlias
from urllib.parse import parse_qsl

import msgspec
from msgspec import structs

from markerseek.bridges.child import ChildRun, EndedRun
from markerseek.bridges.page.children import ChildFollowing, ChildRegistration, ChildSearch
from markerseek.bridges.request import AnyRequest, FollowRequest, SearchRequest, SessionRequest
from markerseek.core import Interval, RecordError, SearchError
from markerseek.drivers import BenchSettings
from markerseek.files import MIB, data_folder, read_input, replace_file
from markerseek.records.journal import Configuration, default_journal, follow_journal, make_folder
from markerseek.registration import (
    MOST_MARKERS,
    KeptSession,
    default_folder,
    delete_session,
    is_running,
    kept_sessions,
    read_view,
    sessions_folder,
)
from markerseek.sim import SimulatedSettings

WITH_CAMERAS = ("page", "--rig", "RIG.toml", "--cameras", "STEREO.yaml", "--images", "LEFT RIGHT")
"""Command that serves a page whose rig of devices can register."""

Further: TypeAlias = Literal["go on", "one more marker", "check"]
"""For what a session that is kept is continued."""


class BegunSession(msgspec.Struct, frozen=True, kw_only=True):
    """The session that a page began last: what another page needs to continue it."""

    folder: str
    """Folder of its record."""
    command: list[str]
    """The command of the session, without its folder."""
    settings: str
    """What was chosen of it, as the query of a link."""


def _page_file() -> Path:
    return data_folder() / "page.json"


END_S = 2.5
DEVICES_END_S = 10.0
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

    def command(self, asked: AnyRequest) -> list[str]:
        """The command that this becomes on the rig."""
        rig = [] if self.file is None else ["--rig", str(self.file)]
        options = asked.arguments(simulated=self.simulated)
        if isinstance(asked, SearchRequest):
            return ["search", *rig, *options]
        if isinstance(asked, FollowRequest) and self.simulated:
            return ["follow", *rig, *options]
        if self.images is not None:
            rig += [*(text for path in self.cameras for text in ("--cameras", str(path))), "--images", self.images]
        if isinstance(asked, FollowRequest):
            return ["follow", *rig, *options]
        # What the simulated endoscope sees has texture, so that its motion is followed, and one can point at a place.
        return ["register", *rig, *options, *(["--textured"] if self.simulated else [])]


class PageSearches:
    """The search and the registration of one page; only one runs at a time. ``launch``: starts a command."""

    def __init__(self, rig: PageRig, *, launch: Callable[..., ChildRun] = ChildRun) -> None:
        self.rig = rig
        self.registration: ChildRegistration | None = None
        self.search: ChildSearch | None = None
        self.following: ChildFollowing | None = None
        """What follows with the registration that is shown, or did last; None: nothing has."""
        self._launch = launch
        # Held while something starts, so that STOP waits for what it would otherwise miss.
        self._lock = threading.Lock()
        self._kept: tuple[object, list[KeptSession]] = (None, [])

    @property
    def searching(self) -> list[ChildSearch]:
        """What searches or registers now."""
        return [each for each in self._running if not isinstance(each, ChildFollowing)]

    @property
    def _running(self) -> list[ChildSearch]:
        return [
            each
            for each in (self.registration, self.search, self.following)
            if each is not None and each.outcome is None
        ]

    @property
    def busy(self) -> bool:
        """Whether anything runs."""
        return bool(self._running)

    def start(self, asked: AnyRequest, *, asked_by: str) -> None:
        """Start a search or a session; a rig of devices asks in the terminal, with the name of who asked for a search.

        Raises `SearchError` if anything runs, or the rig cannot register. Raises `OSError` if the folder of journals
        cannot be made.
        """
        with self._idle():
            if isinstance(asked, SearchRequest):
                journal = default_journal(method=asked.plan.method)
                make_folder(journal.parent)
                # A simulated rig is made from the journal, and armed at once: nothing there emits light.
                of_rig = ["--arm"] if self.rig.simulated else ["--rig", str(self.rig.file)]
                goes_on = ["resume", str(journal), *of_rig]
                command = [*self.rig.command(asked), "--journal", str(journal), f"--asked-by={asked_by}"]
                self._begin(ChildSearch, command, asked, journal, goes_on)
            elif not self.rig.registers:
                raise SearchError(f"this rig cannot register: start the page by markerseek {shlex.join(WITH_CAMERAS)}")
            else:
                command = self.rig.command(asked)
                folder = default_folder()
                settings = asked.query(usual=SessionRequest())
                _keep(BegunSession(folder=str(folder), command=command, settings=settings))
                begin = [*command, "--record", str(folder), f"--asked-by={asked_by}"]
                self._begin(ChildRegistration, begin, asked, folder, _continuing(command, folder))

    def go_on(self, before: ChildSearch | None, *, asked_by: str) -> None:
        """Continue what was broken off; ``asked_by`` and errors as of `start`."""
        with self._idle():
            if before is None or not before.can_go_on:
                raise SearchError("there is nothing to go on with here; press Start, or resume it in the terminal")
            # A search that can go on here has no devices, and nobody is asked.
            asks = [f"--asked-by={asked_by}"] if isinstance(before, ChildRegistration) else []
            self._begin(type(before), [*before.goes_on, *asks], before.asked, before.journal, before.goes_on)

    def follow(self, asked: FollowRequest, *, asked_by: str) -> None:
        """Follow with the registration of the session that is shown; ``asked_by`` and errors as of `start`."""
        with self._idle():
            live = self.registration
            if live is None or not live.can_follow or str(live.journal) != asked.folder:
                raise SearchError("no registration holds by which one could follow: register first, or open a session")
            record = _new_record(live.journal)
            command = [*self.rig.command(asked), "--record", str(record), f"--asked-by={asked_by}"]
            self.following = ChildFollowing(
                self._launch(command, journal=record), asked=asked, journal=record, simulated=self.rig.simulated
            )

    def kept_sessions(self) -> list[KeptSession]:
        """Return the sessions in the user's data folder, the newest first; read again only if a record has changed."""
        place = sessions_folder()
        found = {each: each.stat().st_mtime_ns for each in place.glob("*/*.jsonl")}
        key = tuple(sorted(found.items())), self.busy
        if key != self._kept[0]:
            self._kept = key, kept_sessions(place) if place.exists() else []
        return self._kept[1]

    def show_session(self, folder: Path, *, usual: SessionRequest) -> None:
        """Show a session that is kept; arguments and errors as of `continue_session`."""
        with self._idle():
            asked = _asked_again(folder, "go on", usual)
            self.following = None
            self.registration = ChildRegistration(
                EndedRun(),
                asked=asked,
                journal=folder,
                goes_on=_continuing(self.rig.command(asked), folder),
                simulated=self.rig.simulated,
                because="the program that ran this session has ended",
            )

    def continue_session(self, folder: Path, further: Further, *, usual: SessionRequest, asked_by: str) -> None:
        """Go on with a session that is kept.

        ``further``: for what. ``usual``: settings that its record does not hold. ``asked_by`` and errors as of `start`;
        `RecordError` if its record cannot be read. The command refuses another rig.
        """
        with self._idle():
            if not self.rig.registers:
                raise SearchError(f"this rig cannot register: start the page by markerseek {shlex.join(WITH_CAMERAS)}")
            asked = _asked_again(folder, further, usual)
            command = self.rig.command(asked)
            _keep(BegunSession(folder=str(folder), command=command, settings=asked.query(usual=SessionRequest())))
            goes_on = _continuing(command, folder)
            self._begin(ChildRegistration, [*goes_on, f"--asked-by={asked_by}"], asked, folder, goes_on)

    def delete_session(self, folder: Path) -> list[str]:
        """Delete a session that is kept; returns the names of other files in its folder. Errors as of the function."""
        with self._idle():
            left = delete_session(folder)
            if self.registration is not None and self.registration.journal == folder:
                self.registration = None
                self.following = None
            return left

    def offer_interrupted(self) -> None:
        """Offer the session that a page of this rig began last, if its record says that it has not ended."""
        try:
            begun = msgspec.json.decode(read_input(_page_file(), most_bytes=MIB), type=BegunSession)
            folder = Path(begun.folder)
            view = read_view(folder)
            if view.ended is not None or view.moved or is_running(folder):
                return
        except (OSError, RecordError, msgspec.MsgspecError):
            # There was none, or nothing can be continued of it.
            return
        asked, problems = SessionRequest().with_query(dict(parse_qsl(begun.settings)))
        if problems or self.rig.command(asked) != begun.command or not self.rig.registers:
            return
        self.registration = ChildRegistration(
            EndedRun(),
            asked=asked,
            journal=folder,
            goes_on=_continuing(begun.command, folder),
            simulated=self.rig.simulated,
            because="the program that ran this session has ended",
        )

    def stop(self) -> None:
        """Stop what runs; allowed at any time, by any thread."""
        with self._lock:
            for each in self._running:
                each.stop()

    def stop_unwatched(self, unwatched_s: float) -> None:
        """Stop what must not run on after a time in which nobody has had the page open."""
        with self._lock:
            for each in self._running:
                if unwatched_s > each.unwatched_s:
                    each.stop(because=f"nobody had the page open for {each.unwatched_s:g} s")

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
        self, kind: type[ChildSearch], command: Sequence[str], asked: AnyRequest, journal: Path, goes_on: Sequence[str]
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
            self.following = None
        else:
            self.search = child


def _asked_again(folder: Path, further: Further, usual: SessionRequest) -> SessionRequest:
    """Return what continues a session: its seed, how its markers were searched, and for what."""
    view = read_view(folder)
    plan = usual.plan
    first = next((each.journal for each in view.markers if each.journal is not None), None)
    if first is not None:
        configuration = next(follow_journal(folder / first, is_over=lambda: True, wait=lambda: None))
        if isinstance(configuration, Configuration):
            plan = structs.replace(plan, sweep=configuration.plan.sweep, no_frames=not configuration.frames)
    used = 0 if view.report is None else len(view.report.points)
    if further == "one more marker":
        plan = structs.replace(plan, markers=min(max(used + 1, 3), MOST_MARKERS))
    if further == "check":
        # No marker more: the registration that is there is checked.
        plan = structs.replace(plan, check=True, markers=min(max(used, 3), MOST_MARKERS))
    seed = usual.simulation.seed if view.begun is None else view.begun.seed
    return structs.replace(usual, plan=plan, simulation=structs.replace(usual.simulation, seed=seed))


def _new_record(folder: Path) -> Path:
    """Return the path of the record of the next run that follows with the registration of a session."""
    number = 1
    while (path := folder / f"following-{number}.jsonl").exists():
        number += 1
    return path


def _continuing(command: Sequence[str], folder: Path) -> list[str]:
    """Return the command that continues a session."""
    return [*command, "--continue", str(folder)]


def _keep(begun: BegunSession) -> None:
    """Keep which session was begun last, for a page that is started again; `OSError` if that cannot be written."""
    path = _page_file()
    make_folder(path.parent)
    with replace_file(path) as part:
        part.write_bytes(msgspec.json.encode(begun))
