"""What the page runs: a search, a session, or a run that follows, as a child whose events become what is drawn."""

from __future__ import annotations

import os
import shlex
import signal
import time
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from markerseek.bridges.child import ChildRun, FollowedChild
from markerseek.bridges.outcome import Outcome
from markerseek.bridges.page.run_history import RunHistory
from markerseek.bridges.page.session_display import session_verdict
from markerseek.bridges.request import AnyRequest, FollowRequest
from markerseek.bridges.run_images import PicturedItem, with_images, without_images
from markerseek.core import SearchError
from markerseek.files import replace_file
from markerseek.following import BY_A_PERSON, BY_ITSELF, FollowBegun, FollowStep, follow_record
from markerseek.records.journal import Configuration, RunView, follow_journal
from markerseek.registration import (
    CAMERA_IMAGES,
    MOTION_FILE,
    POINTED_AT,
    SPOT_IS_SET,
    SessionView,
    SpotSeen,
    WatchedMotion,
    follow_session,
    next_view,
    read_motion,
)
from markerseek.show import STOPPED, FollowedMoment, Verdict, verdict_of

SUPERVISED_END = "its supervisor disarms the laser and stops the stage"
"""What laser and stage do if the search was killed, and could not see to them itself."""


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
        killed = outcome.failed and outcome.printed is None and not self._simulated
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
        """Return what it says in large letters; ``view``: the event that is shown."""
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
    motion: WatchedMotion | None = None
    """What the cameras see move during the search, or saw during the last one; None: nobody looked."""
    _motion_ns = 0

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
            return ""
        if self.view.moved:
            return "Start begins a new session"
        goes_on = f"markerseek {shlex.join(self.goes_on)}"
        return f"Start begins a new session, Go on continues this one; in a terminal: {goes_on}"

    @property
    def can_follow(self) -> bool:
        """Whether nothing runs, and a registration holds by which one can follow."""
        return self.outcome is not None and self.view.registration is not None

    @property
    def asks_whether_set(self) -> bool:
        """Whether the laser is dark until somebody says that the spot is set."""
        waiting = self.view.waiting
        return self.outcome is None and not self._stopping and waiting is not None and waiting.dark

    def say_spot_is_set(self) -> None:
        """Say that the spot is set, if the session waits for that."""
        if self.asks_whether_set:
            touch(self.journal / SPOT_IS_SET)

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
        with suppress(FileNotFoundError):
            written_ns = (self.journal / MOTION_FILE).stat().st_mtime_ns
            if written_ns != self._motion_ns:
                self._motion_ns = written_ns
                self.motion = read_motion(self.journal)

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
                search = follow_journal(folder / step.journal, is_over=is_searched, wait=wait)
                self._add(without_images(child.beating(search)))


class ChildFollowing(ChildSearch):
    """A run that follows with the registration of a session; its journal is its record."""

    begun: FollowBegun | None = None
    """What is followed; None before its beginning."""
    last: FollowStep | None = None
    """How it stands; None before its first step."""
    images_ns = 0
    """When the newest camera images were written; 0 before the first."""

    def __init__(self, child: ChildRun, *, asked: FollowRequest, journal: Path, simulated: bool) -> None:
        self.request = asked
        """What a person has permitted."""
        self.folder = Path(asked.folder)
        """Folder of the session."""
        self._begun_ns = time.time_ns()
        self._begun_s = 0.0
        self._moments: deque[FollowedMoment] = deque()
        super().__init__(child, asked=asked, journal=journal, simulated=simulated)

    @property
    def _has_begun(self) -> bool:
        return self.last is not None

    @property
    def can_go_on(self) -> bool:
        """Whether it can go on here: a person begins it anew."""
        return False

    @property
    def moments(self) -> tuple[FollowedMoment, ...]:
        """The last seconds, as they are drawn."""
        return tuple(self._moments.copy())

    @property
    def is_stopping(self) -> bool:
        """Whether somebody has stopped it, and it has not ended."""
        return self._stopping and self.outcome is None

    @property
    def takes_points(self) -> bool:
        """Whether somebody may point at another place."""
        return self.request.pixel is not None and self.last is not None and self.outcome is None and not self._stopping

    @property
    def asks_whether_set(self) -> bool:
        """Whether the laser is dark until somebody says that the spot is set."""
        dark = self.request.pixel is None and not self.request.plan.light_while_waiting and not self._simulated
        waits = self.last is not None and self.last.word in BY_ITSELF
        return dark and waits and self.outcome is None and not self._stopping

    def say_spot_is_set(self) -> None:
        """Say that the spot is set, if it waits for that."""
        if self.asks_whether_set:
            touch(self.folder / SPOT_IS_SET)

    def point_at(self, left_px: tuple[float, float]) -> None:
        """Name another place in the left image, under the same permit; `SearchError` if none is taken now."""
        if not self.takes_points:
            raise SearchError("nothing follows a place that somebody points at; press Follow first")
        x, y = left_px
        with replace_file(self.folder / POINTED_AT) as part:
            part.write_text(f"{x:.1f} {y:.1f}\n")

    def _take(self, child: ChildRun) -> None:
        def wait() -> None:
            self._look_at_images()
            child.wait()

        lines = follow_record(self.journal, is_over=lambda: not child.running, wait=wait)
        for line in child.beating(lines):
            self._look_at_images()
            if isinstance(line, FollowBegun):
                self.begun = line
            elif isinstance(line, FollowStep):
                self._add_step(line)

    def _add_step(self, step: FollowStep) -> None:
        if self.last is None:
            self._begun_s = step.at_s
        at_s = step.at_s - self._begun_s
        self._moments.append(
            FollowedMoment(
                at_s=at_s,
                probe_deg=step.probe_deg,
                target_deg=step.target_deg,
                sigma_deg=step.sigma_deg,
                within_deg=step.within_deg,
                word=step.word,
                stays=step.word in BY_ITSELF or step.word in BY_A_PERSON,
            )
        )
        while self._moments[0].at_s < at_s - SPAN_S:
            self._moments.popleft()
        self.last = step

    def _look_at_images(self) -> None:
        """Note when the newest images of this run were written."""
        with suppress(FileNotFoundError):
            written_ns = (self.folder / CAMERA_IMAGES[1]).stat().st_mtime_ns
            if written_ns >= self._begun_ns:
                self.images_ns = written_ns


SPAN_S = 30.0
"""Time over which a run that follows is drawn, in seconds."""


def touch(path: Path) -> None:
    """Make an empty file, by which a program is told something."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW
    os.close(os.open(path, flags, 0o600))
