"""Lines to emulated devices: pseudo-terminals."""

from __future__ import annotations

import os
import select
import tty
from pathlib import Path
from typing import Protocol

from markerseek._closing import Closing
from markerseek.core import Clock, ConfigError

_UNREAD_LIMIT = 65536
"""Most bytes kept for a driver that does not read; later ones are lost, as on a wire."""


class ByteDevice(Protocol):
    """An emulated device, without a line or a clock of its own."""

    def advance(self, now_s: float) -> bytes:
        """Advance the device to that time of the clock, and return the bytes that it sends by itself until then."""

    def feed(self, data: bytes) -> bytes:
        """Receive bytes now, and return the immediate answer."""


class PtyLine(Closing):
    """A pseudo-terminal pair: drivers open `path`, the emulator answers at the other end.

    Use it as a context manager, and call `serve_once` again and again, in a thread or a process of its own.

    ``clock``: its clock: real time, where another program is at the other end. ``link``: path of a link to the
    pseudo-terminal, whose own name changes from start to start; None: no link.
    """

    def __init__(self, *, device: ByteDevice, clock: Clock, link: Path | None = None) -> None:
        self._device = device
        self._clock = clock
        self._outbox = bytearray()
        self._link: Path | None = None
        self._ours, self._theirs = os.openpty()
        # Our copy of the driver's end stays open: without it, reading fails whenever no driver has the port open.
        # Raw: a terminal would echo the driver's bytes and change line ends.
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self._open = True
        self._name = os.ttyname(self._theirs)
        if link is not None:
            self._put_link(link)

    @property
    def path(self) -> str:
        """Name of the serial port for a driver."""
        return str(self._link or self._name)

    def serve_once(self, *, wait_s: float) -> None:
        """Wait for bytes at most that many seconds, then advance the device once."""
        arrived, _, _ = select.select([self._ours], [], [], wait_s)
        # Read first: bytes that arrive after the time is taken would be answered as of a time before they were sent.
        data = os.read(self._ours, 4096) if arrived else b""
        self._outbox += self._device.advance(self._clock.now_s())
        if data:
            self._outbox += self._device.feed(data)
        # A full pty would block the loop that serves the other devices too.
        del self._outbox[_UNREAD_LIMIT:]
        if self._outbox:
            try:
                del self._outbox[: os.write(self._ours, self._outbox)]
            except BlockingIOError:
                return

    def close(self) -> None:
        """Close the line; a driver that has it open is disconnected. Allowed twice."""
        if not self._open:
            return
        self._open = False
        os.close(self._ours)
        os.close(self._theirs)
        if self._link is not None:
            self._link.unlink(missing_ok=True)

    def _put_link(self, link: Path) -> None:
        try:
            link.symlink_to(self._name)
        except OSError as error:
            self.close()
            raise ConfigError(
                f"link: {link} cannot be made a link to {self._name} ({error.strerror}); "
                "name another path, or delete what a killed emulator left there"
            ) from error
        self._link = link
