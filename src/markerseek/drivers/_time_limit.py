"""Ends code of somebody else that takes too long: the import of a foreign driver, its constructor, its contract."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from markerseek.core import DeviceTimeoutError

MAX_S = 30.0
"""Longest time for one of them, in seconds. None of them may move the stage, so nothing needs that long."""


class _TooLong(BaseException):
    """Raised in the code that takes too long; no `Exception`, which that code could swallow."""


@contextmanager
def time_limit(what: str) -> Iterator[None]:
    """Raise `DeviceTimeoutError` if the block takes longer than `MAX_S`.

    A signal ends it, which interrupts sleeping and waiting for a line, a socket or a lock, but no library in C that
    never returns. Only the main thread gets signals: in another there is no limit. ``what``: begins the message.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    ended = False

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        if not ended:
            raise _TooLong

    limit_s = MAX_S
    # Not the alarm clock of the process (SIGALRM), by which a command that was told to stop is told again.
    before = signal.signal(signal.SIGUSR2, interrupt)
    timer = threading.Timer(limit_s, signal.pthread_kill, (threading.main_thread().ident, signal.SIGUSR2))
    timer.daemon = True
    timer.start()
    try:
        yield
    except _TooLong as problem:
        raise DeviceTimeoutError(
            f"{what} takes longer than {limit_s:g} s; check the device, and give each wait of the driver a limit"
        ) from problem
    finally:
        ended = True
        timer.cancel()
        timer.join()
        signal.signal(signal.SIGUSR2, before)
