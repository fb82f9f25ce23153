"""SQL tables of a journal, and the checksums of their rows.

The rows form a chain: each has a checksum over its columns and the checksum of the row before. The row of `run` has the
number of entries and the last checksum, updated in the transaction of each entry. So a flipped bit, a missing row and a
missing end are all detected.
"""

from __future__ import annotations

import sqlite3
import zlib

import msgspec

from markerseek.core import RecordError

APPLICATION_ID = 0x4D53656B
"""Application number in SQLite's header, "MSek"."""

VERSION = 1
"""Version of the format; newer ones are refused."""

PAGE_BYTES = 16384
"""SQLite page size: a frame of half a megabyte fills 33 such pages, and 130 of the default size."""

TABLES = (
    """CREATE TABLE run (id INTEGER PRIMARY KEY CHECK (id = 1), configuration TEXT NOT NULL, checksum INTEGER NOT NULL,
    entries INTEGER NOT NULL, last_checksum INTEGER NOT NULL)""",
    """CREATE TABLE events (number INTEGER PRIMARY KEY, kind TEXT NOT NULL, written TEXT NOT NULL,
    clock_s REAL NOT NULL, body TEXT NOT NULL, checkpoint TEXT, checksum INTEGER NOT NULL, samples BLOB)""",
)
"""One row for the run, then one row an event."""


class Row(msgspec.Struct, frozen=True, array_like=True):
    """One row of `events`, its columns in order but for the samples."""

    number: int
    kind: str
    written: str
    clock_s: float
    body: str
    checkpoint: str | None
    checksum: int


def checksum(previous: int, *parts: bytes | memoryview) -> int:
    """CRC-32 over a row and the checksum of the row before it.

    ``previous``: checksum of the row before; 0 for the configuration. ``parts``: the columns as bytes; each is preceded
    by its length.
    """
    running = zlib.crc32(previous.to_bytes(4, "little"))
    for part in parts:
        # With the lengths, so that a byte moved from one column to the next changes the checksum.
        running = zlib.crc32(len(part).to_bytes(8, "little"), running)
        running = zlib.crc32(part, running)
    return running


def row_checksum(previous: int, row: Row, samples: bytes | memoryview | None) -> int:
    """Checksum that a row should have.

    ``previous``: checksum of the row before. ``row``: its checksum column is ignored.
    """
    # float.hex, because a decimal text could round; CRC-32 detects accidents, not forgery.
    text = (str(row.number), row.kind, row.written, row.clock_s.hex(), row.body, row.checkpoint or "")
    return checksum(previous, *(part.encode() for part in text), samples or b"")


def create_tables(connection: sqlite3.Connection, configuration: bytes) -> int:
    """Create the tables and store the configuration (JSON) in one transaction; returns its checksum."""
    first = checksum(0, configuration)
    connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
    _transact(
        connection,
        *((sql, ()) for sql in TABLES),
        ("INSERT INTO run VALUES (1, ?, ?, 0, ?)", (configuration.decode(), first, first)),
        (f"PRAGMA application_id = {APPLICATION_ID}", ()),
        (f"PRAGMA user_version = {VERSION}", ()),
    )
    return first


def add_row(connection: sqlite3.Connection, row: Row, samples: bytes | memoryview | None) -> None:
    """Add a row and count it, in one transaction."""
    _transact(
        connection,
        ("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?)", (*msgspec.structs.astuple(row), samples)),
        ("UPDATE run SET entries = ?, last_checksum = ?", (row.number, row.checksum)),
    )


def _transact(connection: sqlite3.Connection, *statements: tuple[str, tuple[object, ...]]) -> None:
    """Run statements in one transaction: all or none."""
    # Takes the write lock at the start: an upgrade of a read lock could fail in the middle.
    connection.execute("BEGIN IMMEDIATE")
    try:
        for sql, values in statements:
            connection.execute(sql, values)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def stored_tail(connection: sqlite3.Connection) -> tuple[int, int]:
    """Number of entries that were committed, and the checksum of the last one."""
    entries, last = connection.execute("SELECT entries, last_checksum FROM run").fetchone()
    return entries, last


def require_schema(connection: sqlite3.Connection) -> None:
    """Refuse a file that is not a journal, or was written by a newer version.

    Raises `RecordError` if it is either; no content has been read by then.
    """
    (application,) = connection.execute("PRAGMA application_id").fetchone()
    if application != APPLICATION_ID:
        raise RecordError("it is no journal of a run (or its run was never begun); check the name")
    (version,) = connection.execute("PRAGMA user_version").fetchone()
    if version > VERSION:
        raise RecordError(
            f"it was written by a newer markerseek: the journal has version {version}, this one reads up to {VERSION}; "
            "install a newer one"
        )
    # A view or a trigger in a hostile file would run when it is read.
    # Three rows at most are read: a third one is already too many.
    tables = connection.execute("SELECT sql FROM sqlite_master ORDER BY rowid LIMIT 3").fetchall()
    if version != VERSION or tables != [(sql,) for sql in TABLES]:
        raise RecordError(f"its tables are none of a journal of version {version}; it is damaged or foreign")
