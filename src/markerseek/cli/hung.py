"""A stop that hangs: a driver whose call does not return cannot keep the process alive after Ctrl-C.

After the first signal a run switches the laser off, stops the stage, and ignores further signals. Where that does not
end, a thread says what is waited for, and then ends the process; its supervisor makes laser and stage safe.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

SAID_S = 1.5
"""Time that a stop may take until a line says what is waited for, in seconds."""

ENDED_S = 8.0
"""Time that a stop may take until the process is ended, in seconds."""


_STANDARD_ERROR = 2

_END: list[Callable[[str, int], NoReturn]] = []
"""How the process may be ended; empty if other things than one command run in it."""


def may_end_by(end: Callable[[str, int], NoReturn]) -> None:
    """Allow to end this process, which runs one command only.

    ``end``: prints a message, and ends the process at once with an exit code.
    """
    _END[:] = [end]


def watch_stop() -> None:
    """Begin to watch the process: from the first signal on, its end may take `ENDED_S`."""
    if not _END:
        return
    signals, written = os.pipe()
    os.set_blocking(written, False)
    # Python's own handler waits until the main thread runs Python again; the number of the signal is written at once.
    signal.set_wakeup_fd(written, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(signals, _END[0]), name="watch a stop", daemon=True).start()


def _watch(signals: int, end: Callable[[str, int], NoReturn]) -> None:
    number = 0
    while number not in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        number = os.read(signals, 1)[0]
    main = threading.main_thread()
    main.join(SAID_S)
    if not main.is_alive():
        return
    left_s = ENDED_S - SAID_S
    said = f"stopping takes long: it waits {_place(main)}; the process ends in {left_s:g} s in any case"
    with suppress(OSError):
        os.write(_STANDARD_ERROR, f"warning: {said}\n".encode())
    main.join(left_s)
    if main.is_alive():
        end(
            f"the stop took more than {ENDED_S:g} s: it waits {_place(main)}, so the process was ended; a supervisor, "
            "if the rig has one, makes laser and stage safe; check both",
            128 + number,
        )


def _place(thread: threading.Thread) -> str:
    """Where a thread is: function, file and line."""
    frame = sys._current_frames().get(thread.ident or 0)  # noqa: SLF001  the documented way
    if frame is None:
        return "at its end"
    return f"in {frame.f_code.co_name}() of {frame.f_code.co_filename}, line {frame.f_lineno}"
