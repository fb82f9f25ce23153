"""Runs the searches that OpenIGTLink clients ask for, and sends what they show."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Collection, Iterable, Iterator
from typing import Literal, TypeVar

from markerseek.bridges.child import ChildRun
from markerseek.bridges.igtl.commands import CommandAnswer, Request, search_request
from markerseek.bridges.igtl.peer import IPAddress
from markerseek.bridges.igtl.server import IgtlServer
from markerseek.bridges.igtl.streams import Stream, Streams
from markerseek.bridges.recordings import Recording
from markerseek.bridges.searches import Searches
from markerseek.core import ConfigError, RecordError, SearchError
from markerseek.records.journal import JournalItem
from markerseek.runs import KnownRegistration

ALIVE_S = 1.0
"""Time from one sign of life to the next, in seconds."""


class SearchService:
    """The server, and one search at a time.

    ``searches``: None where a recording is played, and no search can be asked for. ``registration``: of the da Vinci
    system to the probe, to be shown. ``on_note``: receives sentences for the terminal.
    """

    def __init__(
        self,
        searches: Searches | None,
        *,
        recording: str | None = None,
        registration: KnownRegistration | None = None,
        version: Literal[1, 2] = 2,
        allowed: Collection[IPAddress] = (),
        on_note: Callable[[str], None],
    ) -> None:
        self._searches, self._on_note = searches, on_note
        self._streams = Streams(recording=recording, registration=registration)
        self.server = IgtlServer(on_request=self._requested, allowed=allowed, version=version, on_note=on_note)
        self._following: asyncio.Task[None] | None = None
        self._alive: asyncio.Task[None] | None = None
        self._publish(self._streams.idle())

    async def open(self, host: str, port: int) -> int:
        """Serve, and return the port; errors as of `IgtlServer.open`."""
        taken = await self.server.open(host, port)
        self._alive = asyncio.create_task(self._live())
        return taken

    async def close(self) -> None:
        """Stop the search that runs, wait for its end, and end all connections."""
        if self._searches is not None:
            self._searches.cancel()
        try:
            if self._following is not None:
                await self._following
        finally:
            if self._alive is not None:
                self._alive.cancel()
            await self.server.close()

    def _publish(self, streams: Iterable[Stream]) -> None:
        for stream in streams:
            self.server.publish(stream, metadata=self._streams.metadata)

    async def _live(self) -> None:
        while True:
            await asyncio.sleep(ALIVE_S)
            self._publish([self._streams.status])

    def _requested(self, request: Request) -> CommandAnswer:
        match request.name:
            case "StartSearch":
                return self._start(request)
            case "StopSearch":
                return self._stop(request)
        raise ConfigError(f"there is no command {request.name[:80]!r}; there are StartSearch and StopSearch")

    def _start(self, request: Request) -> CommandAnswer:
        if self._searches is None:
            raise ConfigError("this bridge plays a recording; start markerseek igtl without --play to search")
        wanted = search_request(request.values)
        if self._following is not None and not self._following.done():
            return CommandAnswer(done=False, sentence="a search is running; send StopSearch, or wait for its end")
        try:
            child = self._searches.start(wanted, asked_by=f"an OpenIGTLink client, {request.client}")
        except SearchError as refusal:
            return CommandAnswer(done=False, sentence=str(refusal))
        self._begin()
        self._following = asyncio.create_task(self._follow(child))
        return CommandAnswer(done=True, sentence="a search has begun; SearchState and PaSearch tell of it")

    async def play(self, recording: Recording, *, pace: float) -> None:
        """Send a recording once, with its own timing.

        ``pace``: real seconds per second of the recording; 0 as fast as images can be made.
        """
        loop = asyncio.get_running_loop()
        self._begin()
        began_s = loop.time()
        async for after_s, item in _each(recording.items()):
            await asyncio.sleep(began_s + pace * after_s - loop.time())
            await self._show(item)
        self._publish(self._streams.ended(recording.outcome))

    def _begin(self) -> None:
        self._publish(self._streams.started())

    def _stop(self, request: Request) -> CommandAnswer:
        if request.values:
            raise ConfigError(f"StopSearch has no {next(iter(request.values))}; send its name alone")
        if self._searches is not None and self._searches.cancel():
            return CommandAnswer(done=True, sentence="the search is being stopped")
        return CommandAnswer(done=False, sentence="no search is running")

    async def _follow(self, child: ChildRun) -> None:
        """Send what a search shows, to its end."""
        try:
            async for item in _each(child.items()):
                await self._show(item)
        except RecordError as problem:
            self._on_note(str(problem))
            child.stop()
        except BaseException:
            # A defect here must not leave a search behind that nobody watches.
            child.stop()
            raise
        outcome = await asyncio.to_thread(child.outcome)
        self._on_note(outcome.message)
        self._publish(self._streams.ended(outcome))

    async def _show(self, item: JournalItem) -> None:
        # In a thread: an image takes milliseconds, in which no client must wait.
        self._publish(await asyncio.to_thread(self._streams.after, item))


_Item = TypeVar("_Item")


async def _each(items: Iterator[_Item]) -> AsyncIterator[_Item]:
    """Items that are waited for in a thread, so that the event loop is not held up."""
    while (item := await asyncio.to_thread(next, items, None)) is not None:
        yield item
