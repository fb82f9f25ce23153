"""Looks a journal over for every kind of damage, and goes on after the first."""

from __future__ import annotations

from pathlib import Path

import msgspec

from markerseek.core import RecordError
from markerseek.records.journal.angles import angle_faults
from markerseek.records.journal.connection import speaking_of
from markerseek.records.journal.grammar import order_faults
from markerseek.records.journal.reader import open_journal, recording

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
        If it is no journal at all, is newer than this program, or is in use.
    """
    faults: list[str] = []
    with open_journal(path) as (connection, log_damage):
        try:
            held, damage = recording(connection, path, frames=False)
        except RecordError as problem:
            raise log_damage or problem from None
        if log_damage is not None:
            faults.append(str(log_damage))
        try:
            with speaking_of(path, verb="read"):
                complaints = connection.execute(f"PRAGMA integrity_check({_MOST_COMPLAINTS})").fetchall()
        except RecordError as problem:
            faults.append(str(problem))
        else:
            faults += [f"SQLite: {line}" for (said,) in complaints if said != "ok" for line in said.splitlines()]
    if damage is not None:
        faults.append(str(damage))
    wrong = [*order_faults(held.entries), *angle_faults(held.configuration, held.entries)]
    faults += [f"entry {number}: {reason}" for number, reason in sorted(wrong)]
    return Finding(entries=len(held.entries), faults=faults)
