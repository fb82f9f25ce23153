"""Options of the commands that send their events to other programs, and the end of a run with its reader."""

from __future__ import annotations

import os
import select
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from markerseek.core import ConfigError

if TYPE_CHECKING:
    from markerseek.records.journal import Configuration
    from markerseek.records.stream import EventStream

Events: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Send each event as a JSON line to a new file, a FIFO or /dev/fd/N; never waits for the reader."),
]
EventFrames: TypeAlias = Annotated[
    bool, typer.Option("--event-frames", help="Send the channel data too, as a block behind the line of their event.")
]
StopWithReader: TypeAlias = Annotated[
    bool,
    typer.Option(
        "--stop-with-reader", help="Stop, with the laser off, when the program that reads --events /dev/fd/N ends."
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class StreamOptions:
    """Values of these options.

    Attributes
    ----------
    path, frames, stop_with_reader
        See the options.

    Raises
    ------
    ConfigError
        If one of the others is given without ``--events``.
    """

    path: Path | None = None
    frames: bool = False
    stop_with_reader: bool = False

    def __post_init__(self) -> None:
        for name, given in (("--event-frames", self.frames), ("--stop-with-reader", self.stop_with_reader)):
            if given and self.path is None:
                raise ConfigError(f"{name} says how events are sent, and none are; add --events, or leave it out")
        if self.stop_with_reader and self.path is not None and not self.path.is_relative_to("/dev/fd"):
            raise ConfigError(
                f"--stop-with-reader: the reader of {self.path} may come and go; it needs a pipe, --events /dev/fd/N"
            )

    @contextmanager
    def opened(self, configuration: Configuration) -> Iterator[EventStream | None]:
        """The stream of a run, closed at the end; None where none is wanted; `RecordError` if it cannot be opened."""
        if self.path is None:
            yield None
            return
        from markerseek.records.stream import EventStream

        with EventStream(self.path, configuration, frames=self.frames) as stream:
            yield stream

    @contextmanager
    def stopping(self, stream: EventStream | None) -> Iterator[None]:
        """Send this process SIGTERM when the reader of the stream from `opened` ends, where that is wanted."""
        if stream is None or not self.stop_with_reader:
            yield
            return
        over = threading.Event()
        # A signal, so that the run is stopped in one way only; the thread does nothing but wait.
        thread = threading.Thread(target=_terminate_without_reader, args=(stream.fileno(), over), daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


_LOOK_S = 0.05
"""Longest time until the waiting thread sees that the run is over, in seconds; the reader's end wakes it at once."""


def _terminate_without_reader(descriptor: int, over: threading.Event) -> None:
    poller = select.poll()
    # The write end of a pipe reports POLLERR, which is always asked for, when its last reader is gone.
    poller.register(descriptor, 0)
    while not over.is_set():
        if poller.poll(_LOOK_S * 1e3):
            os.kill(os.getpid(), signal.SIGTERM)
            return
