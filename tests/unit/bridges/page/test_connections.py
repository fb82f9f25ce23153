"""The bounds of connections that have not shown the token."""

from __future__ import annotations

import contextlib
import socket

import pytest

from markerseek.bridges.page import connections
from markerseek.bridges.page.connections import BATCH, Listener


@pytest.fixture
def listener():
    with Listener(socket.create_server(("127.0.0.1", 0))) as made:
        made.setblocking(False)
        yield made


@pytest.fixture
def connect(listener):
    """A function that connects, and returns both ends."""
    with contextlib.ExitStack() as stack:

        def one():
            theirs = stack.enter_context(socket.create_connection(listener.getsockname(), timeout=5))
            while True:
                with contextlib.suppress(BlockingIOError):
                    ours, _ = listener.accept()
                    return stack.enter_context(ours), theirs

        yield one


def is_open(end):
    end.setblocking(False)
    try:
        return end.recv(1) != b""
    except BlockingIOError:
        return True


def test_the_oldest_stranger_makes_room_and_those_with_the_token_stay(listener, connect, monkeypatch):
    monkeypatch.setattr(connections, "MAX_STRANGERS", 3)
    ends = [connect()[1] for _ in range(3)]
    assert listener.admit(ends[0].getsockname())
    ends += [connect()[1] for _ in range(3)]
    assert [is_open(end) for end in ends] == [True, False, False, True, True, True]
    # A place that was left is free again, and nobody has to go.
    ends[3].close()


def test_a_connection_that_its_server_closed_counts_no_more(listener, connect, monkeypatch):
    monkeypatch.setattr(connections, "MAX_STRANGERS", 2)
    ours, _ = connect()
    _, second = connect()
    ours.close()
    connect()
    assert is_open(second)


def test_a_stranger_that_stays_too_long_is_dropped_and_one_with_the_token_is_not(listener, connect, monkeypatch):
    _, stranger = connect()
    _, known = connect()
    listener.admit(known.getsockname())
    listener.drop_late()
    assert (is_open(stranger), is_open(known)) == (True, True)
    monkeypatch.setattr(connections, "STRANGER_S", 0.0)
    listener.drop_late()
    assert (is_open(stranger), is_open(known)) == (False, True)


def test_those_with_the_token_are_bounded_too(listener, connect, monkeypatch):
    monkeypatch.setattr(connections, "MAX_KNOWN", 2)
    pairs = [connect() for _ in range(3)]
    admitted = [listener.admit(theirs.getsockname()) for _, theirs in pairs]
    assert admitted == [True, True, False]
    # Each counts once.
    assert listener.admit(pairs[0][1].getsockname())
    pairs[0][0].close()
    assert listener.admit(pairs[2][1].getsockname())


def test_others_are_served_after_a_batch(listener):
    with contextlib.ExitStack() as stack:
        for _ in range(BATCH + 3):
            stack.enter_context(socket.create_connection(listener.getsockname()))
        batches = [0]
        while sum(batches) < BATCH + 3:
            try:
                stack.enter_context(listener.accept()[0])
                batches[-1] += 1
            except BlockingIOError:
                batches.append(0)
    assert max(batches) == BATCH
