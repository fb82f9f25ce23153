"""Readers as they would be if a file had taken control of them; the child of a sandbox imports them."""

from __future__ import annotations

import os
import resource
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np


def attempts(path: Path) -> dict[str, np.ndarray]:
    """1 for each attempt that succeeded, by its name; the file names one of the user's own."""
    own = Path(path.read_text().splitlines()[0])
    tries: dict[str, Callable[[], object]] = {
        "reads its file": path.read_bytes,
        "imports a library": lambda: __import__("xml.dom.minidom"),
        "reads another file": own.read_bytes,
        "writes its file": lambda: path.open("r+b").close(),
        "writes another file": lambda: own.open("r+b").close(),
        "makes a file": lambda: own.with_name("made").touch(),
        "removes a file": own.unlink,
        "lists a folder": lambda: list(own.parent.iterdir()),
        "opens an internet socket": lambda: socket.socket(socket.AF_INET, socket.SOCK_DGRAM),
        "opens a local socket": lambda: socket.socket(socket.AF_UNIX),
        "starts a program": lambda: subprocess.run([sys.executable, "-c", ""], check=True),
        "sends a signal": lambda: os.kill(os.getppid(), 0),
        "raises its limits": lambda: resource.setrlimit(resource.RLIMIT_CPU, (10**6, resource.RLIM_INFINITY)),
    }
    return {name: np.array([_succeeds(each)]) for name, each in tries.items()}


def _succeeds(attempt: Callable[[], object]) -> bool:
    try:
        attempt()
    except (OSError, ValueError, subprocess.SubprocessError):
        return False
    return True
