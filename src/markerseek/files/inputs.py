"""Opens and reads files that a user names: only regular files, and none larger than its format can need.

A pipe would block, a device would never end, and a sparse file of a few kilobytes on disk could fill the memory. Text
of another kind is refused in words that say which kind is expected.
"""

from __future__ import annotations

import codecs
import errno
import os
import shlex
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO, TypeAlias, TypeVar

import msgspec

from markerseek.core import RecordError

MIB = 1 << 20
"""Bytes of a mebibyte."""

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)

ContentT = TypeVar("ContentT")

FileVersion: TypeAlias = tuple[int, int, int]
"""Inode, time of the last change in nanoseconds and size."""


def os_reason(problem: OSError) -> str:
    """Return the name and message of an error of the file system."""
    return f"{errno.errorcode.get(problem.errno or 0, 'error')}: {problem.strerror or problem}"


def version_of(status: os.stat_result) -> FileVersion:
    """Return what tells a file from one that has replaced it, or from what it was before it was written again."""
    return status.st_ino, status.st_mtime_ns, status.st_size


def quoted(path: Path) -> str:
    """Return a path as it is typed in a shell: in quotes if it has spaces or the like."""
    return shlex.quote(str(path))


@contextmanager
def as_read_error(path: Path) -> Iterator[None]:
    """Turn errors of the file system into a `RecordError` that names the file and the cure."""
    try:
        yield
    except OSError as problem:
        raise RecordError(
            f"{path}: it cannot be read: {problem.strerror or problem}; check the name and the rights"
        ) from problem


def open_input(path: Path, *, most_bytes: int) -> BinaryIO:
    """Open a regular file for reading.

    ``path``: symbolic links are followed. ``most_bytes``: largest size that a file of this format can have. Raises
    `OSError` if it cannot be opened.
    """
    # Checked before opening, because opening a serial port already raises its DTR line.
    _require(path, path.stat(), most_bytes=most_bytes)
    # O_NONBLOCK, because the file may have been replaced by a pipe since the check.
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        _require(path, os.fstat(descriptor), most_bytes=most_bytes)
    except BaseException:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


def read_input(path: Path, *, most_bytes: int) -> bytes:
    """Return all bytes of a regular file; parameters and errors are those of `open_input`."""
    data = bytearray()
    with open_input(path, most_bytes=most_bytes) as file:
        # The size is not trusted: files of /proc state 0 bytes, and a file that is being written grows. Read in pieces,
        # because read(n) allocates n bytes even for a short file.
        while len(data) <= most_bytes and (piece := file.read(MIB)):
            data += piece
    if len(data) > most_bytes:
        raise _too_large(path, len(data), most_bytes)
    return bytes(data)


def require_input(path: Path, *, most_bytes: int) -> None:
    """Check a file that a library will open by name; parameters and errors are those of `open_input`."""
    open_input(path, most_bytes=most_bytes).close()


def _require(path: Path, status: os.stat_result, *, most_bytes: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise RecordError(f"{path}: it is a folder, and a file is expected; name a file in it")
    if not stat.S_ISREG(status.st_mode):
        raise RecordError(
            f"{path}: it is not a regular file but a pipe, socket or device; copy its contents to a regular file"
        )
    if status.st_size > most_bytes:
        raise _too_large(path, status.st_size, most_bytes)


def _too_large(path: Path, found: int, most_bytes: int) -> RecordError:
    return RecordError(f"{path}: {found} bytes found, at most {most_bytes} expected; it is another kind of file")


def read_text(path: Path, *, most_bytes: int, what: str, cure: str, also: Sequence[str] = ()) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 with its byte order mark, which Windows writes.

    ``what``: kind of file that is expected, with its article, for the message; ``cure``: what to do then. ``also``:
    encodings that are tried where it is not in UTF-8.
    """
    with as_read_error(path):
        data = read_input(path, most_bytes=most_bytes)
    # Excel and Notepad write a byte order mark, which is no part of the text.
    for encoding in ["utf-16"] if data.startswith(_UTF_16) else ["utf-8-sig", *also]:
        with suppress(UnicodeDecodeError):
            text = data.decode(encoding)
            # Of binary files, also a spreadsheet or an image, and of UTF-16 without its mark.
            if not {"\0", "\x03"} & set(text):
                return text
    raise RecordError(f"{path}: this is no text in UTF-8 but another kind of file, and {what} is expected; {cure}")


def read_json(path: Path, content: type[ContentT], *, most_bytes: int, what: str, cure: str) -> ContentT:
    """Return the content of a JSON file; parameters as of `read_text`."""
    text = read_text(path, most_bytes=most_bytes, what=what, cure=cure)
    try:
        return msgspec.json.decode(text, type=content)
    except (msgspec.MsgspecError, UnicodeError, RecursionError) as problem:
        found = f"none: {problem}" if text.strip() else "empty"
        raise RecordError(f"{path}: {what} is expected, and this is {found}; {cure}") from problem
