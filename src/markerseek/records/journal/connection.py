"""Opens journals in SQLite, and turns its errors into `RecordError`.

A rollback journal and ``synchronous = FULL`` make a commit survive the death of the process and of the machine: what
is committed is in the file. During a commit SQLite keeps the former pages in ``NAME-journal``; a run that dies in a
commit leaves that file, and the next program that opens the journal must restore those pages. A program that writes a
journal holds an exclusive lock, so that two programs cannot drive one run.
"""

from __future__ import annotations

import errno
import os
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Literal
from urllib.parse import quote

from platformdirs import user_data_path

from markerseek.core import RecordError
from markerseek.files import open_input, require_input
from markerseek.records.journal.schema import APPLICATION_ID

_MAGIC, _HEADER_BYTES, _ROLLBACK_FORMAT = b"SQLite format 3\0", 100, b"\1\1"
_ROLLBACK_MAGIC = bytes.fromhex("d9d505f920a163d7")
"""First bytes of a rollback file, and its last ones where it names a super-journal (sqlite.org/fileformat2.html)."""
_FORMAT, _APPLICATION = slice(18, 20), slice(68, 72)
_MAX_BYTES = 1 << 36
"""Largest journal that is opened: 100,000 frames of half a megabyte."""


def connect(path: Path, *, mode: Literal["rw", "ro"]) -> sqlite3.Connection:
    """Connection without automatic transactions.

    ``mode``: "rw" holds an exclusive lock from the first transaction on; "ro" changes nothing. Raises `sqlite3.Error`
    if the file is locked or no database.
    """
    _require_own_rollback_file(path)
    uri = f"file:{quote(os.fsencode(path.absolute()))}?mode={mode}"
    # A short timeout, for a reader that is just opening it: a writer keeps its lock for a whole run.
    connection = sqlite3.connect(uri, uri=True, isolation_level=None, timeout=0.5, check_same_thread=True)
    try:
        # A journal may come from anyone: no SQL functions in its schema, and damaged pages are errors.
        connection.execute("PRAGMA trusted_schema = OFF")
        connection.execute("PRAGMA cell_size_check = ON")
        if mode == "rw":
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            # Overwriting the rollback file's header is cheaper than deleting the file at each commit.
            connection.execute("PRAGMA journal_mode = PERSIST")
            connection.execute("PRAGMA synchronous = FULL")
            # macOS reports a flush as done before the disk has it; the others do not know this setting.
            connection.execute("PRAGMA fullfsync = ON")
    except BaseException:
        connection.close()
        raise
    return connection


def _require_own_rollback_file(path: Path) -> None:
    """Refuse a rollback file that names a super-journal: SQLite deletes the file of that name after a rollback.

    A transaction over several databases ends in such a name; ours are over one.
    """
    rollback = rollback_file(path)
    if not os.path.lexists(rollback):
        return
    with open_input(rollback, most_bytes=_MAX_BYTES) as file:
        file.seek(max(0, os.fstat(file.fileno()).st_size - len(_ROLLBACK_MAGIC)))
        if file.read() == _ROLLBACK_MAGIC:
            raise RecordError(
                f"{rollback}: it names a further file, which SQLite would delete, and was not written by markerseek; "
                f"move it away to read {path.name} as it is"
            )


def remove_rollback_file(connection: sqlite3.Connection) -> None:
    """Remove the rollback journal that PERSIST leaves, while the file is still locked."""
    connection.execute("PRAGMA locking_mode = NORMAL")
    connection.execute("PRAGMA journal_mode = DELETE")


@contextmanager
def opened_for_reading(path: Path) -> Iterator[sqlite3.Connection]:
    """Read-only connection to a journal; neither the file nor its rollback journal is changed.

    A run that died in a commit is read from a copy, in which SQLite can undo that commit: this works on a read-only
    disk, and a foreign rollback journal cannot damage the file.
    """
    with as_record_error(path, verb="read"):
        require_journal_file(path)
        with closing(connect(path, mode="ro")) as connection:
            if not _needs_rollback(connection):
                yield connection
                return
        with tempfile.TemporaryDirectory(prefix="markerseek-") as folder:
            copy = Path(folder) / "copy.journal"
            # A writer that changes either file during the copy would give a mixture of two states.
            before = _stamps(path)
            shutil.copyfile(path, copy)
            require_input(rollback_file(path), most_bytes=_MAX_BYTES)
            shutil.copyfile(rollback_file(path), rollback_file(copy))
            if _stamps(path) != before:
                raise RecordError(f"{path}: the journal changed while it was read; another markerseek has it open")
            with closing(connect(copy, mode="rw")) as connection:
                yield connection


def _needs_rollback(connection: sqlite3.Connection) -> bool:
    """Whether an unfinished commit must be undone; if not, the connection holds a read lock from here on."""
    try:
        connection.execute("BEGIN")
        connection.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.OperationalError as problem:
        if problem.sqlite_errorname == "SQLITE_READONLY_ROLLBACK":
            return True
        raise
    return False


