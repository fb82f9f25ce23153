"""A stop that hangs: a driver whose call does not return cannot keep the process alive after Ctrl-C.

After the first signal a run switches the laser off, stops the stage, and ignores further signals. Where that does not
end, a thread says what is waited for, and then ends the process; its supervisor makes laser and stage safe.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import NoReturn

SAID_S = 1.5
"""Time that a stop may take until a line says what is waited for, in seconds."""

ENDED_S = 8.0
"""Time that a stop may take until the process is ended, in seconds."""


_STANDARD_ERROR = 2

_END: list[Callable[[str, int], NoReturn]] = []
"""How the process may be ended; empty if other things than one command run in it, or it is watched already."""


_OVER = threading.Event()
"""Set once the command is over: its devices are closed, and a signal is meant for whatever runs then."""


@contextmanager
def ended_by(end: Callable[[str, int], NoReturn]) -> Iterator[None]:
    """Allow to end this process, which runs one command only, until the end of the block.

    ``end``: prints a message, and ends the process at once with an exit code.
    """
    _OVER.clear()
    _END[:] = [end]
    try:
        yield
    finally:
        _OVER.set()
        _END.clear()


def watch_stop() -> None:
    """Begin to watch the process, once: from the first signal on, its end may take `ENDED_S`."""
    if not _END:
        return
    end = _END.pop()
    signals, written = os.pipe()
    os.set_blocking(written, False)
    # Python's own handler waits until the main thread runs Python again; the number of the signal is written at once.
    signal.set_wakeup_fd(written, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(signals, end), name="watch a stop", daemon=True).start()


def _watch(signals: int, end: Callable[[str, int], NoReturn]) -> None:
    number = 0
    while number not in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        number = os.read(signals, 1)[0]
    main = threading.main_thread()
    if _OVER.wait(SAID_S):
        return
    left_s = ENDED_S - SAID_S
    said = f"stopping takes long: it waits {_place(main)}; the process ends in {left_s:g} s in any case"
    with suppress(OSError):
        os.write(_STANDARD_ERROR, f"warning: {said}\n".encode())
    if not _OVER.wait(left_s):
        end(
            f"the stop took more than {ENDED_S:g} s: it waits {_place(main)}, so the process was ended; a supervisor, "
            "if the rig has one, makes laser and stage safe; check both",
            128 + number,
        )


def _place(thread: threading.Thread) -> str:
    """Return where a thread is: function, file and line."""
    frame = sys._current_frames().get(thread.ident or 0)  # noqa: SLF001  the documented way
    if frame is None:
        return "at its end"
    return f"in {frame.f_code.co_name}() of {frame.f_code.co_filename}, line {frame.f_lineno}"
