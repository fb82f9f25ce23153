"""Connections to the page that have not shown the token: which are ended, and whose they are."""

from __future__ import annotations

import asyncio
import os
import socket
from contextlib import ExitStack

import pytest

from markerseek.bridges.page import listener
from markerseek.bridges.page.listener import Listener


class Scene(ExitStack):
    """A listener and its clients, in an event loop."""

    def __init__(self) -> None:
        super().__init__()
        self.listener = self.enter_context(Listener("127.0.0.1", 0))

    def connect(self, source: str = "127.0.0.1") -> socket.socket:
        """The client's end of a new connection that has been accepted."""
        client = self.enter_context(socket.create_connection(self.listener.getsockname(), source_address=(source, 0)))
        client.setblocking(False)
        self.enter_context(self.listener.accept()[0])
        return client


def ended(client: socket.socket) -> bool:
    try:
        return client.recv(1) == b""
    except BlockingIOError:
        return False


def test_26_8_the_oldest_of_the_address_with_most_connections_is_ended_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listener, "MAX_UNPROVED", 4)

    async def scene() -> list[bool]:
        with Scene() as here:
            clients = [here.connect("127.0.0.2"), *(here.connect("127.0.0.3") for _ in range(6))]
            return [ended(each) for each in clients]

    assert asyncio.run(scene()) == [False, True, True, True, False, False, False]


def test_26_8_a_connection_that_shows_no_token_is_ended_and_one_that_does_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(listener, "UNPROVED_S", 0.05)

    async def scene() -> tuple[bytes, bool]:
        with Scene() as here:
            known = here.connect()
            here.listener.prove(known.getsockname())
            # It comes later, so that the time of the other is over too.
            stranger = here.connect()
            return await asyncio.get_running_loop().sock_recv(stranger, 1), ended(known)

    assert asyncio.run(scene()) == (b"", False)


def test_26_10_only_programs_of_the_user_who_serves_are_own(monkeypatch: pytest.MonkeyPatch) -> None:
    with Listener("127.0.0.1", 0) as here, socket.create_connection(here.getsockname()) as client:
        assert here.is_own_user(client.getsockname())
        assert not here.is_own_user(("127.0.0.1", 1))
        monkeypatch.setattr(os, "getuid", lambda: 2**31)
        assert not here.is_own_user(client.getsockname())
