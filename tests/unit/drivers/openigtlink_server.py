"""A server of OpenIGTLink as impolite as PlusServer: header version 1 until its client has sent version 2."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import threading
import time
from types import TracebackType
from typing import Self

import numpy as np
import pyigtl

from markerseek.records.banks.sequence_writer import probe_to_probe_home
from tests.waiting import wait_until

_PERIOD_S = 0.02


class ImpoliteServer:
    """Packs its messages by pyigtl, for one client at a time.

    ``highest``: highest header version that it sends; an old one knows only 1. ``status``: ``TransformStatus`` of its
    transforms, which version 1 has no room for. ``streams``: whether it sends transforms of now, as a tracker does.
    ``version``: of what it sends now.
    """

    angle_deg = 12.5

    def __init__(self, *, highest: int = 2, status: str | None = "OK", streams: bool = True) -> None:
        self.status = status
        self.version = 1
        self.sent = threading.Event()
        self._highest = highest
        self._streams = streams
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._client: socket.socket | None = None
        self._said = b""
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        self._thread.join(5)
        self._listening.close()
        if self._client is not None:
            self._client.close()

    def send_image(self, device: str, later_s: float, **fields: str) -> None:
        """Send an image of now, and its fields where its version has room for them."""
        wait_until(lambda: self._client is not None)
        # The request of the client, which not each of them sends, may be on its way.
        time.sleep(2 * _PERIOD_S)
        image = pyigtl.ImageMessage(np.ones((1, 2, 2), np.int16), device_name=device, timestamp=time.time() + later_s)
        self._send(image, fields)

    def _serve(self) -> None:
        while not self._over.wait(_PERIOD_S):
            if select.select([self._listening], [], [], 0)[0]:
                if self._client is not None:
                    self._client.close()
                self._client, _ = self._listening.accept()
                self.version = 1
                self._said = b""
            if self._client is None:
                continue
            with contextlib.suppress(OSError):
                if select.select([self._client], [], [], 0)[0]:
                    self._hear(self._client.recv(4096))
                if self._streams:
                    matrix = probe_to_probe_home(self.angle_deg)
                    known = {} if self.status is None else {"TransformStatus": self.status}
                    self._send(pyigtl.TransformMessage(matrix, device_name="ProbeToProbeHome"), known)
                    self.sent.set()

    def _hear(self, data: bytes) -> None:
        """Remember the highest version of the client, as PlusServer does with the header of every message."""
        self._said += data
        while len(self._said) >= 58:
            version, _, _, _, size, _ = struct.unpack(">H12s20sQQQ", self._said[:58])
            self.version = min(self._highest, max(self.version, version))
            self._said = self._said[58 + size :]

    def _send(self, message: pyigtl.MessageBase, fields: dict[str, str]) -> None:
        assert self._client is not None
        message.header_version = self.version
        message.metadata = fields if self.version == 2 else {}
        self._client.sendall(message.pack())
