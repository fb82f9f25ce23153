"""Serves OpenIGTLink clients: who may connect, the searches they ask for, what they are sent."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import time
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Literal

from markerseek.bridges.child import Searches, SearchOptions
from markerseek.bridges.followed import RegistrationSource
from markerseek.bridges.igtl.commands import (
    CommandAnswer,
    Request,
    answer_message,
    is_command,
    read_request,
    search_request,
)
from markerseek.bridges.igtl.peer import LOOPBACK, SLOW_S, IPAddress, Peer, plain_address
from markerseek.bridges.igtl.streams import StreamMessage, Streams
from markerseek.bridges.outcome import Outcome
from markerseek.bridges.run_images import PicturedItem
from markerseek.core import ConfigError, SearchError, plain
from markerseek.wire import igtl

ALIVE_S = 1.0
"""Time from one sign of life to the next, in seconds."""

FOLLOWED_S = 0.1
"""Time from one look at the registration to the next, in seconds."""


class SearchService:
    """The server, and one search at a time.

    ``options``: of the searches. ``registration``: of the da Vinci system to the probe, to be shown, and withdrawn when
    it holds no longer. ``on_note``: receives sentences for the terminal.
    """

    def __init__(
        self,
        options: SearchOptions,
        *,
        registration: RegistrationSource | None = None,
        version: Literal[1, 2] = 2,
        allowed: Collection[IPAddress] = (),
        on_note: Callable[[str], None],
    ) -> None:
        self._on_note = on_note
        self._tasks: list[asyncio.Task[None]] = []
        self._loop: asyncio.AbstractEventLoop | None = None
        self._searches = Searches(options, on_start=self._started, on_item=self._seen, on_end=self._ended)
        self._registration = registration
        self._streams = Streams(registration=None if registration is None else registration.view)
        self.server = IgtlServer(on_request=self._requested, allowed=allowed, version=version, on_note=on_note)
        self._publish(self._streams.idle())

    async def open(self, host: str, port: int) -> int:
        """Serve, and return the port; errors as of `IgtlServer.open`."""
        self._loop = asyncio.get_running_loop()
        taken = await self.server.open(host, port)
        self._tasks = [asyncio.create_task(self._live()), asyncio.create_task(self._follow_registration())]
        return taken

    async def close(self) -> None:
        """Stop the search that runs, wait for its end, and end all connections."""
        try:
            await asyncio.to_thread(self._searches.close)
        finally:
            for task in self._tasks:
                task.cancel()
            await self.server.close()

    def _publish(self, streams: Iterable[StreamMessage]) -> None:
        for stream in streams:
            self.server.publish(stream, metadata=self._streams.metadata)

    def _publish_soon(self, streams: Iterable[StreamMessage]) -> None:
        """Publish from the thread of a search, which only a service that was opened has."""
        assert self._loop is not None  # noqa: S101  a client asks for each search
        self._loop.call_soon_threadsafe(self._publish, streams)

    async def _live(self) -> None:
        while True:
            await asyncio.sleep(ALIVE_S)
            self._publish([self._streams.status])

    async def _follow_registration(self) -> None:
        while self._registration is not None:
            if (view := self._registration.view) is not self._streams.registration:
                self._publish(self._streams.registered(view))
                self._on_note(view.sentence)
            await asyncio.sleep(FOLLOWED_S)

    def _started(self, _process_id: int) -> None:
        self._publish(self._streams.started())

    def _seen(self, item: PicturedItem) -> None:
        self._publish_soon(self._streams.after(item))

    def _ended(self, outcome: Outcome) -> None:
        self._on_note(outcome.message)
        self._publish_soon(self._streams.ended(outcome))

    def _requested(self, request: Request) -> CommandAnswer:
        match request.name:
            case "StartSearch":
                self._searches.start(
                    search_request(request.values), asked_by=f"an OpenIGTLink client, {request.client}"
                )
                return CommandAnswer(done=True, sentence="a search has begun; SearchState and PaSearch report it")
            case "StopSearch":
                if request.values:
                    raise ConfigError(f"StopSearch has no {next(iter(request.values))}; send its name alone")
                done, sentence = self._searches.stop()
                return CommandAnswer(done=done, sentence=sentence)
        raise ConfigError(f"there is no command {request.name[:80]!r}; there are StartSearch and StopSearch")


MAX_CLIENTS = 16
"""Most clients that are served. A further client can send StopSearch only, and is disconnected after `SLOW_S`."""

_FULL = f"{MAX_CLIENTS} clients are served, and no more; end one of them (StopSearch is taken from any client)"


class IgtlServer:
    """Serves all clients; use it in one event loop.

    A new client gets the newest message of each stream at once. For each client only the newest message of a stream
    waits. Metadata hold a ``sequence`` number of each stream, which rises by one, so that a client can count what it
    lost.

    ``on_request``: carries out a command and answers, at once. ``allowed``: addresses of the other computers that may
    connect. ``version``: version of the header: with 1, for old clients, there are no metadata. ``on_note``: receives a
    sentence when a client comes, goes, or is refused.
    """

    def __init__(
        self,
        *,
        on_request: Callable[[Request], CommandAnswer],
        allowed: Collection[IPAddress] = (),
        version: Literal[1, 2] = 2,
        on_note: Callable[[str], None] = lambda _sentence: None,
    ) -> None:
        self._on_request = on_request
        self._version = version
        self._on_note = on_note
        self._allowed = frozenset(allowed)
        self._peers: set[Peer] = set()
        # All whose connection has not ended, served or refused.
        self._connected: set[Peer] = set()
        self._newest: dict[tuple[str, str], bytes] = {}
        self._sequences: dict[tuple[str, str], int] = {}
        self._server: asyncio.Server | None = None

    async def open(self, host: str, port: int) -> int:
        """Listen, and return the port, which port 0 leaves to the operating system."""
        loop = asyncio.get_running_loop()
        try:
            listening = self._listening(host, port)
            self._server = await loop.create_server(self._peer, sock=listening)
        except OSError as problem:
            if problem.errno == errno.EADDRINUSE:
                raise ConfigError(
                    f"port {port} of {host} is taken by another program; end that one, or name another `port`"
                ) from problem
            # getaddrinfo has its own error numbers, which os.strerror does not know.
            why = problem.strerror if isinstance(problem, socket.gaierror) else os.strerror(problem.errno or 0)
            raise ConfigError(f"{host}, port {port}: {why}; name another") from problem
        return int(listening.getsockname()[1])

    def _listening(self, host: str, port: int) -> socket.socket:
        """Return a socket at an address as the system reads it: "0", "127.1" and a name are addresses too."""
        try:
            # A name can have several: IPv4 first, which clients expect.
            family, _, _, _, place = min(socket.getaddrinfo(host, port, type=socket.SOCK_STREAM))
        except UnicodeError:
            raise OSError(errno.EINVAL, "no address") from None
        if plain_address(str(place[0])) != LOOPBACK and not self._allowed:
            raise ConfigError(
                f"`host={host}` is {place[0]}, which other computers reach, and OpenIGTLink has no passwords; name "
                "each computer that may connect with `allowed=ADDRESS`"
            )
        return socket.create_server(place, family=family)

    async def close(self) -> None:
        """End all connections, and return when none is left."""
        if self._server is not None:
            self._server.close()
        for peer in tuple(self._connected):
            peer.drop("the bridge ends")
        while self._connected:
            await asyncio.sleep(0)

    def publish(self, stream: StreamMessage, *, metadata: Mapping[str, str]) -> None:
        """Send a message to all clients.

        ``stream``: its device, content and time. ``metadata``: sent with it, beside the sequence number and those of
        the stream.
        """
        key = stream.content.kind, stream.device
        self._sequences[key] = self._sequences.get(key, 0) + 1
        data = igtl.encode(
            igtl.Message(
                device=stream.device,
                content=stream.content,
                # The time of day is part of the protocol.
                time_s=time.time() if stream.time_s is None else stream.time_s,  # noqa: TID251
                metadata={"sequence": str(self._sequences[key]), **metadata, **stream.metadata},
                version=self._version,
            )
        )
        self._newest[key] = data
        for peer in tuple(self._peers):
            peer.put((*key, 0), data)

    def _peer(self) -> Peer:
        return Peer(on_open=self._opened, on_message=self._received, on_close=self._lost)

    def _opened(self, peer: Peer) -> None:
        self._connected.add(peer)
        if peer.address != LOOPBACK and peer.address not in self._allowed:
            self._on_note(f"{peer.name}: refused, it is none of the computers that may connect")
            peer.drop("it is none of the computers that may connect")
            return
        if len(self._peers) >= MAX_CLIENTS:
            self._on_note(f"{peer.name}: refused: {_FULL}")
            peer.refuse(_FULL)
            asyncio.get_running_loop().call_later(SLOW_S, peer.drop, _FULL)
            return
        self._peers.add(peer)
        self._on_note(f"{peer.name}: connected")
        for key, data in self._newest.items():
            peer.put((*key, 0), data)

    def _lost(self, peer: Peer, reason: str) -> None:
        self._connected.discard(peer)
        if peer in self._peers:
            self._peers.discard(peer)
            self._on_note(f"{peer.name}: gone: {reason}")

    def _received(self, peer: Peer, message: igtl.Message) -> None:
        if not is_command(message):
            # Slicer and PLUS also send what nobody asked for.
            return
        try:
            request = read_request(message, client=peer.name)
            taken = peer in self._peers or request.name == "StopSearch"
            answer = self._on_request(request) if taken else CommandAnswer(done=False, sentence=_FULL)
        except (ConfigError, SearchError) as refusal:
            answer = CommandAnswer(done=False, sentence=plain(str(refusal)))
        now_s = time.time()  # noqa: TID251
        peer.answer(igtl.encode(answer_message(message, answer, time_s=now_s)))
