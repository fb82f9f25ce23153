"""Only ordinary files are read: a pipe or a device would block, or never end."""

from __future__ import annotations

import stat
from pathlib import Path

from markerseek.core import RecordError


def ordinary_size(path: Path, *, most: int) -> int:
    """Size of an ordinary file in bytes.

    Raises
    ------
    RecordError
        If it is something else, or larger than ``most``.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise RecordError(f"{path}: it is no ordinary file; copy its contents into one")
    if status.st_size > most:
        raise RecordError(f"{path}: {status.st_size} bytes found, at most {most} expected; it holds something else")
    return status.st_size
