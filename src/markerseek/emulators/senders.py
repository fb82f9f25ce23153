"""Emulated receivers that send a message for each trigger: a PLUS server, and a Vantage with `markerseek_send.m`.

Each names itself an emulator to each client and with each message, serves one client at a time, and on this computer
only. It sends the sound of a simulated world, which must simulate frames.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar, Literal

import numpy as np

from markerseek.core import DeviceError, Int16
from markerseek.emulators._trains import Train, Trains
from markerseek.sim import SimulatedWorld
from markerseek.wire import igtl
from markerseek.wire import vantage as wire

_TAKEN_S = 5.0
"""Longest time in which a client must take a message, in seconds; it is dropped if it does not."""

_PULSE_S = 1e-3
"""Time from one message's stamp to the next, in seconds."""


class EmulatedSender(ABC):
    """Sends a message for each trigger; close it at the end.

    ``world``: world whose sound is recorded. ``unix_s``: time of day in seconds since 1970, which the messages carry.
    ``port``: a free port of this computer.
    """

    called: ClassVar[str]

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        self._unix_s = unix_s
        self._trains = Trains(world)
        self._triggered: deque[tuple[Train, float]] = deque()
        self._client: socket.socket | None = None
        self.port = self._open()

    @abstractmethod
    def _open(self) -> int:
        """Prepare its connection, and return its port."""

    @property
    def said(self) -> str:
        """Where it is, for people."""
        return f"{self.called} 127.0.0.1, port {self.port}"

    @property
    @abstractmethod
    def keys(self) -> str:
        """Its driver and where it is, as keys of a rig file."""

    @abstractmethod
    def _meet(self) -> None:
        """Greet a client that has come, and note a client that has gone."""

    @abstractmethod
    def _message(self, counts: Int16[np.ndarray, "channels samples"], stamp_s: float) -> bytes:
        """Bytes of a message."""

    def warm_up(self) -> None:
        """Compute one acquisition and discard it: the first real one is not delayed by imports and compilation."""
        self._trains.pulses(self._trains.trial())

    def trigger(self, count: int) -> None:
        """Receive a train of triggers at the present angle of the probe; `advance` does the work."""
        self._triggered.append((self._trains.begin(count), self._unix_s()))

    def advance(self, _now_s: float) -> None:
        """Meet a client, and send what was triggered; from another thread than `trigger`."""
        self._meet()
        while self._triggered:
            train, at_s = self._triggered.popleft()
            for number, counts in enumerate(self._trains.pulses(train)):
                self._send(self._message(counts, at_s + _PULSE_S * number))

    def _said(self) -> bytes | None:
        """What the client says; empty if it has gone, None if it is silent."""
        if self._client is None or not select.select([self._client], [], [], 0)[0]:
            return None
        try:
            return self._client.recv(1 << 16)
        except OSError:
            return b""

    def _send(self, data: bytes) -> None:
        try:
            if self._client is not None:
                self._client.sendall(data)
        except OSError:
            # It goes on without a client, and waits for the next.
            self._drop()

    def _drop(self) -> None:
        if self._client is not None:
            self._client.close()
        self._client = None

    def close(self) -> None:
        """End the connection, and free the port; allowed twice."""
        self._drop()


class EmulatedPlus(EmulatedSender):
    """A PLUS server of int16 images of channels x samples, over OpenIGTLink.

    As a real one it sends header version 1, without metadata, until its client has sent version 2.
    """

    called = "PLUS server:"
    device = "RfVideo_Reference"

    def _open(self) -> int:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self._framer = igtl.Framer(most_bytes=1 << 16)
        self._version: Literal[1, 2] = 1
        return int(self._server.getsockname()[1])

    @property
    def keys(self) -> str:
        """As of `EmulatedSender`."""
        return f'driver = "plus"\ndevice = "{self.device}"\nport = {self.port}\nquiet_s = 0.5\n'

    def _meet(self) -> None:
        with contextlib.suppress(BlockingIOError):
            newest, _ = self._server.accept()
            self._drop()
            newest.settimeout(_TAKEN_S)
            self._client, self._version = newest, 1
            self._framer = igtl.Framer(most_bytes=1 << 16)
            status = igtl.Status(code=igtl.OK, name="EMULATOR", message=igtl.EMULATOR)
            self._send(self._encoded(igtl.Message(device="PlusServer", content=status, time_s=self._unix_s())))
        said = self._said()
        try:
            # Which version the client speaks; a client that ends, or sends something else, is dropped.
            if any(header.version == 2 for header, _ in self._framer.feed(said or b"")):
                self._version = 2
        except DeviceError:
            said = b""
        if said == b"":
            self._drop()

    def _message(self, counts: Int16[np.ndarray, "channels samples"], stamp_s: float) -> bytes:
        image = igtl.Image(pixels=counts[np.newaxis], matrix=np.eye(4))
        known = {"emulator": igtl.EMULATOR}
        return self._encoded(igtl.Message(device=self.device, content=image, time_s=stamp_s, metadata=known))

    def _encoded(self, message: igtl.Message) -> bytes:
        return igtl.encode(replace(message, version=self._version))

    def close(self) -> None:
        """As of `EmulatedSender`."""
        super().close()
        self._server.close()


class EmulatedVantage(EmulatedSender):
    """A Vantage with `matlab/markerseek_send.m`: it connects when a receiver listens, and again when that has ended."""

    called = "Vantage: sends to"
    probe = "emulated"

    def _open(self) -> int:
        self._counter = 0
        with socket.create_server(("127.0.0.1", 0)) as taken:
            return int(taken.getsockname()[1])

    @property
    def keys(self) -> str:
        """As of `EmulatedSender`."""
        return f'driver = "vantage"\nprobe = "{self.probe}"\nport = {self.port}\nquiet_s = 0.5\n'

    def _meet(self) -> None:
        if self._said() is not None:
            # The receiver never sends anything: it has closed the connection.
            self._drop()
        if self._client is None:
            with contextlib.suppress(OSError):
                self._client = socket.create_connection(("127.0.0.1", self.port), timeout=_TAKEN_S)
            self._counter = -1
            self._send(self._message(np.empty((0, 0), np.int16), self._unix_s()))

    def _message(self, counts: Int16[np.ndarray, "channels samples"], _stamp_s: float) -> bytes:
        self._counter += 1
        return wire.encode(
            wire.VantageFrame(
                counter=self._counter, time_s=self._unix_s(), probe=self.probe, samples=counts, emulated=True
            )
        )
