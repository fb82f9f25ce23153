"""Lines to emulators: a pseudo-terminal for any program, a direct port for virtual time."""

from __future__ import annotations

import os
import threading
from pathlib import Path

import pytest

from markerseek.core import ConfigError, NotConnectedError
from markerseek.drivers import SerialPort, SystemClock
from markerseek.emulators import PtyLine
from markerseek.sim import VirtualClock


class Echo:
    """Echoes what it receives, and repeats the last of it after a second."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._later: list[tuple[float, bytes]] = []

    def advance(self, now_s: float) -> bytes:
        self._now_s = now_s
        due = b"".join(said for at_s, said in self._later if at_s <= now_s)
        self._later = [(at_s, said) for at_s, said in self._later if at_s > now_s]
        return due

    def feed(self, data: bytes) -> bytes:
        self._later.append((self._now_s + 1.0, data.upper()))
        return data


def test_every_byte_crosses_a_pseudo_terminal_unchanged() -> None:
    clock = SystemClock()
    done = threading.Event()
    with PtyLine(device=Echo(), clock=clock) as line:

        def serve() -> None:
            while not done.is_set():
                line.serve_once(wait_s=2e-3)

        serving = threading.Thread(target=serve)
        serving.start()
        try:
            with SerialPort(line.path, handshake=True) as port:
                every = bytes(range(256)) * 8
                port.write(every)
                received = port.read(len(every), timeout_s=5.0)
        finally:
            done.set()
            serving.join()
    assert received == every


class HeldUp(VirtualClock):
    """Holds up the server for 0.1 s when it takes the time, while the program at the other end goes on writing."""

    def __init__(self) -> None:
        super().__init__()
        self.end = -1

    def now_s(self) -> float:
        taken_s = super().now_s()
        self.wait(0.1)
        os.write(self.end, b"b")
        return taken_s


class Stamped:
    """Keeps when it was fed what."""

    def __init__(self) -> None:
        self.fed: list[tuple[float, bytes]] = []
        self._now_s = 0.0

    def advance(self, now_s: float) -> bytes:
        self._now_s = now_s
        return b""

    def feed(self, data: bytes) -> bytes:
        self.fed.append((self._now_s, data))
        return b""


def test_no_question_is_answered_as_of_a_time_before_it_was_asked() -> None:
    clock, device = HeldUp(), Stamped()
    with PtyLine(device=device, clock=clock) as line:
        clock.end = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
        os.write(clock.end, b"a")
        line.serve_once(wait_s=1.0)
        line.serve_once(wait_s=1.0)
        os.close(clock.end)
    assert device.fed == [(0.0, b"a"), (pytest.approx(0.1), b"b")]


def test_one_program_holds_the_port() -> None:
    with (
        PtyLine(device=Echo(), clock=SystemClock()) as line,
        SerialPort(line.path),
        pytest.raises(NotConnectedError, match="close other programs"),
    ):
        SerialPort(line.path)


def test_a_line_taken_away_is_gone() -> None:
    line = PtyLine(device=Echo(), clock=SystemClock())
    port = SerialPort(line.path)
    line.close()
    line.close()
    with pytest.raises(NotConnectedError, match="gone"):
        port.read(1, timeout_s=1.0)
    with pytest.raises(NotConnectedError, match="gone"):
        port.write(b"a")
    port.close()
    port.close()


def test_a_port_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(NotConnectedError, match=r"/none cannot be opened \(No such file or directory\); plug"):
        SerialPort(str(tmp_path / "none"))
    with pytest.raises(ConfigError, match="path"):
        SerialPort("")
    with pytest.raises(ConfigError, match="baud"):
        SerialPort("/dev/ttyUSB0", baud=0)
