"""Options of the commands that are run by other programs: the file that they follow, and their heartbeat."""

from __future__ import annotations

import os
import select
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from markerseek.core import ConfigError

Events: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Write the events of a run without a journal to this new file, for programs that follow it; see "
        "'markerseek journal follow'."
    ),
]
Heartbeat: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        hidden=True,
        help="For a bridge: stop, with the laser off, when no byte comes from this pipe, /dev/fd/N, for 4 s, or its "
        "writer ends.",
    ),
]

SILENT_S = 4.0
"""Longest time without a beat, in seconds: a search then has one more to stop (decision 44)."""

ORDERLY_S = 1.0
"""Time for an orderly end, in seconds; what hangs then is ended all the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchOptions:
    """Values of these options."""

    events: Path | None = None
    heartbeat: Path | None = None

    def __post_init__(self) -> None:
        if self.heartbeat is not None and not self.heartbeat.is_fifo():
            raise ConfigError(f"--heartbeat {self.heartbeat}: it is no pipe; name one that is open, /dev/fd/N")

    @contextmanager
    def stopping(self) -> Iterator[None]:
        """Send this process SIGTERM when the heartbeat is late or ends, where there is one; end it if that hangs."""
        if self.heartbeat is None:
            yield
            return
        over = threading.Event()
        beats = os.open(self.heartbeat, os.O_RDONLY | os.O_NONBLOCK)
        # A signal, so that the run is stopped in one way only; the thread does nothing but wait.
        thread = threading.Thread(target=_terminate_without_beats, args=(beats, over), daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            os.close(beats)


_LOOK_S = 0.05
"""Longest time until the waiting thread sees that the run is over, in seconds; the writer's end wakes it at once."""


def _terminate_without_beats(beats: int, over: threading.Event) -> None:
    poller = select.poll()
    poller.register(beats, select.POLLIN)
    beat_s = time.monotonic()
    while not over.is_set():
        arrived = bool(poller.poll(_LOOK_S * 1e3))
        # A pipe without a writer can be read, and holds nothing.
        if arrived and os.read(beats, 4096):
            beat_s = time.monotonic()
        elif arrived or time.monotonic() - beat_s > SILENT_S:
            # Whatever hangs: the supervisor makes laser and stage safe, as after any death of a search.
            ending = threading.Timer(ORDERLY_S, os._exit, [128 + signal.SIGTERM])
            ending.daemon = True
            ending.start()
            os.kill(os.getpid(), signal.SIGTERM)
            return
