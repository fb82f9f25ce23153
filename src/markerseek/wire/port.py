"""Protocol of a line to a device: a serial port, the supervisor's relay, or an emulator in the same process."""

from __future__ import annotations

from typing import Protocol


class Port(Protocol):
    """Bytes in order, both ways."""

    def write(self, data: bytes) -> None:
        """Send all bytes; `NotConnectedError` if the line is lost."""

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to ``size`` bytes, fewer or none after the timeout; `NotConnectedError` if the line is lost."""

    def close(self) -> None:
        """Close the line; allowed twice."""
