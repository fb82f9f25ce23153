"""A plain client of the OpenIGTLink server: a socket, and the messages that came."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from typing import Self

from markerseek.wire import igtl

MOST_BYTES = 1 << 26


class IgtlClient:
    """Connects; reads and writes whole messages."""

    def __init__(self, port: int, *, timeout_s: float = 60.0) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=timeout_s)

    def read(self) -> igtl.Message | None:
        """The next message; None at the end."""
        head = self._exactly(igtl.HEADER_BYTES)
        if head is None:
            return None
        header = igtl.decode_header(head, most_bytes=MOST_BYTES)
        body = self._exactly(header.body_bytes)
        return None if body is None else igtl.decode(header, body)

    def _exactly(self, size: int) -> bytes | None:
        data = b""
        while len(data) < size:
            try:
                part = self.socket.recv(size - len(data))
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
        self.socket.close()
