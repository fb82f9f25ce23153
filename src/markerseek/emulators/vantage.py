"""An emulated Vantage with `matlab/markerseek_send.m`: it sends an int16 frame for each trigger over TCP.

It says in its greeting, and with each frame, that it is an emulator. As it is emulated by its bytes, its frames can go
through the real sender under GNU Octave, too.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from markerseek.emulators._trains import SweptTrain, Train, Trains
from markerseek.sim import SimulatedWorld
from markerseek.wire import vantage as wire

_TAKEN_S = 5.0
"""Longest time in which the receiver must take a frame, in seconds; the connection is ended if it does not."""


class EmulatedVantage:
    """Sends the sound of a simulated world to the receiver that listens on a port of this computer.

    It connects when one listens, and again after a connection has ended. ``world``: world whose sound is recorded; it
    must simulate frames. ``rng``: source of randomness for the differences between pulses. ``unix_s``: time of day in
    seconds since 1970, which the frames carry. ``port``: one that is free when it is made.
    """

    probe = "emulated"

    def __init__(
        self,
        *,
        world: SimulatedWorld,
        rng: np.random.Generator,
        unix_s: Callable[[], float] = time.time,  # noqa: TID251  the time of day is part of the protocol
    ) -> None:
        self._unix_s = unix_s
        self._trains = Trains(world=world, rng=rng)
        self._triggered: deque[Train | SweptTrain] = deque()
        self._receiver: socket.socket | None = None
        self._counter = 0
        with socket.create_server(("127.0.0.1", 0)) as taken:
            self.port: int = taken.getsockname()[1]

    def warm_up(self) -> None:
        """Compute one acquisition and discard it: the first real one is not delayed by imports and compilation."""
        self._trains.pulses(self._trains.trial())

    def trigger(self, count: int) -> None:
        """Receive a train of triggers at the present angle of the probe; `advance` does the work."""
        self._triggered.append(self._trains.begin(count))

    def advance(self, _now_s: float) -> None:
        """Connect where a receiver listens, and send what was triggered; from another thread than `trigger`."""
        self._connect()
        while self._triggered:
            for counts in self._trains.pulses(self._triggered.popleft()):
                self._counter += 1
                self._send(counts)

    def _connect(self) -> None:
        if self._receiver is not None and _has_ended(self._receiver):
            self.close()
        if self._receiver is None:
            with contextlib.suppress(OSError):
                self._receiver = socket.create_connection(("127.0.0.1", self.port), timeout=_TAKEN_S)
            if self._receiver is not None:
                self._counter = 0
                self._send(np.empty((0, 0), np.int16))

    def _send(self, samples: np.ndarray) -> None:
        if self._receiver is None:
            return
        frame = wire.VantageFrame(
            counter=self._counter, time_s=self._unix_s(), probe=self.probe, samples=samples, emulated=True
        )
        try:
            self._receiver.sendall(wire.encode(frame))
        except OSError:
            self.close()

    def close(self) -> None:
        """End the connection; allowed twice."""
        if self._receiver is not None:
            self._receiver.close()
        self._receiver = None


def _has_ended(connection: socket.socket) -> bool:
    """Whether the receiver, which never sends anything, has closed the connection."""
    readable, _, _ = select.select([connection], [], [], 0)
    return bool(readable)
