"""The SQLite file: what is in it, and how it is told from other files."""

from __future__ import annotations

import os
import sqlite3
import zlib
from pathlib import Path

import msgspec

from markerseek.core import RecordError
from markerseek.records.journal.place import journals_folder

APPLICATION = 0x4D53656B
"""What SQLite's header calls our files: "MSek"."""

VERSION = 2
"""Newest version of the format; older ones are read, and lifted to it with the first row that is added to them.

- 1: the tables below.
- 2: the same tables; a refused frame and the frame of a check are kept, with a second angle that is checked and the
  settings of the imaging chain.
"""

_TABLES = (
    "CREATE TABLE run (id INTEGER PRIMARY KEY CHECK (id = 1), configuration TEXT NOT NULL, checksum INTEGER NOT NULL)",
    """CREATE TABLE events (number INTEGER PRIMARY KEY, kind TEXT NOT NULL, written TEXT NOT NULL,
    clock_s REAL NOT NULL, body TEXT NOT NULL, checkpoint TEXT, checksum INTEGER NOT NULL, samples BLOB)""",
)
"""The configuration in one row, then one row an event."""

SCHEMAS = {1: _TABLES, 2: _TABLES}
"""Tables of each version."""

_HEADER_BYTES = 100
"""Length of SQLite's header; our mark lies at its byte 68."""

PAGE_BYTES = 16384
"""A frame of half a megabyte fills 33 pages of this size, and would fill 130 of SQLite's own."""


class Row(msgspec.Struct, frozen=True, array_like=True):
    """One row of `events`, its columns in order."""

    number: int
    kind: str
    written: str
    clock_s: float
    body: str
    checkpoint: str | None
    checksum: int


def checksum(previous: int, *parts: bytes | memoryview) -> int:
    """CRC-32 over a row and the checksum of the one before it, so that a missing row is noticed as well.

    Parameters
    ----------
    previous
        Checksum of the row before; 0 for the configuration.
    parts
        The columns as bytes; each is preceded by its length.
    """
    running = zlib.crc32(previous.to_bytes(4, "little"))
    for part in parts:
        running = zlib.crc32(len(part).to_bytes(8, "little"), running)
        running = zlib.crc32(part, running)
    return running


def row_checksum(previous: int, row: Row, samples: bytes | memoryview | None) -> int:
    """Checksum that a row should have.

    Parameters
    ----------
    previous
        Checksum of the row before.
    row
        The row; its own checksum is not looked at.
    samples
        Its blob.
    """
    text = (str(row.number), row.kind, row.written, row.clock_s.hex(), row.body, row.checkpoint or "")
    return checksum(previous, *(part.encode() for part in text), samples or b"")


def log_of(path: Path) -> Path:
    """SQLite's write-ahead log of a journal, which need not exist."""
    return Path(f"{path}-wal")


def followed(path: Path) -> Path:
    """The file that a name leads to: beside this one, and not beside a symbolic link to it, lies its log."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def is_journal(path: Path) -> bool:
    """Whether an ordinary file begins as journals do; the rest of it is not looked at.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    path = followed(path)
    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES)
    if not header.startswith(b"SQLite format 3\0"):
        return False
    # Of a run that was killed early, all but this first page may still lie in the write-ahead log.
    return header[68:72] == APPLICATION.to_bytes(4, "big") or log_of(path).is_file()


def require_file(path: Path) -> None:
    """Refuse what is no ordinary file, or is empty, before SQLite is asked to open it.

    Raises
    ------
    RecordError
        If there is nothing, or a folder, a pipe, a device, an empty file, or a file of more than one name.
    """
    if path.is_dir():
        raise RecordError(f"{path}: it is a folder, and a journal is one file; name the file")
    if not path.exists():
        raise RecordError(
            f"{path}: there is no such journal; check the name ('markerseek journal list' shows those of "
            f"searches that named none, in {journals_folder()})"
        )
    if not path.is_file():
        raise RecordError(f"{path}: it is no ordinary file and so no journal; check the name")
    if (names := path.stat().st_nlink) > 1:
        raise RecordError(
            f"{path}: the file has {names} names (hard links), and its log lies beside one of them only; "
            "remove the other names, or copy file and log together to a new place"
        )
    if path.stat().st_size == 0:
        # SQLite removes the log that lies beside an empty file.
        raise RecordError(
            f"{path}: it is empty: no journal of a run (or its run was never begun); check the name" + _log_beside(path)
        )


def _log_beside(path: Path) -> str:
    log = log_of(path)
    return f" (its log {log} is left as it is)" if log.is_file() else ""


def taken(path: Path) -> RecordError:
    """What is wrong with the name of a new journal where something is already."""
    if path.is_dir():
        return RecordError(f"{path}: it is a folder, and a journal is one file; name a new file in it")
    if path.is_file() and is_journal(path):
        return RecordError(
            f"{path}: the journal exists already; name another file, or go on with it: markerseek resume {path}"
        )
    return RecordError(f"{path}: this exists already and is no journal; name a new file")


def require_ours(connection: sqlite3.Connection, path: Path) -> int:
    """Refuse a file that is no journal, or is newer than we are; its version comes back.

    Raises
    ------
    RecordError
        If it is either; nothing of its contents was used.
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION:
        raise RecordError(f"{path}: it is no journal of a run (or its run was never begun); check the name")
    version = version_of(connection)
    if version > VERSION:
        raise RecordError(
            f"{path}: the journal has version {version}, this markerseek reads up to {VERSION}; install a newer one"
        )
    # A view or a trigger in a hostile file would run when it is read.
    tables = connection.execute("SELECT sql FROM sqlite_master ORDER BY rowid LIMIT 3").fetchall()
    if version not in SCHEMAS or tables != [(sql,) for sql in SCHEMAS[version]]:
        raise RecordError(f"{path}: its tables are none of a journal of version {version}; it is damaged or foreign")
    return version


def version_of(connection: sqlite3.Connection) -> int:
    """Version of the format that a file says it has."""
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    return int(version)
