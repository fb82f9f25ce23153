"""A listening socket whose connections must show the token soon: others cannot keep the page from its viewers.

It stands below TLS and HTTP, so that it holds for a handshake, a header and a body that never end alike (decision 44).
"""

from __future__ import annotations

import asyncio
import os
import socket
import sys
from collections import Counter
from contextlib import suppress
from pathlib import Path
from typing import TypeAlias

Peer: TypeAlias = tuple[str, int]
"""Address and port of a client."""

UNPROVED_S = 5.0
"""Time in which a connection must show the token, in seconds."""

MAX_UNPROVED = 512
"""Most connections that have not shown it yet; a process may have 1024 files."""

AT_ONCE = 64
"""Most connections that are accepted before those that are there are looked at: an honest one, which shows the token
within a few turns of the event loop, is then never the oldest of `MAX_UNPROVED`."""


class Listener(socket.socket):
    """An IPv4 socket that listens; `accept` belongs to the event loop.

    ``address``: address of this computer, as numbers. ``port``: 0 takes any that is free. Raises `OSError` if the port
    is taken, or the address is not one of this computer.
    """

    def __init__(self, address: str, port: int) -> None:
        super().__init__(socket.AF_INET, socket.SOCK_STREAM)
        # Oldest first.
        self._unproved: dict[Peer, tuple[socket.socket, asyncio.TimerHandle]] = {}
        # A page that was just closed leaves its port for a minute otherwise.
        self.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self.bind((address, port))
            self.listen()
        except OSError:
            self.close()
            raise

    def listen(self, backlog: int = AT_ONCE) -> None:  # noqa: ARG002  asyncio has one number for two things
        """Listen, with a long queue: a connection that finds it full comes again after a second."""
        super().listen(1024)

    def accept(self) -> tuple[socket.socket, Peer]:
        """The next connection; where too many have not shown the token, the oldest of one address is ended."""
        connection, peer = super().accept()
        self.prove(peer)
        if len(self._unproved) >= MAX_UNPROVED:
            # Of the address that has most: one client cannot end the connections of another.
            ((most, _count),) = Counter(host for host, _port in self._unproved).most_common(1)
            self._end(next(each for each in self._unproved if each[0] == most))
        timer = asyncio.get_running_loop().call_later(UNPROVED_S, self._end, peer)
        self._unproved[peer] = (connection, timer)
        return connection, peer

    def prove(self, peer: Peer) -> None:
        """Note that a client has shown the token."""
        if peer in self._unproved:
            self._unproved.pop(peer)[1].cancel()

    def is_own_user(self, peer: Peer) -> bool:
        """Whether a program on this computer, of the user who serves, is at the other end; known on Linux only."""
        try:
            table = Path("/proc/net/tcp").read_text()
        except FileNotFoundError:
            return False
        # Its end of the connection is a row of the table with the user who owns it.
        ends = [_as_in_table(*peer), _as_in_table(*self.getsockname())]
        rows = (line.split() for line in table.splitlines()[1:])
        return any(row[1:3] == ends and int(row[7]) == os.getuid() for row in rows)

    def _end(self, peer: Peer) -> None:
        connection, timer = self._unproved.pop(peer)
        timer.cancel()
        # Not closed here: asyncio, which waits for it, sees its end. It may have ended by itself.
        with suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)


def _as_in_table(host: str, port: int) -> str:
    return f"{int.from_bytes(socket.inet_aton(host), sys.byteorder):08X}:{port:04X}"
