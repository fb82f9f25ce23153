"""What the page starts: a search or a registration session as a child whose events become what is drawn.

All viewers share both; only one runs at a time.
"""

from __future__ import annotations

import os
import shlex
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, TypeAlias
from urllib.parse import parse_qsl

import msgspec
from msgspec import structs

from markerseek.bridges.child import ChildRun, EndedRun, FollowedChild, Outcome
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.session_display import session_verdict
from markerseek.bridges.request import AnyRequest, SearchRequest, SessionRequest
from markerseek.bridges.run_images import PicturedItem, with_images, without_images
from markerseek.core import Interval, RecordError, SearchError
from markerseek.drivers import BenchSettings
from markerseek.files import MIB, data_folder, read_input, replace_file
from markerseek.records.journal import Configuration, RunView, default_journal, follow_journal, make_folder
from markerseek.registration import (
    CAMERA_IMAGES,
    MOST_MARKERS,
    SPOT_IS_SET,
    KeptSession,
    SessionView,
    SpotSeen,
    default_folder,
    delete_session,
    follow_session,
    is_running,
    kept_sessions,
    next_view,
    read_view,
    sessions_folder,
)
from markerseek.show import STOPPED, Verdict, verdict_of
from markerseek.sim import SimulatedSettings

WITH_CAMERAS = ("page", "--rig", "RIG.toml", "--cameras", "STEREO.yaml", "--images", "LEFT RIGHT")
"""Command that serves a page whose rig of devices can register."""

SUPERVISED_END = "its supervisor disarms the laser and stops the stage"
"""What laser and stage do if the search was killed, and could not see to them itself."""


Further: TypeAlias = Literal["go on", "one more marker", "check"]
"""For what a session that is kept is continued."""


class ChildSearch:
    """A search, followed by a thread of its own until it ends.

    ``asked``: what a person chose on the page. ``journal``: the journal of the command. ``goes_on``: the command that
    continues it, here if it is of a simulated rig, else in the terminal. ``simulated``: whether no hardware is
    involved. ``because``: why it was stopped, if that was no person.
    """

    unwatched_s = 5.0
    """Time without any viewer after which it is stopped, in seconds: nobody would see it, or press STOP."""

    def __init__(
        self,
        child: ChildRun,
        *,
        asked: AnyRequest,
        journal: Path,
        goes_on: Sequence[str] = (),
        simulated: bool = True,
        because: str = "",
    ) -> None:
        self.asked = asked
        self.journal = journal
        self.goes_on = goes_on
        self._simulated = simulated
        self._because = because
        self.run: RunHistory | None = None
        self.outcome: Outcome | None = None
        """How it ended; None before."""
        self._stopping = False
        self._followed = FollowedChild(child, take=self._take, on_end=self._end)

    @property
    def _has_begun(self) -> bool:
        return self.run is not None

    @property
    def _is_starting(self) -> bool:
        """Whether the command has not begun: what its record holds by then is of a run that it continues."""
        return self.outcome is None and not self._followed.child.has_written

    @property
    def message(self) -> str:
        """One sentence on how it ended; empty before."""
        return "" if self.outcome is None else self._end_of(self.outcome)

    def _end_of(self, outcome: Outcome) -> str:
        if outcome.stopped:
            return STOPPED.replace("stopped: ", f"stopped: {self._because}; ") if self._because else STOPPED
        # A search of devices that was killed could not see to laser and stage itself.
        killed = outcome.failed and outcome.answer is None and not self._simulated
        return outcome.message + (f"; {SUPERVISED_END}" if killed else "")

    @property
    def can_go_on(self) -> bool:
        """Whether it was broken off, and can go on here."""
        if self.outcome is None or self.outcome.answered or not (self._simulated and self.journal.exists()):
            return False
        return self.run is None or self.run.last.phase not in {"finished", "fault"}

    @property
    def next_step(self) -> str:
        """What a person can do next; empty while it runs, but for devices that a person must arm."""
        if self.outcome is None:
            asks = self._is_starting and not (self._simulated or self._stopping)
            return "answer in the terminal where the page was started" if asks else ""
        if self.can_go_on:
            return "Go on continues it; Start begins a new search"
        if self._simulated or self.run is None:
            return "Start begins a new search"
        # As the terminal says it: a fault that the journal holds is reset by a person who has looked at the rig.
        is_fault = self.run.last.phase == "fault"
        resume = f"markerseek {shlex.join([*self.goes_on, *(['--reset-fault'] if is_fault else [])])}"
        when = "once the fault is repaired, " if is_fault else ""
        return f"Start begins a new search; {when}{resume}, in the terminal, goes on with this one"

    def verdict(self, view: RunView | None) -> Verdict:
        """What it says in large letters; ``view``: the event that is shown."""
        if self.outcome is None and (view is None or self._stopping or self._is_starting):
            word = "STOPPING" if self._stopping else "STARTING"
            return Verdict(word=word, kind="busy", next_step=self.next_step)
        if view is not None:
            verdict = verdict_of(view, next_step=self.next_step)
            return replace(verdict, reason=self._reason) if self._because and verdict.kind == "stopped" else verdict
        if self.outcome is not None and self.outcome.failed:
            return Verdict(word="FAULT", kind="fault", problem=self.message, next_step=self.next_step)
        word = self.message.partition(": ")[0]
        return Verdict(word=word.upper(), kind="stopped", reason=self._reason, next_step=self.next_step)

    @property
    def _reason(self) -> str:
        """How it ended, without the word that stands beside it."""
        return self.message.partition(": ")[2]

    def stop(self, *, because: str = "") -> None:
        """Stop it; allowed at any time, also twice. ``because``: why, if it is not a person who stops it."""
        if not self._stopping:
            self._because = because
        self._stopping = True
        self._followed.child.stop(signal.SIGTERM if because else signal.SIGINT)

    def end(self, timeout_s: float) -> None:
        """Wait until it has ended, and kill it if it has not by then."""
        if not self._followed.join(timeout_s):
            self._followed.child.kill()

    def _take(self, child: ChildRun) -> None:
        """Take what the child writes, until it ends."""
        self._add(with_images(child.items(), handed=child.images))

    def _add(self, items: Iterable[PicturedItem]) -> None:
        """Take the items of a search."""
        for item in items:
            if isinstance(item, Configuration):
                self.run = RunHistory(item)
            elif self.run is not None:
                self.run.add(item)

    def _end(self, outcome: Outcome) -> None:
        if self.run is not None and not self.run.last.over:
            self.run.cut_off(self._end_of(outcome), problem=outcome.message if outcome.failed else "")
        self.outcome = outcome


