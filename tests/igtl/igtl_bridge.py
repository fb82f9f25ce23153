"""The bridge as a process, and a client on Debian's OpenIGTLink library."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import pytest

SOURCE = Path(__file__).with_name("peer.cpp")
HEADERS = Path("/usr/include/openigtlink")


class Bridge:
    """``markerseek igtl`` on a port that is free."""

    def __init__(self, *options: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "markerseek", "igtl", "--port", "0", *options],
            stdin=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        self.notes: list[str] = []
        while True:
            line = self.process.stderr.readline()
            if not line:
                raise AssertionError(f"the bridge ended: {self.notes}")
            self.notes.append(line)
            found = re.search(r"connect to 127\.0\.0\.1, port (\d+)", line)
            if found:
                self.port = int(found[1])
                return

    def stop(self, number: int = signal.SIGINT) -> int:
        """Stop it, and return its exit code."""
        self.process.send_signal(number)
        self.notes += self.process.communicate(timeout=60)[1].splitlines()
        return self.process.returncode


@contextmanager
def bridge(*options: str) -> Iterator[Bridge]:
    """A running bridge."""
    running = Bridge(*options)
    try:
        yield running
    finally:
        if running.process.poll() is None:
            running.process.kill()
            running.process.communicate()


class OnTerminal:
    """A bridge to devices that asks on a terminal; ``far`` is where a person types, ``said`` what it has printed."""

    def __init__(self, rig: Path, *, typed: bytes = b"") -> None:
        self.far, self._near = os.openpty()
        os.write(self.far, typed)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "markerseek", "igtl", "--port", "0", "--rig", str(rig)],
            stdin=self._near,
            stderr=subprocess.PIPE,
        )
        self.said = ""
        self.port = int(self.until(r"connect to 127\.0\.0\.1, port (\d+)")[1])

    def until(self, pattern: str) -> re.Match[str]:
        """Wait until it has printed something."""
        while (found := re.search(pattern, self.said)) is None:
            piece = os.read(self._process.stderr.fileno(), 4096)
            assert piece, f"it ended before {pattern!r}: {self.said}"
            self.said += piece.decode("utf-8", "replace")
        return found

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.communicate(timeout=60)
        os.close(self.far)
        os.close(self._near)


def compiled_peer(folder: Path) -> Path:
    """The C++ client, or a skipped test where it cannot be compiled."""
    if shutil.which("g++") is None or not HEADERS.is_dir():
        pytest.skip("the C++ client needs g++ and OpenIGTLink: apt-get install g++ libopenigtlink-dev")
    program = folder / "peer"
    command = ["g++", "-O1", "-o", str(program), str(SOURCE), f"-I{HEADERS}", "-lOpenIGTLink", "-lpthread"]
    subprocess.run(command, check=True)
    return program


@contextmanager
def peer_lines(program: Path, port: int) -> Iterator[tuple[subprocess.Popen[str], Iterator[str]]]:
    """A running C++ client, and what it prints, line by line; what is not sent is not waited for longer than 2 min."""
    with subprocess.Popen([program, str(port)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:
        patience = threading.Timer(120.0, peer.kill)
        patience.start()
        yield peer, (line.strip() for line in peer.stdout)
        peer.kill()
        patience.cancel()
