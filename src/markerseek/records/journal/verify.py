"""Checks a journal for every kind of damage, and does not stop at the first."""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.core import RecordError
from markerseek.records.journal.connection import as_record_error, opened_for_reading, resolve_link
from markerseek.records.journal.reader import recording
from markerseek.records.journal.sequence import angle_faults, order_faults

_MOST_COMPLAINTS = 20
"""Complaints of SQLite's own check that are passed on."""


class Finding(msgspec.Struct, frozen=True, kw_only=True):
    """What a check found.

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
    """Everything that is wrong with a journal: its pages, its checksums, the order of what happened, and its angles.

    Parameters
    ----------
    path
        The file.

    Raises
    ------
    RecordError
        If it is no journal at all, was written by a newer program, or is in use.
    """
    faults: list[str] = []
    path = resolve_link(path)
    with opened_for_reading(path) as connection:
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
