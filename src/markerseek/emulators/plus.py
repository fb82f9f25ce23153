"""An emulated PLUS server: it sends an int16 image of channels x samples for each trigger, over OpenIGTLink.

It names itself an emulator to each client and with each image, and serves one client at a time, on this computer only.
As a real one it sends header version 1, without metadata, until its client has sent version 2.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np

from markerseek.core import DeviceError
from markerseek.emulators._trains import SweptTrain, Train, Trains
from markerseek.sim import SimulatedWorld
from markerseek.wire import igtl

_TAKEN_S = 5.0
"""Longest time in which a client must take an image, in seconds; it is dropped if it does not."""

_PULSE_S = 1e-3
"""Time from one image's stamp to the next, in seconds."""


class EmulatedPlus:
    """Sends the sound of a simulated world; close it at the end.

    ``world``: world whose sound is recorded; it must simulate frames. ``rng``: source of randomness for the differences
    between pulses. ``unix_s``: time of day in seconds since 1970, which the images carry. ``port``, ``device``: its
    port, which is any that is free, and the name of its images.
    """

    device = "RfVideo_Reference"

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        rng: np.random.Generator,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        self._unix_s = unix_s
        self._trains = Trains(world=world, rng=rng)
        self._triggered: deque[tuple[Train | SweptTrain, float]] = deque()
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self._client: socket.socket | None = None
        self._framer = igtl.Framer(most_bytes=1 << 16)
        self._version: Literal[1, 2] = 1
        self.port: int = self._server.getsockname()[1]

    def warm_up(self) -> None:
        """Compute one acquisition and discard it: the first real one is not delayed by imports and compilation."""
        self._trains.pulses(self._trains.trial())

    def trigger(self, count: int) -> None:
        """Receive a train of triggers at the present angle of the probe; `advance` does the work."""
        self._triggered.append((self._trains.begin(count), self._unix_s()))

    def advance(self, _now_s: float) -> None:
        """Greet a client that has come, and send what was triggered; from another thread than `trigger`."""
        with contextlib.suppress(BlockingIOError):
            newest, _ = self._server.accept()
            self._drop()
            newest.settimeout(_TAKEN_S)
            self._client, self._version = newest, 1
            self._framer = igtl.Framer(most_bytes=1 << 16)
            status = igtl.Status(code=igtl.OK, name="EMULATOR", message=igtl.EMULATOR)
            self._send(igtl.Message(device="PlusServer", content=status, time_s=self._unix_s()))
        self._listen()
        while self._triggered:
            train, at_s = self._triggered.popleft()
            for number, counts in enumerate(self._trains.pulses(train)):
                image = igtl.Image(pixels=counts[np.newaxis], matrix=np.eye(4))
                stamp_s = at_s + _PULSE_S * number
                known = {"emulator": igtl.EMULATOR}
                self._send(igtl.Message(device=self.device, content=image, time_s=stamp_s, metadata=known))

    def _listen(self) -> None:
        """Note in which version the client speaks; one that ends, or sends something else, is dropped."""
        if self._client is None or not select.select([self._client], [], [], 0)[0]:
            return
        try:
            data = self._client.recv(1 << 16)
            if any(header.version == 2 for header, _ in self._framer.feed(data)):
                self._version = 2
        except (OSError, DeviceError):
            data = b""
        if not data:
            self._drop()

    def _send(self, message: igtl.Message) -> None:
        if self._client is None:
            return
        try:
            self._client.sendall(igtl.encode(replace(message, version=self._version)))
        except OSError:
            # Like the server, it goes on without a client, and waits for the next.
            self._drop()

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None

    def close(self) -> None:
        """End the connection, and free the port."""
        self._drop()
        self._server.close()
