"""A command of markerseek as a child process, whose journal is followed while it is written, in a thread if need be.

The child has the bridge's terminal: a rig of devices asks there whether it may be armed, and ends with exit code 4 if
nobody answers. Whoever reads its events sends it a heartbeat meanwhile: it stops, with the laser off, when the bridge
is killed or hangs. `Searches` starts the searches that other programs ask for, one at a time.
"""

from __future__ import annotations

import errno
import math
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec

from markerseek.bridges.outcome import Outcome, PrintedError
from markerseek.bridges.request import SearchRequest
from markerseek.bridges.run_images import PicturedItem, with_images
from markerseek.core import MarkerseekError, RecordError, SearchError
from markerseek.drivers import BenchSettings
from markerseek.records.journal import JournalItem, default_journal, follow_journal, make_folder
from markerseek.rigs import read_rig_file
from markerseek.runs import ImageRing

TERMINATE_S = 2.0
"""Time from SIGINT to SIGTERM when a child is stopped, in seconds: SIGINT is ignored in what a script starts with &."""

_BEAT_S = 0.5
"""Longest time between two beats of the heartbeat that a child is sent, in seconds."""

_POLL_S = 0.004
"""Time between two looks for a new entry, in seconds."""

_HANDING_ON = frozenset({"search", "resume"})
"""Commands that hand the images of their one search on."""

_MAX_ANSWER_BYTES = 1 << 24
"""Largest JSON object of a command; the result of 500 acquisitions has 100 kilobytes."""


_Item = TypeVar("_Item")


class ChildRun:
    """A running command. Read `items` to its end, then ask for `outcome`.

    A search stops when nobody has read `items` for 4 s. Entries that wait to be read are in the file.

    ``arguments``: command and options, such as ``["search", "--seed", "1"]``; ``--json`` and those of the bridge are
    added. ``journal``: the journal, or the folder of a registration session, that they name; None if they keep none,
    and a file is made for the run alone.
    """

    images: ImageRing | None = None
    """Images that it hands on; None if it does not."""

    def __init__(self, arguments: Sequence[str], *, journal: Path | None = None) -> None:
        beats, beating = os.pipe()
        watched = ["--heartbeat", f"/dev/fd/{beats}"]
        inherited = [beats]
        if arguments[0] in _HANDING_ON:
            self.images = ImageRing.create()
        if self.images is not None:
            watched += ["--image-ring", f"/dev/fd/{self.images.fileno()}"]
            inherited.append(self.images.fileno())
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        if journal is None:
            self._folder = tempfile.TemporaryDirectory(prefix="markerseek-")
            journal = Path(self._folder.name) / "events"
            watched += ["--events", str(journal)]
        self._journal = journal
        self._before = _sizes(journal)
        self._beat_s = -math.inf
        # A child that is stopped reads no beats: then they are lost, and nobody waits.
        os.set_blocking(beating, False)
        self._heartbeat = os.fdopen(beating, "wb", buffering=0)
        # A file and no pipe: nobody reads the answer before the end, and a pipe would fill up.
        self._answer = tempfile.TemporaryFile()  # noqa: SIM115  closed in `outcome`
        self._outcome: Outcome | None = None
        self._lock = threading.Lock()
        self._stopped = False
        # Until `markerseek.cli.main` handles it: Python would print a traceback if it is stopped while it starts.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            # -P: a file in the current folder must not replace a module.
            self._process = subprocess.Popen(  # noqa: S603  no shell; the arguments are ours
                [sys.executable, "-P", "-m", "markerseek", *arguments, *watched, "--json"],
                stdout=self._answer,
                pass_fds=inherited,
            )
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(beats)

    def items(self) -> Iterator[JournalItem]:
        """Return the configuration and entries, as each is written.

        Waits for the next, and sends the heartbeat meanwhile.

        Of a run that is continued, all its entries from the first. Raises `RecordError` if the file is damaged.
        """
        return self.beating(follow_journal(self._journal, is_over=lambda: not self.running, wait=self.wait))

    def beating(self, items: Iterable[_Item]) -> Iterator[_Item]:
        """Yield the items of what is followed by `wait`, with the heartbeat also where one comes after the other."""
        for item in items:
            self._beat()
            yield item

    def wait(self) -> None:
        """Wait a moment for more of what the child writes, and send the heartbeat."""
        self._beat()
        time.sleep(_POLL_S)  # noqa: TID251  a file is followed in real time

    def _beat(self) -> None:
        # By the thread that reads, and by no timer: it must be late where entries are not read any more.
        if time.monotonic() - self._beat_s > _BEAT_S:
            self._beat_s = time.monotonic()
            with suppress(BlockingIOError, BrokenPipeError):
                self._heartbeat.write(b".")

    def stop(self, number: signal.Signals = signal.SIGINT) -> None:
        """Stop the run; returns at once, and may be called again, and by any thread.

        The child stops the rig, and ends. After `TERMINATE_S` it is sent SIGTERM as well. ``number``: SIGINT for a
        person, SIGTERM for a program, which the record tells apart.
        """
        with self._lock:
            again = self._stopped
            self._stopped = True
        # Once: a second signal would only disturb how it ends.
        if not again and self._process.poll() is None:
            self._process.send_signal(number)
            timer = threading.Timer(TERMINATE_S, self._process.terminate)
            timer.daemon = True
            timer.start()

    def kill(self) -> None:
        """Kill a child that does not stop; its supervisor then stops the rig, and its journal can be resumed."""
        self._process.kill()

    @property
    def running(self) -> bool:
        """Whether the child lives."""
        return self._process.poll() is None

    @property
    def has_written(self) -> bool:
        """Whether it has written anything: a command that continues a record finds one that others have written."""
        return _sizes(self._journal) != self._before

    @property
    def process_id(self) -> int:
        """Its process id."""
        return self._process.pid

    def outcome(self) -> Outcome:
        """Return how it ended; waits for its end, and sends the heartbeat meanwhile."""
        code = self._process.poll()
        while code is None:
            self._beat()
            with suppress(subprocess.TimeoutExpired):
                code = self._process.wait(_BEAT_S)
        with self._lock:
            if self._outcome is None:
                self._answer.seek(0)
                text = self._answer.read(_MAX_ANSWER_BYTES)
                self._answer.close()
                self._heartbeat.close()
                if self.images is not None:
                    self.images.close()
                if self._folder is not None:
                    self._folder.cleanup()
                self._outcome = Outcome.of(code if code >= 0 else 128 - code, text)
            return self._outcome


