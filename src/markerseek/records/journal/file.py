"""The files of journals: their folder and names; opening, locking and flushing one; errors of the system."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files import data_folder, open_input, quoted, sync_folder

SUFFIX = ".journal"
"""Suffix of the files that `journals_in` finds, and of default names."""

_MAX_BYTES = 1 << 36
"""Largest journal that is opened: 100,000 frames of half a megabyte."""

MAGIC = b'{"crc":"'
"""First bytes of every line of a journal."""

MAGIC_1 = b'{"number":       0,"bytes":'
"""First bytes of a journal of format 1."""

_PATIENCE_S = 0.5
"""Longest wait for the lock, in seconds: `is_written` holds it for a moment, a writer for a whole run."""


def journals_folder() -> Path:
    """Return the default folder of journals, in the user's data folder; `RecordError` where the system knows none."""
    return data_folder() / "journals"


def default_journal(*, method: str) -> Path:
    """Return the name of a new journal in the user's data folder; its name begins with the time, UTC."""
    # With microseconds, so that two searches begun in one second get two names.
    now = datetime.now(UTC)
    return journals_folder() / f"{now:%Y%m%d-%H%M%S}-{now.microsecond:06d}-{method}{SUFFIX}"


def make_folder(folder: Path) -> None:
    """Make a folder and its missing parents, readable by the owner only, and flush their names to disk.

    ``folder``: one that may exist. Raises `OSError` if it cannot be made.
    """
    # Path.mkdir(parents=True) gives the parents default rights, and does not flush their names.
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    for each in reversed(missing):
        each.mkdir(mode=0o700, exist_ok=True)
        sync_folder(each.parent)


def journals_in(folder: Path) -> list[Path]:
    """Return the journals of a folder, the newest change last.

    ``folder``: where to look; not in the folders that it holds.
    """
    try:
        found = [
            (each.stat().st_mtime_ns, each)
            for each in folder.iterdir()
            if each.suffix == SUFFIX and each.is_file() and not each.name.startswith(".")
        ]
    except OSError as problem:
        raise RecordError(f"{folder}: no journals can be listed: {problem.strerror or problem}; check it") from problem
    return [path for _, path in sorted(found)]


def size_bytes_of(path: Path) -> int:
    """Return the bytes of a journal; a missing file counts 0."""
    with suppress(OSError):
        return path.stat().st_size
    return 0


def is_journal(path: Path) -> bool:
    """Return whether a regular file begins as a journal does; its contents are not checked.

    Raises `OSError` if it cannot be read.
    """
    with open_input(path, most_bytes=1 << 62) as file:
        head = file.read(40)
        return head.startswith(MAGIC_1) or (head.startswith(MAGIC) and b'"record":' in head)


def exists_error(path: Path) -> RecordError:
    """Return the error for a new journal whose path exists already."""
    if path.is_dir():
        return RecordError(f"{path}: it is a folder, and a journal is one file; name a new file in it")
    if path.is_file() and is_journal(path):
        return RecordError(
            f"{path}: the journal exists already; name another file, or continue it: `resumed_run({quoted(path)})`"
        )
    return RecordError(f"{path}: this exists already and is no journal; name a new file")


def open_for_reading(path: Path) -> int:
    """Return the file descriptor of a journal; files that cannot be one are refused."""
    if path.is_dir():
        raise RecordError(f"{path}: it is a folder, and a journal is one file; name the file")
    if not path.exists():
        raise RecordError(
            f"{path}: there is no such journal; check the name; those of searches that named none are listed "
            "by `journals_in()`"
        )
    with open_input(path, most_bytes=_MAX_BYTES) as file:
        return os.dup(file.fileno())


def lock(descriptor: int) -> None:
    """Lock a journal for this process; `BlockingIOError` if another one has it open for writing."""
    ends_s = time.monotonic() + _PATIENCE_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > ends_s:
                raise
            time.sleep(0.01)  # noqa: TID251  another process is waited for
        else:
            return


def is_written(descriptor: int) -> bool:
    """Return whether a program has the journal open for writing: its run is going on."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    fcntl.flock(descriptor, fcntl.LOCK_UN)
    return False


def flush(descriptor: int) -> None:
    """Put what was written on the disk."""
    # macOS reports a flush as done before the disk has it; the others do not know this command.
    if hasattr(fcntl, "F_FULLFSYNC"):
        fcntl.fcntl(descriptor, fcntl.F_FULLFSYNC)
    else:
        os.fdatasync(descriptor)


@contextmanager
def as_journal_error(path: Path, *, verb: str) -> Iterator[None]:
    """Turn errors of the file system into a `RecordError` that names the file and the cure.

    ``verb``: what could not be done: "read", "written" or "closed".
    """
    try:
        yield
    except BlockingIOError as problem:
        raise RecordError(f"{path}: another markerseek writes this journal; wait until that is over") from problem
    except OSError as problem:
        reason = problem.strerror or problem
        raise RecordError(
            f"{path}: the journal cannot be {verb}: {reason}; check the folder, the rights, and the room on the "
            "disk, or name another place; what was committed before stays readable"
        ) from problem
