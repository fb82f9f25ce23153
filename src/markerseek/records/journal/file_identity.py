"""Detects that the file of an open journal was deleted or replaced, and saves a copy of its contents."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

from markerseek.core import RecordError
from markerseek.files import sync_folder
from markerseek.records.journal.connection import rollback_file

_MAX_COPIES = 100


class FileIdentity:
    """Device and inode of an open journal and of its rollback file.

    A deleted file stays readable and writable for the program that has it open, and is lost when that program ends; a
    lost rollback file is missing if the program dies in a commit.

    ``path``: the journal, just opened.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = _identity(path)
        self._rollback: tuple[int, int] | None = None

    def loss(self) -> str | None:
        """Name of the file that was deleted or replaced; None while both are those that were opened.

        Raises `OSError` if the file system does not answer.
        """
        if _identity(self._path) != self._file:
            return f"{self._path}"
        rollback = _identity(rollback_file(self._path))
        # SQLite creates it with the first commit, and keeps it open as long as the journal.
        if self._rollback is None:
            self._rollback = rollback
        return None if rollback == self._rollback else f"its {rollback_file(self._path)}"


def copied(connection: sqlite3.Connection, path: Path) -> Path:
    """Copy of an open journal in a new file beside it.

    ``path``: path of the journal before the loss. Raises `RecordError` if no such file can be made. Raises
    `sqlite3.Error` or `OSError` if it cannot be written; nothing is left behind.
    """
    for number in range(1, _MAX_COPIES + 1):
        copy = path.with_name(f"{path.stem}-rescued-{number}{path.suffix}")
        try:
            copy.open("xb").close()
        except FileExistsError:
            continue
        try:
            with closing(sqlite3.connect(copy)) as target:
                target.execute("PRAGMA synchronous = FULL")
                # SQLite's own copy: it reads through the open descriptor, which still has the deleted file.
                connection.backup(target)
            sync_folder(copy.parent)
        except BaseException:
            copy.unlink(missing_ok=True)
            raise
        return copy
    raise RecordError(f"{path.parent} holds {_MAX_COPIES} rescued copies of it already; remove those not needed")


def _identity(path: Path) -> tuple[int, int] | None:
    try:
        # Links were resolved on opening: a link at this path now is another file.
        found = path.stat(follow_symlinks=False)
    except FileNotFoundError:
        return None
    return found.st_dev, found.st_ino
