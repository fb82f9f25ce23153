"""Writes files: atomically, or in place; never through a link, and never into a pipe or a device.

A file is written atomically under a temporary name in the same folder, flushed to disk, then renamed. A process that is
killed before the rename leaves the previous file unchanged, and a hidden file ``.NAME.XXXXXXXX.part`` beside it, which
may be deleted. `open_for_writing` opens a file that is written in place, because it grows or is locked.
"""

from __future__ import annotations

import os
import secrets
import stat
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from markerseek.core import RecordError


def require_new(path: Path) -> None:
    """Refuse a path that exists already, or whose folder does not."""
    if path.exists() or path.is_symlink():
        raise _exists_error(path)
    if path.parent.is_file():
        raise RecordError(f"{path}: it cannot be written: {path.parent} is no folder; name another place")
    if not path.parent.exists():
        raise RecordError(f"{path}: it cannot be written: there is no folder {path.parent}; make it, or name another")


@contextmanager
def new_file(path: Path) -> Iterator[Path]:
    """`create_atomically` with the path checked first, and every failure of the disk as a `RecordError`."""
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
    """Yield a temporary path beside `path`.

    The file written there is renamed when the block succeeds, and deleted if not.

    Raises `OSError` if the file cannot be made or named.
    """
    with _written(path, _name_new) as part:
        yield part


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path as in `create_atomically`; an existing file of that name is replaced in one step.

    Raises `OSError` if the file cannot be made or named.
    """
    with suppress(FileNotFoundError):
        _require_plain(path, path.lstat())
    with _written(path, os.replace) as part:
        yield part


def open_for_writing(path: Path, flags: int, *, mode: int = 0o666) -> int:
    """Open a file that is written in place, and return its descriptor.

    ``flags``, ``mode``: as of `os.open`; with ``O_TRUNC`` the file is emptied once it is known to be a file of its own.
    Raises `RecordError` for a link, also a hard one, and for what is no regular file; `OSError` if it cannot be opened.
    """
    # Looked at before it is opened, because opening a serial port already raises its DTR line.
    with suppress(FileNotFoundError):
        _require_own(path, path.lstat())
    # The file may have been replaced since: O_NOFOLLOW by a link, O_NONBLOCK by a pipe, at which opening would wait.
    never = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags & ~os.O_TRUNC | never, mode)
    try:
        _require_own(path, os.fstat(descriptor))
        if flags & os.O_TRUNC:
            os.ftruncate(descriptor, 0)
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def overwrite(path: Path, data: bytes) -> None:
    """Write a file in place, not flushed to the disk; errors are those of `open_for_writing`."""
    with os.fdopen(open_for_writing(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb") as file:
        file.write(data)


def sync_folder(folder: Path) -> None:
    """Flush the names in a folder to the disk, where the system can do so; a rename is not durable before."""
    # Windows cannot open a folder to flush it.
    if sys.platform == "win32":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _written(path: Path, rename: Callable[[Path, Path], None]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; the file written there is flushed and renamed when the block succeeds."""
    # Random, so that two processes that write the same file do not share a temporary one.
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        yield part
        with part.open("r+b") as file:
            # Without this, a power cut after the rename can leave the new name with empty contents.
            os.fsync(file.fileno())
        rename(part, path)
        sync_folder(path.parent)
    finally:
        part.unlink(missing_ok=True)


def _require_plain(path: Path, status: os.stat_result) -> None:
    """Refuse a link, a pipe and a device; a folder is refused by the system, in its own words."""
    if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
        raise RecordError(
            f"{path}: it is a symbolic link, a pipe or a device, and nothing is written through it; "
            "remove it, or name another file"
        )


def _require_own(path: Path, status: os.stat_result) -> None:
    """Refuse what `_require_plain` refuses, and a file with a second name: both would be changed."""
    _require_plain(path, status)
    if stat.S_ISREG(status.st_mode) and status.st_nlink > 1:
        raise RecordError(
            f"{path}: it is a hard link, a file with {status.st_nlink} names, and it would be changed under each; "
            "copy it, and name the copy"
        )


def _name_new(part: Path, path: Path) -> None:
    try:
        try:
            # link() fails where the name exists; rename() would replace a file that another process made meanwhile.
            os.link(part, path)
            # At once: a process that is killed later leaves a file with one name, which may be written in place.
            part.unlink()
        except FileExistsError:
            raise
        except OSError:
            # On a disk without hard links (FAT, some network disks) an empty file reserves the name.
            path.open("xb").close()
            try:
                part.replace(path)
            except OSError:
                path.unlink(missing_ok=True)
                raise
    except FileExistsError as problem:
        raise _exists_error(path) from problem


def _exists_error(path: Path) -> RecordError:
    return RecordError(f"{path}: there is a file already; name another, or delete it")
