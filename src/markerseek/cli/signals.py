"""What ends a command from outside: SIGINT, SIGTERM and SIGHUP.

The rig is stopped, the laser disarmed, the journal closed. The heartbeat (`markerseek.cli.heartbeat`) sends SIGTERM.
"""

from __future__ import annotations

import io
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, NoReturn, TypeAlias

import typer

from markerseek.cli import hung
from markerseek.cli.terminal import print_json, print_warning
from markerseek.core import ConfigError

STOPPING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a command."""

_BY = {
    # Ctrl-C, and STOP on the page or from another computer.
    signal.SIGINT: "the user",
    signal.SIGTERM: "another program (SIGTERM)",
    signal.SIGHUP: "the end of its terminal (SIGHUP)",
}

_AGAIN_S = 1e-3
"""Time until a stop that was lost is raised again, in seconds."""


class StoppedBySignal(KeyboardInterrupt):
    """Raised by a signal; the interrupted code cleans up, as after Ctrl-C.

    ``by``: who stopped it, in words. ``exit_code``: exit code of the process, 128 + signal number.
    """

    def __init__(self, number: int) -> None:
        self.by = _BY[signal.Signals(number)]
        self.exit_code = 128 + number
        super().__init__(self.by)


class Stopped(SystemExit):
    """Ends the command after a signal whose message has been printed."""


def end_stopped(stop: StoppedBySignal, *, as_json: bool, kept: Path | None, resume: str | None = None) -> NoReturn:
    """Print that the rig was stopped and how to continue, and end the command.

    ``kept``: file that holds what was measured. ``resume``: command that continues.
    """
    print_warning(f"stopped by {stop.by}: the laser is disarmed, and the probe stays where it was")
    if resume is not None:
        print_warning(f"continue with: {resume}")
    if as_json:
        said = {"error": f"stopped by {stop.by}", "kind": "Stopped", "kept": None if kept is None else str(kept)}
        try:
            print_json(said)
        except OSError:
            # The terminal has gone; what Python still holds for it would fail again at the end.
            sys.stdout = io.StringIO()
    raise Stopped(stop.exit_code) from None


def heeded() -> list[signal.Signals]:
    """Return the signals that end this command: SIGHUP is none of them where nohup ignores it."""
    return [each for each in STOPPING if signal.getsignal(each) is not signal.SIG_IGN]


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Raise `StoppedBySignal` at the first signal, and ignore further ones until the process ends."""
    stopping = False

    def stop(number: int, _frame: FrameType | None) -> None:
        nonlocal stopping
        stopping = True
        for each in STOPPING:
            # A second Ctrl-C must not interrupt the code that disarms the laser.
            signal.signal(each, signal.SIG_IGN)
        raise StoppedBySignal(number)

    def lost(dropped: sys.UnraisableHookArgs) -> None:
        """Raise a stop again that Python has dropped, as it drops all exceptions of destructors and weak references."""
        if not isinstance(dropped.exc_value, StoppedBySignal):
            hook(dropped)
            return
        number = dropped.exc_value.exit_code - 128
        # A timer, because the signal itself would be handled in this function, where it would be dropped as well.
        signal.signal(signal.SIGALRM, lambda _alarm, frame: stop(number, frame))
        signal.setitimer(signal.ITIMER_REAL, _AGAIN_S)

    hung.watch_stop()
    hook = sys.unraisablehook
    sys.unraisablehook = lost
    before = {each: signal.getsignal(each) for each in (*STOPPING, signal.SIGALRM)}
    for each in heeded():
        signal.signal(each, stop)
    try:
        yield
    finally:
        sys.unraisablehook = hook
        signal.setitimer(signal.ITIMER_REAL, 0)
        # After a stop the devices are still to be closed, which nothing may interrupt.
        if not stopping:
            for each, handler in before.items():
                signal.signal(each, handler)


@contextmanager
def noted_signals() -> Iterator[list[int]]:
    """Yield a list that receives the number of each signal: a server ends between two messages, not inside of one."""
    noted: list[int] = []
    before = {each: signal.signal(each, lambda number, _frame: noted.append(number)) for each in heeded()}
    try:
        yield noted
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


Heartbeat: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        hidden=True,
        help="For a bridge: stop, with the laser off, when no byte comes from this pipe, /dev/fd/N, for 4 s, or its "
        "writer ends.",
    ),
]
"""Option of the commands that bridges run; `markerseek.cli.heartbeat` watches the pipe from the first line on."""


ImageRingFile: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        hidden=True,
        help="For a bridge: hand the image of each acquisition on in this file in memory, /dev/fd/N.",
    ),
]
"""Option of the commands of one search that bridges run; see `markerseek.runs.ImageRing`."""


def require_pipe(heartbeat: Path | None) -> None:
    """Refuse a heartbeat that is no pipe."""
    if heartbeat is not None and not heartbeat.is_fifo():
        raise ConfigError(f"--heartbeat {heartbeat}: it is no pipe; name one that is open, /dev/fd/N")


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchOptions:
    """Options of the commands that are run by other programs: the file that they follow, and their heartbeat."""

    events: Annotated[
        Path | None,
        typer.Option(
            help="Write the events of a run without a journal to this new file, for programs that follow it; see "
            "'markerseek journal follow'."
        ),
    ] = None
    heartbeat: Heartbeat = None
    image_ring: ImageRingFile = None

    def __post_init__(self) -> None:
        require_pipe(self.heartbeat)
