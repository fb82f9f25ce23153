"""Files that are whole when their name is there: made beside it, handed to the disk, then named.

A process that is killed in between leaves what had the name before, and a hidden neighbour ``.NAME.XXXXXXXX.part``,
which may be deleted.
"""

from __future__ import annotations

import os
import secrets
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from markerseek.core import RecordError


def require_new(path: Path) -> None:
    """Refuse to write where there is something already, or no folder to write into.

    Raises
    ------
    RecordError
        If it is so.
    """
    if path.exists() or path.is_symlink():
        raise _taken(path)
    if path.parent.is_file():
        raise RecordError(f"{path}: it cannot be written: {path.parent} is no folder; name another place")
    if not path.parent.exists():
        raise RecordError(f"{path}: it cannot be written: there is no folder {path.parent}; make it, or name another")


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """As `create_atomically`, of a path that is tried first; a disk that fails becomes a `RecordError`.

    Raises
    ------
    RecordError
        If there is a file already, or it cannot be written.
    """
    require_new(path)
    try:
        with create_atomically(path) as part:
            yield part
    except OSError as problem:
        raise RecordError(f"{path}: it cannot be written: {problem.strerror or problem}; name another place") from (
            problem
        )


@contextmanager
def create_atomically(path: Path) -> Iterator[Path]:
    """A place beside `path`; the file that is made there gets its name when the block ends well, and is gone if not.

    Raises
    ------
    RecordError
        If there is a file of that name by then; it stays as it is.
    OSError
        If the file cannot be made or named.
    """
    with _beside(path) as part:
        yield part
        sync_file(part)
        try:
            os.link(part, path)
        except FileExistsError as problem:
            raise _taken(path) from problem
        except OSError:
            _claim(part, path)
        sync_folder(path.parent)


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """The same for a name that may be taken: the new file replaces the one of that name in one step.

    Raises
    ------
    RecordError
        If the name is that of a symbolic link, a pipe or a device, which may lead to a file of somebody else.
    OSError
        If the file cannot be made or named.
    """
    if path.is_symlink() or (path.exists() and not path.is_file() and not path.is_dir()):
        raise RecordError(
            f"{path}: it is a symbolic link, a pipe or a device, and nothing is written through it; "
            "remove it, or name another file"
        )
    with _beside(path) as part:
        yield part
        sync_file(part)
        part.replace(path)
        sync_folder(path.parent)


def sync_file(path: Path) -> None:
    """Have the disk hold all of a file before this returns."""
    with path.open("r+b") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Have the disk hold the names in a folder before this returns, where the system can do so."""
    if sys.platform == "win32":
        return
    place = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(place)
    finally:
        os.close(place)


@contextmanager
def _beside(path: Path) -> Iterator[Path]:
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        yield part
    finally:
        part.unlink(missing_ok=True)


def _claim(part: Path, path: Path) -> None:
    """Name a file on a disk that knows no second names: an empty file holds the name for a moment."""
    try:
        path.open("xb").close()
    except FileExistsError as problem:
        raise _taken(path) from problem
    part.replace(path)


def _taken(path: Path) -> RecordError:
    return RecordError(f"{path}: there is a file already; name another, or delete it")
