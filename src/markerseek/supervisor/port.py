"""A supervised line as a port: the drivers read and write it as if they owned it."""

from __future__ import annotations

from collections.abc import Callable


class SupervisedPort:
    """A line that the supervisor holds, as a `markerseek.wire.Port`; `Supervisor.port` hands it out."""

    def __init__(self, *, write: Callable[[bytes], None], read: Callable[[int, float], bytes]) -> None:
        self._write = write
        self._read = read

    def write(self, data: bytes) -> None:
        """Send one message of the device; `NotConnectedError` once the supervisor has released the lines."""
        self._write(data)

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to that many bytes, fewer (perhaps none) at the end of the timeout; the lease is renewed meanwhile."""
        return self._read(size, timeout_s)

    def close(self) -> None:
        """Nothing to do: the supervisor holds the line until it is closed itself."""