def _stamps(path: Path) -> list[tuple[int, int]]:
    return [(part.stat().st_size, part.stat().st_mtime_ns) for part in (path, rollback_file(path))]


def resolve_link(path: Path) -> Path:
    """Target of a symbolic link: SQLite puts the rollback journal beside the target."""
    try:
        # A link to anything else is refused later, under the name that the user gave.
        return Path(os.path.realpath(path)) if path.is_symlink() and path.is_file() else path
    except OSError:
        return path


def rollback_file(path: Path) -> Path:
    """Path of SQLite's rollback file of a journal; the file may be absent."""
    return Path(f"{path}-journal")


def is_journal(path: Path) -> bool:
    """Whether a regular file has the header of a journal; its contents are not checked.

    Raises `OSError` if it cannot be read.
    """
    with open_input(path, most_bytes=sys.maxsize) as file:
        return _is_ours(file.read(_HEADER_BYTES))


def _is_ours(header: bytes) -> bool:
    return header.startswith(_MAGIC) and header[_APPLICATION] == APPLICATION_ID.to_bytes(4, "big")


def journals_folder() -> Path:
    """Default folder of journals, in the user's data folder."""
    return user_data_path("markerseek", appauthor=False) / "journals"


def require_journal_file(path: Path) -> None:
    """Refuse files that cannot be a journal, before SQLite opens them."""
    if path.is_dir():
        raise RecordError(f"{path}: it is a folder, and a journal is one file; name the file")
    if not path.exists():
        raise RecordError(
            f"{path}: there is no such journal; check the name ('markerseek journal list' shows those of "
            f"searches that named none, in {journals_folder()})"
        )
    with open_input(path, most_bytes=_MAX_BYTES) as file:
        header, names = file.read(_HEADER_BYTES), os.fstat(file.fileno()).st_nlink
    if not header:
        raise RecordError(f"{path}: it is empty: no journal of a run (or its run was never begun); check the name")
    # SQLite names the rollback file after the path by which the journal was opened.
    if names > 1:
        raise RecordError(
            f"{path}: the file has {names} names (hard links), and under another one it could be written "
            "without its rollback journal; copy it, and use the copy"
        )
    if header.startswith(_MAGIC) and header[_FORMAT] != _ROLLBACK_FORMAT:
        raise RecordError(
            f"{path}: it is a database without rollback journal (format {header[_FORMAT].hex()}) and no journal of a "
            "run, or it is damaged"
        )


def exists_error(path: Path) -> RecordError:
    """Error for a new journal whose path exists already."""
    if path.is_dir():
        return RecordError(f"{path}: it is a folder, and a journal is one file; name a new file in it")
    if path.is_file() and is_journal(path):
        return RecordError(
            f"{path}: the journal exists already; name another file, or continue it: markerseek resume {path}"
        )
    return RecordError(f"{path}: this exists already and is no journal; name a new file")


@contextmanager
def as_record_error(path: Path, *, verb: str) -> Iterator[None]:
    """Turn errors of SQLite and of the file system into a `RecordError` that names the file and the cure.

    ``verb``: what could not be done: "read", "written" or "closed".
    """
    try:
        yield
    except sqlite3.Error as problem:
        raise RecordError(f"{path}: the journal cannot be {verb}: {problem}; {_sqlite_cure(problem)}") from problem
    except (OverflowError, MemoryError, UnicodeDecodeError) as problem:
        raise RecordError(f"{path}: the journal cannot be {verb}: it is damaged ({problem})") from problem
    except OSError as problem:
        reason = problem.strerror or problem
        raise RecordError(f"{path}: the journal cannot be {verb}: {reason}; {_system_cure(problem, path)}") from problem


def _system_cure(problem: OSError, path: Path) -> str:
    match problem.errno:
        case errno.ENOENT:
            return f"there is no folder {path.parent}; make it, or name another place"
        case errno.ENOTDIR:
            return f"{path.parent} is no folder; name another place"
        case errno.ENOSPC | errno.EDQUOT | errno.EIO:
            return "make room on the disk or name another place; what was committed before stays readable"
        case errno.ENAMETOOLONG:
            return "name it shorter"
        case _:
            return "check the folder and the rights, or name another place"


def _sqlite_cure(problem: sqlite3.Error) -> str:
    match getattr(problem, "sqlite_errorname", "").split("_")[1:2]:
        case ["BUSY"] | ["LOCKED"]:
            return "another markerseek has it open; wait until that is over"
        case ["FULL"] | ["IOERR"]:
            return "make room on the disk or name another place; what was committed before stays readable"
        case ["READONLY"] | ["CANTOPEN"] | ["PERM"]:
            return "check the folder and the rights, or name another place"
        case ["NOTADB"]:
            return (
                "it does not begin as a journal does, so that it is another kind of file, or damaged; check the name "
                "('markerseek replay' searches recorded scans)"
            )
        case _:
            return "it is damaged or no journal; 'markerseek journal show' prints as much of it as is whole"
