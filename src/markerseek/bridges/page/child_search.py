"""A command that runs as a child and is watched: its events become a `RunHistory`, its end an outcome."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal, Protocol, TypeAlias

from markerseek.bridges.child import Outcome
from markerseek.bridges.page.run_history import RunHistory
from markerseek.core import MarkerseekError, Measured
from markerseek.records.stream import StreamEnd, StreamEvent, StreamHead, StreamItem

Status: TypeAlias = Literal["starting", "running", "stopping", "ended"]

MAX_WAITING = 16
"""Events that may wait with their frames, of half a megabyte each; more wait without, and have no image."""


class Child(Protocol):
    """What is used of `markerseek.bridges.ChildRun`."""

    def items(self) -> Iterator[StreamItem]:
        """Head, events and end, each as it arrives."""

    def stop(self) -> None:
        """SIGINT, after 2 s SIGTERM."""

    def kill(self) -> None:
        """SIGKILL."""

    def outcome(self) -> Outcome:
        """How it ended."""


Launch: TypeAlias = Callable[[Sequence[str]], Child]
"""Starts a command."""


class ChildSearch:
    """One child, followed by a thread of its own until it ends.

    ``journal``: the journal that it keeps, for `resume`; None where it keeps none. ``before``: the run that it
    continues, whose images are kept; None where it continues none. ``on_change``: called by a thread of the run
    whenever there is something new to show.
    """

    def __init__(
        self,
        launch: Launch,
        arguments: Sequence[str],
        *,
        journal: Path | None = None,
        before: RunHistory | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.arguments = tuple(arguments)
        self.journal = journal
        self.run: RunHistory | None = None
        self.outcome: Outcome | None = None
        self.lost = 0
        self._before = before
        self._on_change = on_change
        self._ended = threading.Event()
        self._launch = launch
        self._child: Child | None = None
        self._stop_wanted = threading.Event()
        self._failure: str | None = None
        self._arrived: queue.SimpleQueue[StreamItem | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._follow, name="follow a child", daemon=True)
        self._thread.start()

    @property
    def status(self) -> Status:
        """Where it is."""
        if self._ended.is_set():
            return "ended"
        if self._stop_wanted.is_set():
            return "stopping"
        return "running" if self.run is not None else "starting"

    @property
    def last_run(self) -> RunHistory | None:
        """What is known of the run: also what was known before it was continued, until that has begun."""
        return self._before if self.run is None else self.run

    @property
    def message(self) -> str:
        """One sentence on how it ended; empty before."""
        if self._failure is not None:
            return self._failure
        return "" if self.outcome is None else self.outcome.message

    @property
    def failed(self) -> bool:
        """Whether it ended by a fault, also one of the page; see `Outcome.failed`."""
        return self._failure is not None or (self.outcome is not None and self.outcome.failed)

    def stop(self) -> None:
        """Stop it; allowed at any time, also twice."""
        self._stop_wanted.set()
        child = self._child
        if child is not None:
            child.stop()

    def kill(self) -> None:
        """Kill a child that does not stop."""
        if self._child is not None:
            self._child.kill()

    def join(self, timeout_s: float) -> bool:
        """Wait until it has ended; returns whether it has."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _follow(self) -> None:
        try:
            with self._stopped_by_failure("follow"):
                # Before the child, so that none runs on that nobody reads.
                showing = threading.Thread(target=self._show, name="show a child", daemon=True)
                showing.start()
                try:
                    child = self._child = self._launch(self.arguments)
                    # STOP may have been pressed while the child was being started.
                    if self._stop_wanted.is_set():
                        child.stop()
                    # Only handed on here: a stream that is not read at once loses frames, and then events.
                    for item in child.items():
                        self._arrived.put(self._within_memory(item))
                except BaseException:
                    # A stream that cannot be read must not leave a search running that nobody sees.
                    self.stop()
                    raise
                finally:
                    self._arrived.put(None)
                    showing.join()
                    if self._child is not None:
                        self.outcome = self._child.outcome()
        finally:
            if self.run is not None and not self.run.snapshots[-1].over:
                self.run.cut_off(self.message)
            self._ended.set()
            self._on_change()

    def _show(self) -> None:
        with self._stopped_by_failure("show"):
            while (item := self._arrived.get()) is not None:
                self._take(item)

    @contextmanager
    def _stopped_by_failure(self, what: str) -> Iterator[None]:
        """Stop the search on any error in this block, with a sentence, because nobody would see the search any more."""
        whole = False
        try:
            yield
            whole = True
        except (MarkerseekError, OSError) as problem:
            self._failure = str(problem)
        finally:
            if not whole:
                self._failure = self._failure or f"the page cannot {what} this search; it was stopped"
                self.stop()

    def _within_memory(self, item: StreamItem) -> StreamItem:
        """The item, without its frame where too many wait for their images."""
        if not isinstance(item, StreamEvent) or not isinstance(item.event, Measured):
            return item
        sample = item.event.sample
        # The confirmation is the image that everybody looks at in the end.
        if item.event.role == "confirmation" or (not sample.dark and self._arrived.qsize() < MAX_WAITING):
            return item
        return replace(item, event=replace(item.event, sample=replace(sample, frame=None)))

    def _take(self, item: StreamItem) -> None:
        if isinstance(item, StreamHead):
            run = RunHistory(item.configuration)
            if self._before is not None:
                # A run that is continued repeats its events without their frames.
                run.pictures.update(self._before.pictures)
            self.run = run
            self._on_change()
        elif isinstance(item, StreamEvent) and self.run is not None:
            self.lost += item.lost_lines
            pulses = 0 if item.header is None else item.header.pulses
            self.run.add(
                item.event, clock_s=item.clock_s, pulses=pulses, lost=item.lost_lines, on_change=self._on_change
            )
        elif isinstance(item, StreamEnd):
            self.lost += item.lost_lines
