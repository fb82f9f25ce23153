"""A command that runs as a child and is watched: its events become a `RunHistory`, its end an outcome."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Generic, Literal, TypeAlias, TypeVar

from markerseek.bridges.asked import AskedRegistration, AskedSearch
from markerseek.bridges.child import ChildRun, Outcome
from markerseek.bridges.page.run_history import RunHistory
from markerseek.core import MarkerseekError
from markerseek.records.journal import Configuration, JournalItem
from markerseek.runs import STOPPED

SUPERVISED_END = "its supervisor disarms the laser and stops the stage"
"""What laser and stage do if the search was killed, and could not see to them itself."""

Status: TypeAlias = Literal["starting", "running", "stopping", "ended"]


AskedT = TypeVar("AskedT", AskedSearch, AskedRegistration)

Launch: TypeAlias = Callable[..., ChildRun]
"""What starts a command; arguments as of `ChildRun`."""


class ChildSearch(Generic[AskedT]):
    """One child, followed by a thread of its own until it ends.

    ``asked``: what a person chose on the page. ``journal``: the journal of the command, for `resume`; None if it
    keeps none. ``on_change``: called by a thread of the run whenever there is something new to show.
    """

    PICTURES = True
    """Whether the images of the acquisitions are formed, for those who show them."""

    def __init__(
        self,
        launch: Launch,
        arguments: Sequence[str],
        *,
        asked: AskedT,
        journal: Path | None = None,
        on_change: Callable[[], None] = lambda: None,
    ) -> None:
        self.asked: AskedT = asked
        self.journal = journal
        self._arguments = tuple(arguments)
        self.run: RunHistory | None = None
        self.outcome: Outcome | None = None
        self._on_change = on_change
        self._ended = threading.Event()
        self._launch = launch
        self._child: ChildRun | None = None
        self._stop_wanted = threading.Event()
        self._failure: str | None = None
        self._thread = threading.Thread(target=self._follow, name="follow a child", daemon=True)
        self._thread.start()

    @property
    def status(self) -> Status:
        """Where it is."""
        if self._ended.is_set():
            return "ended"
        if self._stop_wanted.is_set():
            return "stopping"
        return "running" if self._has_begun else "starting"

    @property
    def _has_begun(self) -> bool:
        return self.run is not None

    @property
    def message(self) -> str:
        """One sentence on how it ended; empty before."""
        outcome = self.outcome
        if self._failure is not None or outcome is None:
            return self._failure or ""
        if outcome.stopped:
            return STOPPED
        # A search of devices that was killed could not see to laser and stage itself.
        killed = outcome.failed and outcome.answer is None
        on_bench = self.run is not None and self.run.last.facts.kind == "bench"
        return outcome.message + (f"; {SUPERVISED_END}" if killed and on_bench else "")

    @property
    def failed(self) -> bool:
        """Whether it ended by a fault, also one of the page; see `Outcome.failed`."""
        return self._failure is not None or (self.outcome is not None and self.outcome.failed)

    def stop(self) -> None:
        """Stop it; allowed at any time, also twice."""
        self._stop_wanted.set()
        if self._child is not None:
            self._child.stop()

    def kill(self) -> None:
        """Kill a child that does not stop."""
        if self._child is not None:
            self._child.kill()

    def join(self, timeout_s: float) -> bool:
        """Wait until it has ended; returns whether it has."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _take(self, child: ChildRun) -> None:
        """Take what the child writes, until it ends."""
        self._add(child.items())

    def _add(self, items: Iterable[JournalItem]) -> None:
        """Take the items of a search."""
        for item in items:
            if isinstance(item, Configuration):
                self.run = RunHistory(item, pictures=self.PICTURES)
                self._on_change()
            elif self.run is not None:
                self.run.add(item.event, clock_s=item.clock_s, on_change=self._on_change)

    def _follow(self) -> None:
        try:
            child = self._child = self._launch(self._arguments, journal=self.journal)
            # STOP may have been pressed while the child was being started.
            if self._stop_wanted.is_set():
                child.stop()
            self._take(child)
        except (MarkerseekError, OSError) as problem:
            self._failure = str(problem)
            self.stop()
        except BaseException:
            # A search must not run on that nobody sees.
            self._failure = "the page cannot show this search; it was stopped"
            self.stop()
            raise
        finally:
            if self._child is not None:
                self.outcome = self._child.outcome()
            if self.run is not None and not self.run.last.over:
                wrong = self.message.removesuffix(f"; {SUPERVISED_END}") if self.failed else ""
                self.run.cut_off(self.message, problem=wrong)
            self._ended.set()
            self._on_change()
