"""A file that comes into being whole or not at all, and never in the place of another."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from markerseek.core import RecordError


def require_new(path: Path) -> None:
    """Refuse to write where there is something already."""
    if path.exists():
        raise RecordError(f"{path}: there is a file already; name another, or delete it")


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file for bytes beside its place, and put it there once it is whole.

    Raises
    ------
    RecordError
        If there is a file already, or it cannot be written.
    """
    require_new(path)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with unfinished.open("xb") as file:
            yield file
        unfinished.rename(path)
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be written: {problem.strerror or problem}; name another place") from (
            problem
        )
    finally:
        with suppress(OSError):
            unfinished.unlink(missing_ok=True)
