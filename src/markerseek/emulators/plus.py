"""An emulated PLUS server: it sends an int16 image of channels x samples for each trigger, over OpenIGTLink.

It names itself an emulator to each client and with each image, and serves one client at a time, on this computer only.
"""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable

import numpy as np

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
            self._client = newest
            status = igtl.Status(code=igtl.OK, name="EMULATOR", message=igtl.EMULATOR)
            self._send(igtl.Message(device="PlusServer", content=status, time_s=self._unix_s()))
        while self._triggered:
            train, at_s = self._triggered.popleft()
            for number, counts in enumerate(self._trains.pulses(train)):
                image = igtl.Image(pixels=counts[np.newaxis], matrix=np.eye(4))
                stamp_s = at_s + _PULSE_S * number
                known = {"emulator": igtl.EMULATOR}
                self._send(igtl.Message(device=self.device, content=image, time_s=stamp_s, metadata=known))

    def _send(self, message: igtl.Message) -> None:
        if self._client is None:
            return
        try:
            self._client.sendall(igtl.encode(message))
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
