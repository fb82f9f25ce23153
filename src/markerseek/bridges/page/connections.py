"""The connections of the page: those that have not shown its token are few, and do not stay.

Whoever can reach the port can open connections, and say nothing on them. Without a bound they would take all the files
that the process may open, and STOP would find none left. Here the oldest of them makes room for the newest, so that a
browser that opens the page or sends STOP is always let in.
"""

from __future__ import annotations

import errno
import os
import socket
import time
from contextlib import suppress
from typing import TypeAlias

MAX_STRANGERS = 128
"""Most connections that have not shown the token."""

STRANGER_S = 5.0
"""Time in which a connection must have shown the token, in seconds."""

MAX_KNOWN = 256
"""Most connections that have shown the token: those of 16 tabs, and those that a browser keeps for a while."""

BATCH = 16
"""Most connections that are accepted before those that are there are served: far fewer than `MAX_STRANGERS`, so that a
newcomer is served before it is the oldest."""

_FULL = frozenset({errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM})
"""Errors of a process or a system that has no room for another connection."""

_Peer: TypeAlias = tuple[str, int]
"""Address and port of the other end."""


class Listener(socket.socket):
    """A listening socket that bounds the connections of those who have not shown the token.

    ``listening``: the socket, which is taken over.
    """

    def __init__(self, listening: socket.socket) -> None:
        super().__init__(fileno=listening.detach())
        self._strangers: dict[_Peer, tuple[socket.socket, float]] = {}
        """Connections and when they came, the oldest first."""
        self._known: dict[_Peer, socket.socket] = {}
        self._accepted = 0
        # Given up for a moment to refuse a connection where no file can be opened: it would come back at once.
        self._spare = os.open(os.devnull, os.O_RDONLY)

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        """Accept a connection; `BlockingIOError` if none waits, or others are to be served first."""
        self._accepted += 1
        if self._accepted > BATCH:
            self._accepted = 0
            raise BlockingIOError
        try:
            connection, address = super().accept()
        except OSError as problem:
            self._accepted = 0
            if problem.errno not in _FULL:
                raise
            self._refuse()
            raise BlockingIOError from problem
        peer = (str(address[0]), int(address[1]))
        if len(self._strangers) >= MAX_STRANGERS:
            self._forget()
        if len(self._strangers) >= MAX_STRANGERS:
            self._drop(next(iter(self._strangers)))
        self._strangers[peer] = (connection, time.monotonic())
        return connection, address

    def admit(self, peer: _Peer) -> bool:
        """Note that a connection has shown the token; returns whether there is room for it."""
        if peer in self._known:
            return True
        if len(self._known) >= MAX_KNOWN:
            self._forget()
        if len(self._known) >= MAX_KNOWN:
            return False
        connection, _ = self._strangers.pop(peer, (None, 0.0))
        if connection is not None:
            self._known[peer] = connection
        return True

    def drop_late(self) -> None:
        """Drop the connections that have not shown the token in time."""
        self._forget()
        now_s = time.monotonic()
        for peer in [peer for peer, (_, came_s) in self._strangers.items() if now_s - came_s > STRANGER_S]:
            self._drop(peer)

    def close(self) -> None:
        """Close it; the connections belong to whoever accepted them."""
        if self._spare >= 0:
            os.close(self._spare)
            self._spare = -1
        super().close()

    def _forget(self) -> None:
        """Forget the connections that are closed."""
        self._strangers = {peer: each for peer, each in self._strangers.items() if each[0].fileno() >= 0}
        self._known = {peer: each for peer, each in self._known.items() if each.fileno() >= 0}

    def _drop(self, peer: _Peer) -> None:
        """End the connection of a stranger: whoever serves it reads its end, and closes it."""
        connection, _ = self._strangers.pop(peer)
        with suppress(OSError):
            connection.shutdown(socket.SHUT_RDWR)

    def _refuse(self) -> None:
        """Make room where no file can be opened: the oldest stranger goes, or else the newcomer."""
        self._forget()
        if self._strangers:
            self._drop(next(iter(self._strangers)))
            return
        os.close(self._spare)
        try:
            with suppress(OSError):
                super().accept()[0].close()
        finally:
            self._spare = os.open(os.devnull, os.O_RDONLY)
