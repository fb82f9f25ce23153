"""A plain client of the OpenIGTLink server: a socket, and the messages that came."""

from __future__ import annotations

import queue
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Self

from markerseek.wire import igtl

MAX_BYTES = 1 << 26

LONGEST_S = 120.0
"""Longest wait for anything, in seconds: a busy machine is no fault."""


class IgtlClient:
    """Connects; reads and writes whole messages.

    Where it ``reads_ahead``, a thread takes what comes at once, as other people's clients do: the server drops who does
    not for 2 s, which a test on a busy machine may need to look at one message.
    """

    def __init__(self, port: int, *, reads_ahead: bool = True) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=LONGEST_S)
        self._receive: Callable[[int], bytes] = self.socket.recv
        if reads_ahead:
            self._arrived: queue.SimpleQueue[bytes] = queue.SimpleQueue()
            self._rest = b""
            self._receive = self._arrived_bytes
            threading.Thread(target=self._read_ahead, daemon=True).start()

    def _read_ahead(self) -> None:
        data = b"x"
        while data:
            try:
                data = self.socket.recv(1 << 20)
            except OSError:
                data = b""
            self._arrived.put(data)

    def _arrived_bytes(self, most: int) -> bytes:
        data = self._rest or self._arrived.get(timeout=LONGEST_S)
        self._rest = data[most:]
        return data[:most]

    def read(self) -> igtl.Message | None:
        """The next message; None at the end."""
        head = self._exactly(igtl.HEADER_BYTES)
        if head is None:
            return None
        header = igtl.decode_header(head, most_bytes=MAX_BYTES)
        body = self._exactly(header.body_bytes)
        return None if body is None else igtl.decode(header, body)

    def _exactly(self, size: int) -> bytes | None:
        data = b""
        while len(data) < size:
            try:
                part = self._receive(size - len(data))
            except ConnectionResetError:
                return None
            if not part:
                return None
            data += part
        return data

    def messages(self) -> Iterator[igtl.Message]:
        """Messages to the end."""
        while (message := self.read()) is not None:
            yield message

    def until(self, wanted: Callable[[igtl.Message], bool]) -> list[igtl.Message]:
        """Messages up to and with the first that is wanted."""
        messages = []
        for message in self.messages():
            messages.append(message)
            if wanted(message):
                return messages
        raise AssertionError(f"the connection ended after {[each.device for each in messages]}")

    def send(self, content: igtl.Content, *, device: str, version: int = 2) -> None:
        """Send a message."""
        self.socket.sendall(igtl.encode(igtl.Message(device=device, content=content, version=version)))

    def ask(self, xml: str, *, name: str = "1") -> str:
        """Send a command as STRING, and return the text of its answer."""
        self.send(igtl.Text(text=xml), device=f"CMD_{name}")
        return self.until(lambda message: message.device == f"ACK_{name}")[-1].content.text

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the connection."""
        # Wakes the thread that reads, without which the connection would stay open.
        with suppress(OSError):
            self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
