"""Checks a journal for every kind of damage, and reports all of it."""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.core import RecordError
from markerseek.records.journal.connection import as_record_error, opened_for_reading, resolve_link
from markerseek.records.journal.reader import recording
from markerseek.records.journal.sequence import angle_faults, order_faults

_MOST_COMPLAINTS = 20
"""Most messages of SQLite's integrity check that are reported."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """Result of a check.

    Attributes
    ----------
    entries
        Number of entries that can be read and agree with their checksums, from the first on.
    faults
        What is wrong, in words; empty for a whole journal.
    """

    entries: int
    faults: list[str]


def verify(path: Path) -> Finding:
    """Check a journal: pages, checksums, order of the events, and angles.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordError
        If it is not a journal, was written by a newer program, or is in use.
    """
    faults: list[str] = []
    path = resolve_link(path)
    with opened_for_reading(path) as connection:
        # Both checks on one connection, so that nobody writes in between.
        held, damage = recording(connection, path, frames=False)
        try:
            with as_record_error(path, verb="read"):
                complaints = connection.execute(f"PRAGMA integrity_check({_MOST_COMPLAINTS})").fetchall()
        except RecordError as problem:
            faults.append(str(problem))
        else:
            faults += [f"SQLite: {line}" for (text,) in complaints if text != "ok" for line in text.splitlines()]
    if damage is not None:
        faults.append(str(damage))
    wrong = [*order_faults(held.entries), *angle_faults(held.configuration, held.entries)]
    faults += [f"entry {number}: {reason}" for number, reason in sorted(wrong)]
    return Finding(entries=len(held.entries), faults=faults)
