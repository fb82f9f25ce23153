"""A line of bytes to a device: what drivers speak through, be it a serial port, a relay, or an emulator's end."""

from __future__ import annotations

from typing import Protocol


class Port(Protocol):
    """Bytes in order, both ways."""

    def write(self, data: bytes) -> None:
        """Send all of it; `NotConnectedError` where the line is gone."""

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to that many bytes, fewer (perhaps none) once the time has gone by; `NotConnectedError` as above."""

    def close(self) -> None:
        """Let go of the line; allowed twice."""
