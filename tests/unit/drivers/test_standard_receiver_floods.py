"""Receivers whose servers send more than was asked for."""

from __future__ import annotations

import select
import socket
import struct
import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from markerseek.core import AcquisitionError, DeviceTimeoutError, NotConnectedError
from markerseek.drivers import (
    PlusReceiver,
    PlusSettings,
    SystemClock,
    VantageReceiver,
    VantageSettings,
)
from markerseek.sim import VirtualClock
from markerseek.wire import igtl
from markerseek.wire.vantage import VantageFrame, encode
from tests.emulated_lines import permit

DEVICE = "RfVideo_Reference"


GREETING = VantageFrame(counter=0, time_s=0.0, probe="L11-5v", samples=np.empty((0, 0), np.int16))


EMPTY = VantageFrame(counter=1, time_s=0.0, probe="L11-5v", samples=np.zeros((1, 1), np.int16))


class Flood:
    """Sends the same bytes as fast as they are taken, in a thread, until the other end closes."""

    def __init__(self, first: bytes, flood: bytes) -> None:
        self._end, self.connection = socket.socketpair()
        self._end.sendall(first)
        self._flood = flood * (1 + (1 << 18) // len(flood))
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self._thread.start()
        # Until the receiver has something to read.
        assert select.select([self.connection], [], [], 10)[0]

    def _run(self) -> None:
        try:
            while True:
                self._end.sendall(self._flood)
        except OSError:
            return

    def close(self) -> None:
        self.connection.close()
        self._end.close()
        if self._thread.ident:
            self._thread.join(5)
            assert not self._thread.is_alive()


def vantage(flood: Flood) -> VantageReceiver:
    settings = VantageSettings(probe="L11-5v", timeout_s=2.0, quiet_s=0.05)
    return VantageReceiver(connection=flood.connection, clock=SystemClock(), settings=settings, dark_triggers=3)


def plus_receiver(flood: Flood) -> PlusReceiver:
    settings = PlusSettings(device=DEVICE, timeout_s=2.0, quiet_s=0.05)
    return PlusReceiver(connection=flood.connection, clock=SystemClock(), settings=settings, dark_triggers=3)


def message(content: igtl.Content, device: str = "other") -> bytes:
    return igtl.encode(igtl.Message(device=device, content=content))


FLOODS: dict[str, tuple[Callable[[Flood], VantageReceiver | PlusReceiver], bytes, bytes]] = {
    "greetings of a Vantage": (vantage, encode(GREETING), encode(GREETING)),
    "frames of a Vantage": (vantage, encode(GREETING), encode(EMPTY)),
    "a frame of a Vantage that never ends": (
        vantage,
        encode(GREETING),
        struct.pack("<4sIIIId20s", b"MSV1", 0, 1, 1024, 1 << 16, 0.0, b"L11-5v") + bytes(1 << 20),
    ),
    "states of a PLUS server": (plus_receiver, b"", message(igtl.Status(code=igtl.OK))),
    "transforms of a PLUS server": (plus_receiver, b"", message(igtl.Transform(matrix=np.eye(4)))),
    "images of a PLUS server": (
        plus_receiver,
        b"",
        message(igtl.Image(pixels=np.zeros((1, 1, 1), np.int16), matrix=np.eye(4)), DEVICE),
    ),
}


@pytest.mark.real_time
@pytest.mark.parametrize("flood", FLOODS)
def test_a_flood_ends_an_acquisition_in_seconds_with_a_sentence(flood: str) -> None:
    make, first, again = FLOODS[flood]
    line = Flood(first, again)
    receiver = make(line)
    receiver.arm(permit(pulses=3))
    line.start()
    began_s = time.monotonic()
    said = []
    for act in (receiver.acquire, receiver.arm, receiver.acquire):
        try:
            act(permit(pulses=3))
        except (AcquisitionError, NotConnectedError, DeviceTimeoutError) as problem:
            said.append(str(problem))
    # The time limit of the rig is 2 s.
    assert time.monotonic() - began_s < 5
    line.close()
    assert said
    told = " ".join(said)
    if "never ends" in flood:
        assert "a frame begins with" in told or "0 of 3 frames came within 2 s" in told
    else:
        assert "floods" in told or "came for 3 pulses" in told, told


def test_what_a_server_streams_during_a_long_pause_is_no_flood() -> None:
    """A tracker of 1 kHz during a move of 20 s: 20,000 messages wait, and none is an image."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        end = socket.create_connection(listening.getsockname(), timeout=5)
        connection, _ = listening.accept()
    clock = VirtualClock()
    receiver = PlusReceiver(
        connection=connection,
        clock=clock,
        settings=PlusSettings(device=DEVICE, timeout_s=1.0, quiet_s=0.1),
        dark_triggers=3,
        unix_s=lambda: 0.0,
    )
    clock.wait(20.0)
    # The buffers of the system hold them.
    end.sendall(20_000 * message(igtl.Transform(matrix=np.eye(4))))
    receiver.arm(permit(pulses=3))
    for number in range(3):
        image = igtl.Image(pixels=np.ones((1, 2, 2), np.int16), matrix=np.eye(4))
        end.sendall(igtl.encode(igtl.Message(device=DEVICE, content=image, time_s=1.0 + number)))
    assert receiver.acquire(permit(pulses=3)).samples.tolist() == [[1, 1], [1, 1]]
    receiver.close()
    end.close()
