"""Ctrl-C, a closed terminal and a polite kill end a search alike: rig stopped, laser disarmed, journal closed."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_STOPPING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class StoppedBySignal(KeyboardInterrupt):
    """A signal came; the cleaning up is done by whoever is interrupted, as after Ctrl-C.

    Attributes
    ----------
    name
        "SIGINT" or the like.
    exit_code
        Of the process, as shells have it.
    """

    def __init__(self, number: int) -> None:
        self.name = signal.Signals(number).name
        self.exit_code = 128 + number
        super().__init__(self.name)


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Raise `StoppedBySignal` at the first signal, and ignore further ones while the rig is being stopped."""

    def stop(number: int, _frame: FrameType | None) -> None:
        for each in _STOPPING:
            signal.signal(each, signal.SIG_IGN)
        raise StoppedBySignal(number)

    before = {each: signal.getsignal(each) for each in _STOPPING}
    for each, handler in before.items():
        # Whoever started us under nohup wants to outlive the terminal.
        if handler is not signal.SIG_IGN:
            signal.signal(each, stop)
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)
