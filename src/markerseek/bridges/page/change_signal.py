"""Signals a change to the pages of all viewers, so that none of them waits for its timer."""

from __future__ import annotations

import asyncio
import weakref
from contextlib import suppress


class ChangeSignal:
    """One event of asyncio for each viewer, all set together."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        # Weak: a viewer who is gone waits no more.
        self._viewers: weakref.WeakSet[asyncio.Event] = weakref.WeakSet()

    def subscribe(self) -> asyncio.Event:
        """The event of a new viewer, who clears it himself; only in the event loop of the server."""
        self._loop = asyncio.get_running_loop()
        event = asyncio.Event()
        self._viewers.add(event)
        return event

    def tell(self) -> None:
        """Wake all viewers; by any thread, at any time."""
        if self._loop is not None:
            # A loop that is closed has no viewers.
            with suppress(RuntimeError):
                self._loop.call_soon_threadsafe(self._wake)

    def _wake(self) -> None:
        for each in self._viewers:
            each.set()
