"""The bridge as a process, and a client on Debian's OpenIGTLink library."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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


def on_terminal(rig: Path, terminal: int) -> subprocess.Popen[bytes]:
    """A bridge to devices, with a terminal as its standard input."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "markerseek", "igtl", "--port", "0", "--rig", str(rig)],
        stdin=terminal,
        stderr=subprocess.PIPE,
    )


def compiled_peer(folder: Path) -> Path:
    """The C++ client, or a skipped test where it cannot be compiled."""
    if shutil.which("g++") is None or not HEADERS.is_dir():
        pytest.skip("the C++ client needs g++ and OpenIGTLink: apt-get install g++ libopenigtlink-dev")
    program = folder / "peer"
    command = ["g++", "-O1", "-o", str(program), str(SOURCE), f"-I{HEADERS}", "-lOpenIGTLink", "-lpthread"]
    subprocess.run(command, check=True)
    return program
