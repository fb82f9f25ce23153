"""The tables of a journal as they are made and added to: in transactions, of which all or nothing is on the disk."""

from __future__ import annotations

import sqlite3

import msgspec

from markerseek.records.journal.configuration import Configuration
from markerseek.records.journal.plain import plain
from markerseek.records.journal.store import APPLICATION, PAGE_BYTES, SCHEMAS, VERSION, checksum


def encoded(configuration: Configuration) -> bytes:
    """A configuration as JSON; its parts that are JSON already stay as they are."""
    set_ones = {
        name: value
        for name, value in zip(configuration.__struct_fields__, msgspec.structs.astuple(configuration), strict=True)
        if value is not msgspec.UNSET
    }
    checked = {
        name: value if isinstance(value, msgspec.Raw) else plain(value, what=f"the configuration's {name}")
        for name, value in set_ones.items()
    }
    return msgspec.json.encode(checked)


def lay_out(connection: sqlite3.Connection, as_json: bytes) -> int:
    """Make the tables with the configuration in one transaction; its checksum comes back."""
    first = checksum(0, as_json)
    connection.execute(f"PRAGMA page_size = {PAGE_BYTES}")
    (mode,) = connection.execute("PRAGMA journal_mode = WAL").fetchone()
    if mode != "wal":
        raise sqlite3.OperationalError(f"the folder's file system allows no write-ahead log, only {mode}")
    transact(
        connection,
        *((sql, ()) for sql in SCHEMAS[VERSION]),
        ("INSERT INTO run VALUES (1, ?, ?)", (as_json.decode(), first)),
        (f"PRAGMA application_id = {APPLICATION}", ()),
        (f"PRAGMA user_version = {VERSION}", ()),
    )
    return first


def transact(connection: sqlite3.Connection, *statements: tuple[str, tuple[object, ...]]) -> None:
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


def last_row(connection: sqlite3.Connection) -> tuple[int, int]:
    """Number and checksum of the last event; 0 and that of the configuration before the first."""
    last = connection.execute("SELECT number, checksum FROM events ORDER BY number DESC LIMIT 1").fetchone()
    number, found = last or connection.execute("SELECT 0, checksum FROM run").fetchone()
    return number, found
