"""One client of the OpenIGTLink server: its bytes in and out, and when it is dropped."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from ipaddress import IPv4Address, IPv6Address, ip_address

from markerseek.core import DeviceError
from markerseek.wire import igtl

SLOW_S = 2.0
"""Longest time in which a client must take a message, in seconds."""

MAX_BODY_BYTES = 1 << 17
"""Largest body that is taken: the longest command has half of it."""

_SEND_BYTES = 1 << 18
"""Buffer of the operating system for one client: what is in it is old when the client comes to read it."""

_TOO_SLOW = f"it is too slow: a message was not taken within {SLOW_S:g} s"

IPAddress = IPv4Address | IPv6Address

LOOPBACK = ip_address("127.0.0.1")
"""This computer: all of its addresses that no other computer reaches are this one."""


def plain_address(text: str) -> IPAddress:
    """Return the normal form of a computer's address; ValueError if the text is not an address."""
    address = ip_address(text.partition("%")[0])
    address = getattr(address, "ipv4_mapped", None) or address
    return LOOPBACK if address.is_loopback else address


_Key = tuple[str, str, int]
"""Type and device of a stream, and 0; the answers to commands are counted, so that none replaces another."""


class Peer(asyncio.Protocol):
    """One client.

    ``on_open``, ``on_message``, ``on_close``: called when it has come, for each message of it, and when it has gone,
    with the reason.
    """

    def __init__(
        self,
        *,
        on_open: Callable[[Peer], None],
        on_message: Callable[[Peer, igtl.Message], None],
        on_close: Callable[[Peer, str], None],
    ) -> None:
        self._on_open = on_open
        self._on_message = on_message
        self._on_close = on_close
        self._waiting: dict[_Key, bytes] = {}
        self._framer = igtl.Framer(most_bytes=MAX_BODY_BYTES)
        self._full = False
        self._sending: asyncio.TimerHandle | None = None
        self._answers = 0
        self._reason = "it closed the connection"
        self._open = False
        self.name = "?"
        self.address: IPAddress = LOOPBACK

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Start to serve it."""
        assert isinstance(transport, asyncio.Transport)  # noqa: S101  of a TCP server
        self._transport = transport
        # Nothing waits in the program but the newest of each stream, in `_waiting`.
        transport.set_write_buffer_limits(high=0)
        connection: socket.socket = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BYTES)
        if hasattr(socket, "TCP_USER_TIMEOUT"):
            # A client whose cable was pulled acknowledges nothing.
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1e3 * SLOW_S))
        host, port = transport.get_extra_info("peername")[:2]
        self.name = f"{host}:{port}"
        self.address = plain_address(host)
        self._open = True
        self._on_open(self)

    def put(self, key: _Key, data: bytes) -> None:
        """Send a message, or let it wait in the place of an earlier one of its stream."""
        if not self._open:
            return
        if self._full:
            # Out and in again: the order of those that wait is that of their times.
            self._waiting.pop(key, None)
            self._waiting[key] = data
        else:
            self._transport.write(data)

    def answer(self, data: bytes) -> None:
        """Send an answer, which no other replaces."""
        self._answers += 1
        self.put(("", "", self._answers), data)

    def drop(self, reason: str) -> None:
        """End the connection at once."""
        if self._open:
            self._reason = reason
        self._open = False
        self._transport.abort()

    def pause_writing(self) -> None:
        """Let messages wait: the last was not taken whole."""
        self._full = True
        self._sending = asyncio.get_running_loop().call_later(SLOW_S, self.drop, _TOO_SLOW)

    def resume_writing(self) -> None:
        """Send what waits."""
        self._full = False
        if self._sending is not None:
            self._sending.cancel()
        while self._waiting and not self._full:
            self._transport.write(self._waiting.pop(next(iter(self._waiting))))

    def data_received(self, data: bytes) -> None:
        """Take bytes; if they are no message, the connection is ended with a STATUS that has the reason."""
        try:
            for header, body in self._framer.feed(data):
                self._on_message(self, igtl.decode(header, body))
                if not self._open:
                    return
        except DeviceError as problem:
            # After damaged bytes no message begins at a known place.
            self.refuse(str(problem))
            self._transport.close()
            self._open = False

    def refuse(self, sentence: str) -> None:
        """Send a STATUS with the reason why the client is not served."""
        status = igtl.Status(code=igtl.UNKNOWN_ERROR, name="REFUSED", message=sentence[:1000])
        if not self._full:
            self._transport.write(igtl.encode(igtl.Message(device="PaSearch", content=status, version=1)))
        self._reason = sentence

    def connection_lost(self, error: Exception | None) -> None:
        """Forget it."""
        if isinstance(error, TimeoutError):
            self._reason = _TOO_SLOW
        self._open = False
        if self._sending is not None:
            self._sending.cancel()
        self._waiting.clear()
        self._on_close(self, self._reason)
