"""Counts of kills, added up from the pieces of a campaign."""

from __future__ import annotations

import msgspec


class Row(msgspec.Struct, kw_only=True):
    """Kills of one kind at one kind of place.

    Attributes
    ----------
    kills
        Processes that were killed there.
    begun
        Of them, those after which a run (or a bank) existed.
    acknowledged
        Events that had been acknowledged to the parent process.
    lost
        Of them, those that were missing afterwards.
    equal
        Runs that ended as the one that was not killed (of banks: the content is the beginning of the whole).
    """

    kills: int = 0
    begun: int = 0
    acknowledged: int = 0
    lost: int = 0
    equal: int = 0

    def add(self, other: Row) -> None:
        """Add another's counts."""
        for name in self.__struct_fields__:
            setattr(self, name, getattr(self, name) + getattr(other, name))


class Tally(msgspec.Struct, kw_only=True):
    """Rows by kind and place, kills by the point in the program, and what went wrong.

    Attributes
    ----------
    rows
        By kind of run, then kind of place.
    points
        Kills by the step or system call at which they came, then by kind of run.
    notes
        Other counts.
    wrong
        What did not hold, in words.
    """

    rows: dict[str, dict[str, Row]] = {}
    points: dict[str, dict[str, int]] = {}
    notes: dict[str, int] = {}
    wrong: list[str] = []

    def row(self, kind: str, place: str) -> Row:
        """Counts of a kind of run at a kind of place."""
        return self.rows.setdefault(kind, {}).setdefault(place, Row())

    def point(self, point: str, kind: str, count: int = 1) -> None:
        """Count a kill at a point of the program."""
        kinds = self.points.setdefault(point, {})
        kinds[kind] = kinds.get(kind, 0) + count

    def note(self, what: str, count: int = 1) -> None:
        """Count something else."""
        self.notes[what] = self.notes.get(what, 0) + count

    def add(self, other: Tally) -> None:
        """Add the counts of another."""
        for kind, places in other.rows.items():
            for place, row in places.items():
                self.row(kind, place).add(row)
        for point, kinds in other.points.items():
            for kind, count in kinds.items():
                self.point(point, kind, count)
        for what, count in other.notes.items():
            self.note(what, count)
        self.wrong += other.wrong