class ChildRegistration(ChildSearch):
    """A session; its journal is the folder of its record, and its run the search that goes on, or the last one."""

    unwatched_s = 60.0
    """The same for a session: a person beside the patient may reload the page, or open it on another computer."""

    view = SessionView()
    """The session after its steps so far."""
    images_ns = 0
    """When the newest camera images were written; 0 before the first."""

    @property
    def _has_begun(self) -> bool:
        return self.view.begun is not None

    @property
    def can_go_on(self) -> bool:
        """Whether it was broken off after its beginning."""
        return self.outcome is not None and self._has_begun and self.view.ended is None and not self.view.moved

    @property
    def next_step(self) -> str:
        """What a person can do next; empty while it runs, but for devices that a person must arm."""
        if self.outcome is None:
            return super().next_step
        if self.view.ended is not None and not self.outcome.failed:
            return f"recorded in {self.journal}"
        if self.view.moved:
            return "Start begins a new session"
        goes_on = f"markerseek {shlex.join(self.goes_on)}"
        return f"Start begins a new session, Go on continues this one; in a terminal: {goes_on}"

    @property
    def asks_whether_set(self) -> bool:
        """Whether the laser is dark until somebody says that the spot is set."""
        waiting = self.view.waiting
        return self.outcome is None and not self._stopping and waiting is not None and waiting.dark

    def say_spot_is_set(self) -> None:
        """Say that the spot is set, if the session waits for that."""
        if self.asks_whether_set:
            flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW
            os.close(os.open(self.journal / SPOT_IS_SET, flags, 0o600))

    @property
    def said(self) -> Verdict:
        """What the session says in large letters, and what a person has to do."""
        goes_on = self.outcome is None and self._has_begun and not (self._stopping or self._is_starting)
        if goes_on or (self.outcome is not None and self.view.ended is not None and not self.outcome.failed):
            return session_verdict(self.view, next_step=self.next_step)
        return self.verdict(None)

    def _look_at_images(self) -> None:
        """Note when the newest images were written."""
        with suppress(FileNotFoundError):
            # The right one is the last to be written.
            self.images_ns = (self.journal / CAMERA_IMAGES[1]).stat().st_mtime_ns

    def _take(self, child: ChildRun) -> None:
        def is_searched() -> bool:
            return not child.running or (self.run is not None and self.run.last.over)

        folder = self.journal
        self.view = SessionView(source=folder)

        def wait() -> None:
            # Also while no step comes: the images are live while a person moves the spot.
            self._look_at_images()
            child.wait()

        for step in child.beating(follow_session(folder, is_over=lambda: not child.running, wait=wait)):
            self._look_at_images()
            self.view = next_view(self.view, step)
            if isinstance(step, SpotSeen) and step.journal is not None:
                self.run = None
                search = follow_journal(folder / step.journal, is_over=is_searched, wait=child.wait)
                self._add(without_images(child.beating(search)))


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
        self._kept: tuple[object, list[KeptSession]] = (None, [])

    @property
    def _running(self) -> list[ChildSearch]:
        return [each for each in (self.registration, self.search) if each is not None and each.outcome is None]

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


def _continuing(command: Sequence[str], folder: Path) -> list[str]:
    """Return the command that continues a session."""
    return [*command, "--continue", str(folder)]


def _keep(begun: BegunSession) -> None:
    """Keep which session was begun last, for a page that is started again; `OSError` if that cannot be written."""
    path = _page_file()
    make_folder(path.parent)
    with replace_file(path) as part:
        part.write_bytes(msgspec.json.encode(begun))