class EndedRun(ChildRun):
    """A command that ended before this program was started; only its record can be read."""

    def __init__(self) -> None:
        """Make one that was stopped by the end of the program that ran it."""
        self._ended = Outcome(exit_code=128 + signal.SIGTERM)

    @property
    def running(self) -> bool:
        """Whether it lives: it does not."""
        return False

    @property
    def has_written(self) -> bool:
        """Whether its record is of its own."""
        return True

    def beating(self, items: Iterable[_Item]) -> Iterator[_Item]:
        """Return the items of its record."""
        return iter(items)

    def wait(self) -> None:
        """Return at once: nothing more comes."""

    def stop(self, number: signal.Signals = signal.SIGINT) -> None:
        """Do nothing: it has ended."""

    def kill(self) -> None:
        """Do nothing: it has ended."""

    def outcome(self) -> Outcome:
        """Return how it ended."""
        return self._ended


def _sizes(path: Path) -> dict[str, int]:
    """Return the size of a file, or of each file in a folder, by their names; empty if there is none."""
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    return {each.name: each.stat().st_size for each in files if each.is_file()}


class FollowedChild:
    """A child, and a thread of its own that follows it to its end.

    ``take``: takes what the child writes, until it ends; if it fails, the child is stopped. ``on_end``: called with how
    the child ended, or with what went wrong in ``take``.
    """

    def __init__(self, child: ChildRun, *, take: Callable[[ChildRun], None], on_end: Callable[[Outcome], None]) -> None:
        self.child = child
        self._take = take
        self._on_end = on_end
        self._thread = threading.Thread(target=self._follow, name="follow a child", daemon=True)
        self._thread.start()

    def join(self, timeout_s: float | None = None) -> bool:
        """Wait until its end has been reported; returns whether it has."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _follow(self) -> None:
        failure: BaseException | None = None
        try:
            self._take(self.child)
        except (MarkerseekError, OSError) as problem:
            failure = problem
        except BaseException:
            failure = MarkerseekError("the search cannot be shown; it was stopped")
            raise
        finally:
            if failure is not None:
                # A search must not run on that nobody sees.
                self.child.stop()
            outcome = self.child.outcome()
            if failure is not None:
                error = PrintedError(error=str(failure), kind=type(failure).__name__)
                outcome = Outcome(exit_code=1, printed=msgspec.to_builtins(error), error=error)
            self._on_end(outcome)


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
        """Return the options of ``markerseek search``."""
        options = [] if self.rig is None else [f"--rig={self.rig}"]
        return [*options, f"--pace={self.pace}"] if self.pace else options

    def new_journal(self, *, method: str) -> Path | None:
        """Return the journal of a new search, in the data folder; None if that takes none, and the rig is simulated.

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
    thread with each item of the journal and its image, and with how the search ended.
    """

    def __init__(
        self,
        options: SearchOptions,
        *,
        on_start: Callable[[int], None],
        on_item: Callable[[PicturedItem], None],
        on_end: Callable[[Outcome], None],
    ) -> None:
        self._options = options
        self._on_start = on_start
        self._on_item = on_item
        self._on_end = on_end
        self._lock = threading.Lock()
        self._followed: FollowedChild | None = None

    @property
    def running(self) -> bool:
        """Whether a search runs, or its end has not been reported."""
        return self._followed is not None and not self._followed.join(0)

    def start(self, asked: SearchRequest, *, asked_by: str | None = None) -> None:
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
        for item in with_images(child.items(), handed=child.images):
            self._on_item(item)
