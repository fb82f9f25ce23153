import select
import socket
import struct

import numpy as np

from markerseek.core import NotConnectedError

HEADER = struct.Struct("<4sIIIId20s")  # mark, flags, counter, channels, samples, time, probe


class Receiver:
    """Frames of a program that connects to a port of this computer, and sends one for each trigger."""

    def __init__(self, *, port: int, emulated: bool = False):
        self.emulated = emulated
        self._waiting = b""
        with socket.create_server(("127.0.0.1", port)) as server:
            server.settimeout(25.0)
            try:
                self._connection, _ = server.accept()
            except TimeoutError:
                raise NotConnectedError(f"nobody connected to port {port} within 25 s; start the sender") from None

    def close(self):
        self._connection.close()

    def read(self):
        if select.select([self._connection], [], [], 0)[0]:
            self._waiting += self._connection.recv(1 << 20)
        frames = []
        while len(self._waiting) >= HEADER.size:
            _mark, _flags, _counter, channels, samples, _time, _probe = HEADER.unpack_from(self._waiting)
            end = HEADER.size + 2 * channels * samples
            if len(self._waiting) < end:
                break
            if channels:  # a greeting has none
                counts = np.frombuffer(self._waiting[HEADER.size : end], "<i2").astype(np.int16)
                frames.append(counts.reshape(channels, samples))
            self._waiting = self._waiting[end:]
        return frames
