"""The OpenIGTLink server: one stream of messages to all clients, and their commands."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import time
from collections.abc import Callable, Mapping
from typing import Literal

from markerseek.bridges.igtl.commands import CommandAnswer, Request, answer_message, is_command, read_request
from markerseek.bridges.igtl.peer import Peer
from markerseek.bridges.igtl.streams import Stream
from markerseek.core import ConfigError
from markerseek.wire import igtl

PORT = 18945
"""Usual port; PLUS has 18944."""

MOST_CLIENTS = 16


class IgtlServer:
    """Serves all clients; use it in one event loop.

    A new client gets the newest message of each stream at once. For each client only the newest message of a stream
    waits. Metadata hold a ``sequence`` number of each stream, which rises by one, so that a client can count what it
    lost.

    Parameters
    ----------
    on_request
        Carries out a command and answers, at once.
    version
        Version of the header: with 1, for old clients, there are no metadata.
    on_note
        Receives a sentence when a client comes, goes, or is refused.
    """

    def __init__(
        self,
        *,
        on_request: Callable[[Request], CommandAnswer],
        version: Literal[1, 2] = 2,
        on_note: Callable[[str], None] = lambda _sentence: None,
    ) -> None:
        self._on_request, self._version, self._on_note = on_request, version, on_note
        self._peers: set[Peer] = set()
        self._newest: dict[tuple[str, str], bytes] = {}
        self._sequences: dict[tuple[str, str], int] = {}
        self._server: asyncio.Server | None = None

    async def open(self, host: str, port: int) -> int:
        """Listen, and return the port, which port 0 leaves to the operating system.

        Raises
        ------
        ConfigError
            If the port is taken or the address is none of this computer.
        """
        loop = asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(self._peer, host, port)
        except OSError as problem:
            if problem.errno == errno.EADDRINUSE:
                raise ConfigError(
                    f"port {port} of {host} is taken by another program; end that one, or name another --port"
                ) from problem
            # asyncio's own text is a paragraph; the number of a name that is not known is none of the system's errors.
            why = problem.strerror if isinstance(problem, socket.gaierror) else os.strerror(problem.errno or 0)
            raise ConfigError(f"{host}, port {port}: {why}; name another") from problem
        return int(self._server.sockets[0].getsockname()[1])

    async def close(self) -> None:
        """End all connections."""
        if self._server is not None:
            self._server.close()
        for peer in tuple(self._peers):
            peer.drop("the bridge ends")
        if self._server is not None:
            await self._server.wait_closed()

    def publish(self, stream: Stream, *, metadata: Mapping[str, str]) -> None:
        """Send a message to all clients.

        Parameters
        ----------
        stream
            Its device and content.
        metadata
            Sent with it, beside the sequence number.
        """
        key = stream.content.kind, stream.device
        self._sequences[key] = self._sequences.get(key, 0) + 1
        data = igtl.encode(
            igtl.Message(
                device=stream.device,
                content=stream.content,
                time_s=time.time(),  # noqa: TID251  the time of day is part of the protocol
                metadata={"sequence": str(self._sequences[key]), **metadata},
                version=self._version,
            )
        )
        self._newest[key] = data
        for peer in tuple(self._peers):
            peer.put((*key, 0), data)

    def forget(self, *devices: str) -> None:
        """Send the streams of these devices to new clients no more, until they are published again."""
        for key in [key for key in self._newest if key[1] in devices]:
            del self._newest[key]

    def _peer(self) -> Peer:
        return Peer(on_open=self._opened, on_message=self._received, on_close=self._closed)

    def _opened(self, peer: Peer) -> None:
        if len(self._peers) >= MOST_CLIENTS:
            self._on_note(f"{peer.name}: refused, {MOST_CLIENTS} clients are served already")
            peer.drop(f"{MOST_CLIENTS} clients are served already")
            return
        self._peers.add(peer)
        self._on_note(f"{peer.name}: connected")
        for key, data in self._newest.items():
            peer.put((*key, 0), data)

    def _closed(self, peer: Peer, reason: str) -> None:
        if peer in self._peers:
            self._peers.remove(peer)
            self._on_note(f"{peer.name}: gone: {reason}")

    def _received(self, peer: Peer, message: igtl.Message) -> None:
        if not is_command(message):
            # Slicer and PLUS also send what nobody asked for.
            return
        try:
            request = read_request(message)
            answer = self._on_request(request)
        except ConfigError as refusal:
            answer = CommandAnswer(done=False, sentence=str(refusal))
        now_s = time.time()  # noqa: TID251
        peer.answer(igtl.encode(answer_message(message, answer, time_s=now_s)))
