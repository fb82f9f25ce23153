"""The tables of a journal: how they are made, added to, checked and recognised.

The rows form a chain: each carries a checksum over itself and the checksum of the row before. The row of `run` carries
the number of entries and the last checksum, renewed in the transaction of each entry. So a bit that flipped, a row that
is missing and an end that is missing are all noticed.
"""

from __future__ import annotations

import sqlite3
import zlib

import msgspec

from markerseek.core import RecordError

APPLICATION_ID = 0x4D53656B
"""What SQLite's header calls our files: "MSek"."""

VERSION = 1
"""Version of the format; newer ones are refused."""

PAGE_BYTES = 16384
"""A frame of half a megabyte fills 33 pages of this size, and would fill 130 of SQLite's own."""

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


def create_tables(connection: sqlite3.Connection, configuration: bytes) -> int:
    """Make the tables with the configuration, as JSON, in one transaction; its checksum comes back."""
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
    connection.execute("BEGIN IMMEDIATE")
    try:
        for sql, values in statements:
            connection.execute(sql, values)
        connection.execute("COMMIT")
    except BaseException:
        if connection.in_transaction:
            connection.execute("ROLLBACK")
        raise


def counted(connection: sqlite3.Connection) -> tuple[int, int]:
    """Number of entries that were committed, and the checksum of the last one."""
    entries, last = connection.execute("SELECT entries, last_checksum FROM run").fetchone()
    return entries, last


def require_schema(connection: sqlite3.Connection) -> None:
    """Refuse a file that is no journal, or is newer than this program.

    Raises
    ------
    RecordError
        If it is either; nothing of its contents was used.
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
    tables = connection.execute("SELECT sql FROM sqlite_master ORDER BY rowid LIMIT 3").fetchall()
    if version != VERSION or tables != [(sql,) for sql in TABLES]:
        raise RecordError(f"its tables are none of a journal of version {version}; it is damaged or foreign")
