"""The heartbeat of a command that another program runs: without it the command ends, whatever it does just then.

It is watched from the first lines of the process to its last: while libraries are imported, while a question stands on
the terminal, while devices are opened, in the run, and while its result is drawn. Only the standard library is used
here, because nothing else is imported by then.
"""

from __future__ import annotations

import os
import select
import signal
import stat
import threading
import time
from collections.abc import Sequence
from contextlib import suppress

OPTION = "--heartbeat"

SILENT_S = 4.0
"""Longest time without a beat, in seconds: a search then has one more to stop."""

ORDERLY_S = 1.0
"""Time for an orderly end, in seconds; what hangs then is ended all the same."""

_ENDED = b"stopped: the program that started this command has ended, or hangs\n"
"""What is said where no run says it."""


def watch_heartbeat(arguments: Sequence[str]) -> None:
    """End this process when the heartbeat that its arguments name is late or ends; do nothing if they name none."""
    path = _named(arguments)
    if path is None:
        return
    try:
        beats = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    except OSError:
        # The option itself is refused later, with its cure.
        return
    if not stat.S_ISFIFO(os.fstat(beats).st_mode):
        os.close(beats)
        return
    threading.Thread(target=_terminate_without_beats, args=[beats], name="heartbeat", daemon=True).start()


def _named(arguments: Sequence[str]) -> str | None:
    """Return the pipe that the arguments of a command name."""
    for number, word in enumerate(arguments):
        name, separator, value = word.partition("=")
        if name == OPTION:
            return value if separator else next(iter(arguments[number + 1 :]), None)
    return None


def _terminate_without_beats(beats: int) -> None:
    poller = select.poll()
    poller.register(beats, select.POLLIN)
    beat_s = time.monotonic()
    # A pipe without a writer can be read, and holds nothing.
    while poller.poll(1e3 * max(0.0, beat_s + SILENT_S - time.monotonic())) and os.read(beats, 4096):
        beat_s = time.monotonic()
    # Whatever hangs: the supervisor makes laser and stage safe, as after any death of a search.
    ending = threading.Timer(ORDERLY_S, os._exit, [128 + signal.SIGTERM])
    ending.daemon = True
    ending.start()
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        with suppress(OSError):
            os.write(2, _ENDED)
    # A signal, so that a run is stopped in one way only.
    os.kill(os.getpid(), signal.SIGTERM)
