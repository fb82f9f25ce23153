"""Encoding and decoding of device protocols and file headers. Pure: no port or file is opened here."""

from __future__ import annotations

from typing import Protocol


class Port(Protocol):
    """A line to a device: a serial port, the supervisor's relay, or an emulator in the same process."""

    def write(self, data: bytes) -> None:
        """Send all bytes; `NotConnectedError` if the line is lost."""

    def read(self, size: int, *, timeout_s: float) -> bytes:
        """Up to ``size`` bytes, fewer or none after the timeout; `NotConnectedError` if the line is lost."""

    def close(self) -> None:
        """Close the line; allowed twice."""
